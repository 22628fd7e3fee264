"""Grey-value scans behind segmentations, with the file's own values, for display in slices."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from homolog.arrays import Array, Float32Array, FloatArray, frozen
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.progress import Tick, no_tick

__all__ = ["Scan", "check_frame", "read_scan"]

_LOOKED_AT = 500_000
"""Largest number of voxels from which the automatic window is computed."""
_LOWEST, _HIGHEST = 1.0, 99.5
"""Percentiles of the grey values at the ends of an automatic window."""
_INSIDE = 0.5
"""Least fraction of a structure that must lie within its scan."""


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A volume of grey values.

    Attributes
    ----------
    path : Path
    values : (I, J, K) array
        As stored: of the file's type, read-only, and mapped from the file where its format allows.
    index_to_world : (4, 4) float64 array
        From voxel indices to LPS [mm].
    slope, intercept : float
        Grey value = slope * stored value + intercept (Hounsfield units in CT).
    notes : tuple of str
        Notes on the file for the user.
    """

    path: Path
    values: Array
    index_to_world: FloatArray
    slope: float = 1.0
    intercept: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays; the voxels are not copied."""
        self.values.flags.writeable = False
        object.__setattr__(self, "index_to_world", frozen(self.index_to_world, np.float64))

    @property
    def spacing(self) -> FloatArray:
        """Distance of neighbouring voxel centres along the grid axes [mm], (3,)."""
        return np.asarray(np.linalg.norm(self.index_to_world[:3, :3], axis=0))

    @property
    def box(self) -> FloatArray:
        """Smallest and largest LPS coordinates of the voxel centres [mm], (2, 3)."""
        ends = [(0.0, size - 1.0) for size in self.values.shape]
        corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 3)
        there = transform_points(self.index_to_world, corners)
        return np.stack([there.min(axis=0), there.max(axis=0)])

    def plane(self, axis: int, index: int) -> Float32Array:
        """Return the grey values of one slice of the grid, indexed by the other two axes in order."""
        values: Float32Array = np.moveaxis(self.values, axis, 0)[index].astype(np.float32)  # take copies all
        values *= np.float32(self.slope)
        values += np.float32(self.intercept)
        return values

    def automatic_window(self) -> tuple[float, float]:
        """Return percentiles of a sample of voxels: the grey values between which nearly all voxels lie."""
        step = max(1, round((self.values.size / _LOOKED_AT) ** (1.0 / 3.0)))
        some = self.values[::step, ::step, ::step].astype(np.float32)
        some = some[np.isfinite(some)] * self.slope + self.intercept
        if not some.size:
            return 0.0, 1.0
        inside = some[some > some.min()]  # the contrast excludes the air around the patient
        low, high = np.percentile(inside if inside.size else some, (_LOWEST, _HIGHEST)).tolist()
        return (low, high) if high > low else (low, low + 1.0)


def read_scan(path: Path, tick: Tick = no_tick) -> Scan:
    """Read a grey-value scan in the data type of its file.

    Parameters
    ----------
    path : Path
        NRRD, NIfTI, Analyze, MetaImage, MGH, GIPL, TIFF, or the folder of a DICOM series or of pictures.
        Voxels of uncompressed NIfTI, Analyze and MGH files stay on the disk (memory-mapped).
    tick : Tick

    Raises
    ------
    InputError
        If the file is missing, cut short, not a volume of single numbers or larger than memory, or
        contradicts itself about its position.
    """
    from homolog.io.images import read_stored

    tick(0.0, f"reading {path.name}")
    stored = read_stored(path, tick)
    if stored.values.ndim > 3:
        raise InputError(f"{path}: has several values per voxel; choose a scan of grey values")
    return Scan(path, stored.values, stored.index_to_world, stored.slope, stored.intercept, stored.notes)


def check_frame(scan: Scan, points: FloatArray, name: str) -> float:
    """Refuse a scan that does not contain a structure, because their coordinate frames differ.

    Parameters
    ----------
    scan : Scan
    points : (P, 3) array
        Points of the structure, LPS [mm].
    name : str
        Name of the subject, for the message.

    Returns
    -------
    float
        Fraction of the points that lie within the scan.

    Raises
    ------
    InputError
        If less than half of the points lie within the scan. The message contains the extents of both.
    """
    indices = transform_points(np.asarray(np.linalg.inv(scan.index_to_world), np.float64), points)
    limits: FloatArray = np.array(scan.values.shape) - 0.5
    inside = float(((indices >= -0.5) & (indices <= limits)).all(axis=1).mean())
    if inside < _INSIDE:
        structure = np.stack([points.min(axis=0), points.max(axis=0)])
        apart = float(np.linalg.norm(structure.mean(axis=0) - scan.box.mean(axis=0)))
        raise InputError(
            f"{scan.path}: does not lie where the structure of {name} is: {100.0 * inside:.0f} % of it are "
            f"within the scan. The scan spans {_span(scan.box)}, the structure {_span(structure)} (LPS); "
            f"their centres are {apart:.0f} mm apart. Choose the scan that was segmented, or export both "
            "in one frame"
        )
    return inside


def _span(box: FloatArray) -> str:
    sides = (f"{low:.0f} to {high:.0f}" for low, high in box.T.tolist())
    return " x ".join(sides) + " mm"
