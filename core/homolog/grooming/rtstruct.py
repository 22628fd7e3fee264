"""Contours of radiotherapy structures (DICOM RTSTRUCT), drawn into a grid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.errors import InputError
from homolog.grooming.dicom_faults import dicom_faults
from homolog.grooming.layers import Layers
from homolog.grooming.volumes import Segment, Volume, check_size

__all__ = ["read_rtstruct"]

_KIND = "DICOM RTSTRUCT"
_CLOSED = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
_REMEDY = "save the structure as a label map, for example as .seg.nrrd in 3D Slicer"
_FLAT = 0.2
"""Largest extent of a contour across its plane [mm]."""
_SAME_PLANE = 0.02
"""Contours at most this far apart are in one slice [mm]."""
_OFF_GRID = 0.1
"""Largest deviation of a slice from even spacing, relative to it."""
_FINEST, _COARSEST = 0.5, 1.0
"""Limits of the pixel size [mm]; in between, it is the typical distance of a contour's points."""
_MARGIN = 2
"""Empty pixels around the contours."""

_Contours = Sequence[FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """Slices in parallel planes. Columns of `rotation` are the axes; the rest is along these axes [mm]."""

    rotation: FloatArray
    origin: FloatArray
    spacing: FloatArray
    shape: tuple[int, int, int]

    @property
    def index_to_world(self) -> FloatArray:
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation * self.spacing
        matrix[:3, 3] = self.rotation @ self.origin
        return matrix

    def drawn(self, contours: _Contours) -> BoolArray:
        """Return the voxels inside; a contour within another one is a hole."""
        mask = np.zeros(self.shape, np.bool_)
        for contour in _without_copies(contours):
            at = (contour @ self.rotation - self.origin) / self.spacing
            mask[:, :, round(float(at[:, 2].mean()))] ^= _filled(at[:, :2], self.shape[:2])
        return mask


def read_rtstruct(path: Path) -> Volume:
    """Read the closed contours of radiotherapy structures; structures are layers, which may overlap.

    Points and open contours are ignored. Contours are drawn into slices at their own distance; missing slices
    are left to grooming.

    Raises
    ------
    InputError
        If the file is damaged or contains no closed contours, or its contours are not in
        parallel, evenly spaced planes.
    """
    import pydicom

    with dicom_faults(path, _KIND):
        structures = _structures(pydicom.dcmread(path))
    if not structures:
        raise InputError(f"{path}: contains no closed contours; export the structures again")
    grid = _grid_of(path, structures)
    named = tuple(Segment(name, 1, layer) for layer, name in enumerate(structures))
    x, y, z = grid.spacing
    note = f"contours were drawn into a grid of {x:.3g} x {y:.3g} x {z:.3g} mm"
    contours = list(structures.values())
    layers = Layers(len(contours), lambda layer: grid.drawn(contours[layer]).view(np.uint8))
    return Volume(path, layers, grid.index_to_world, named, (note,))


def _structures(content: Any) -> dict[str, list[FloatArray]]:  # noqa: ANN401 - pydicom's
    """Return the closed contours of each structure by name, in LPS [mm]."""
    names = {int(item.ROINumber): str(item.ROIName).strip() for item in content.StructureSetROISequence}
    result: dict[str, list[FloatArray]] = {}
    for item in content.get("ROIContourSequence", []):
        closed = [
            _points(contour)
            for contour in item.get("ContourSequence", [])
            if contour.get("ContourGeometricType") in _CLOSED and int(contour.NumberOfContourPoints) > 2
        ]
        if closed:
            number = int(item.ReferencedROINumber)
            result.setdefault(names.get(number) or f"ROI {number}", []).extend(closed)
    return result


def _points(contour: Any) -> FloatArray:  # noqa: ANN401 - pydicom's
    """Return a contour's points, parsed at once: pydicom's own parser takes minutes for large files."""
    text = contour.get_item("ContourData").value
    points = np.array(text.split(b"\\") if isinstance(text, bytes) else text, np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("a contour has points without a position")
    return points


def _grid_of(path: Path, structures: Mapping[str, Sequence[FloatArray]]) -> _Grid:
    contours = [contour for item in structures.values() for contour in item]
    rotation = _axes(max(map(_normal, contours), key=lambda normal: float(normal @ normal)))
    turned = [contour @ rotation for contour in contours]
    names = [name for name, item in structures.items() for _ in item]
    for name, contour in zip(names, turned, strict=True):
        if np.ptp(contour[:, 2]) > _FLAT:
            raise InputError(
                f"{path}: the contours of {name} are not in planes parallel to others; {_REMEDY}"
            )
    first, distance, count = _slices(path, np.array([contour[:, 2].mean() for contour in turned]))
    edges = np.concatenate([np.linalg.norm(np.diff(contour[:, :2], axis=0), axis=1) for contour in turned])
    edges = edges[edges > 0.0]
    pixel = float(np.clip(np.median(edges) if edges.size else _COARSEST, _FINEST, _COARSEST))
    every = np.concatenate(turned)[:, :2]
    low, extent = every.min(axis=0), np.ptp(every, axis=0) / pixel
    room = 2 * (_MARGIN + 1)
    shape = (
        int(extent[0]) + room,
        int(extent[1]) + room,
        count + 2,
    )  # an empty slice at either end: structures are not cut off there
    check_size(path, shape, 2.0)
    origin = np.array([*(low - _MARGIN * pixel), first - distance])
    return _Grid(rotation, origin, np.array([pixel, pixel, distance]), shape)


def _normal(contour: FloatArray) -> FloatArray:
    """Return a contour's normal, as long as twice its area (Newell)."""
    centred = contour - contour.mean(axis=0)
    normal: FloatArray = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    return normal


def _axes(normal: FloatArray) -> FloatArray:
    """Return the rotation whose last column is a normal and whose others are near to the patient's axes."""
    third = normal / max(float(np.linalg.norm(normal)), np.finfo(np.float64).tiny)
    main = int(np.argmax(np.abs(third)))
    third = third * np.sign(third[main])
    if abs(third[main]) > 1.0 - 1e-6:
        third = np.eye(3)[main]
    first = np.eye(3)[(main + 1) % 3]
    first = first - (first @ third) * third
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)


def _slices(path: Path, places: FloatArray) -> tuple[float, float, int]:
    """Return the place of the first slice, the distance of slices [mm], and their number."""
    ordered = np.sort(places)
    planes = ordered[np.concatenate([[True], np.diff(ordered) > _SAME_PLANE])]
    gaps = np.diff(planes)
    if not gaps.size:
        raise InputError(f"{path}: all contours are in one plane; export the whole structures")
    for distance in (float(np.median(gaps)), float(gaps.min())):
        steps = np.round((planes - planes[0]) / distance)
        off = np.abs(planes - planes[0] - steps * distance).max()
        if off <= _OFF_GRID * distance and (np.diff(steps) > 0).all():
            return float(planes[0]), float((planes[-1] - planes[0]) / steps[-1]), int(steps[-1]) + 1
    apart = f"{gaps.min():.3g} to {gaps.max():.3g} mm"
    raise InputError(f"{path}: its contours are in unevenly spaced planes ({apart} apart); {_REMEDY}")


def _filled(polygon: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """Return the pixels (X, Y) inside a polygon (V, 2): each side toggles those beyond it."""
    sides = np.stack([polygon, np.roll(polygon, -1, axis=0)], axis=1)
    ends = np.sort(np.ceil(sides[:, :, 0]).astype(np.intp), axis=1)  # each row is crossed once: half-open
    counts = ends[:, 1] - ends[:, 0]
    side = np.repeat(np.arange(len(sides)), counts)
    rows = np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts) + ends[side, 0]
    (x, y), (to_x, to_y) = sides[side, 0].T, sides[side, 1].T
    crossed = np.ceil(y + (rows - x) / (to_x - x) * (to_y - y)).astype(np.intp)
    toggles = np.bincount(rows * shape[1] + crossed, minlength=shape[0] * shape[1]).reshape(shape)
    inside: BoolArray = np.bitwise_xor.accumulate(toggles & 1, axis=1).astype(np.bool_)
    return inside


def _without_copies(contours: _Contours) -> list[FloatArray]:
    """Return contours without repeated ones, which would be holes."""
    return list({contour.tobytes(): contour for contour in contours}.values())
