"""Label volumes in one frame (LPS, mm): which voxels are the structure, whatever file they came from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.memory import check_fits

__all__ = ["Segment", "Segmentation", "Volume", "check_size"]

_MASKS = 2
"""Bytes that each voxel takes beside its value while the structure is picked."""

_MOST_VALUES = 1000
"""With more different values than this, a file is a picture rather than a label map."""

_LOOKED_AT = 2_000_000

_ROUNDING = 1e-3
"""How far label values may be from whole numbers: what scaling and single precision leave."""


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """The voxels of one structure.

    Attributes
    ----------
    mask : (I, J, K) bool array
        True inside, read-only.
    rotation : (3, 3) float64 array
        Proper rotation; its columns are the directions of the three grid axes in LPS.
    spacing : (3,) float64 array
        Distance of neighbouring voxel centres along the grid axes [mm].
    origin : (3,) float64 array
        Centre of voxel (0, 0, 0) [mm, LPS].
    notes : tuple of str
        What the user should know of the file.
    name : str
        What the file calls the structure, if anything.
    """

    mask: BoolArray
    rotation: FloatArray
    spacing: FloatArray
    origin: FloatArray
    notes: tuple[str, ...] = ()
    name: str = ""

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "mask", frozen(self.mask, np.bool_))
        for name in ("rotation", "spacing", "origin"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def volume(self) -> float:
        """Volume of the voxels inside [mm³]."""
        return float(np.count_nonzero(self.mask) * self.spacing.prod())


@dataclass(frozen=True, slots=True)
class Segment:
    """A structure of a file: its name ("" if the file has none), and its value in one of the layers."""

    name: str
    value: int
    layer: int = 0

    @property
    def words(self) -> str:
        """How messages call it."""
        return f"{self.name} ({self.value})" if self.name else str(self.value)


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A file of labels.

    Attributes
    ----------
    path : Path
        For messages.
    layers : sequence of (I, J, K) arrays
        Label values; several where structures overlap. A layer may be read only when it is asked for.
    index_to_world : (4, 4) float64 array
        From voxel indices to LPS [mm].
    named : tuple of Segment
        The structures that the file names.
    notes : tuple of str
        What the user should know of the file.
    """

    path: Path
    layers: Sequence[Array]
    index_to_world: FloatArray
    named: tuple[Segment, ...] = ()
    notes: tuple[str, ...] = ()

    def segments(self) -> list[Segment]:
        """Return the structures that have voxels: those with names in the file's order, then other values."""
        known = {(one.layer, one.value): one for one in self.named}
        found = []
        for number in range(len(self.layers)):
            layer = self._labels(number)
            present = [Segment("", int(value), number) for value in np.unique(layer[layer > 0])]
            found += [known.get((number, one.value), one) for one in present]
        order = {one: index for index, one in enumerate(self.named)}
        return sorted(found, key=lambda one: (order.get(one, len(order)), one.value))

    def segmentation(self, label: int | None, segment: str | None = None) -> Segmentation:
        """Return the voxels of a structure.

        Parameters
        ----------
        label : int or None
            Its value; every value above 0 if neither value nor name are given.
        segment : str or None
            Its name, upper and lower case alike; goes before the value in files that name their segments.

        Raises
        ------
        InputError
            If there is no such structure, it has no voxels, more than one fits, or structures that overlap
            were to be taken together.
        """
        if segment is not None and (self.named or label is None):
            return self._one([one for one in self.named if _same(one.name, segment)], repr(segment))
        if label is not None:
            named = [one for one in self.named if one.value == label]
            return self._one(named or self._plain(label), f"label {label}")
        return self._placed(self._everything())

    def _plain(self, label: int) -> list[Segment]:
        return [Segment("", label)] if len(self.layers) == 1 else []

    def _one(self, found: Sequence[Segment], wanted: str) -> Segmentation:
        if len(found) > 1:
            raise InputError(
                f"{self.path}: {wanted} is {' and '.join(one.words for one in found)}; choose one by its "
                "name, and give each its own name"
            )
        for one in found:
            if (self._labels(one.layer) == one.value).any():
                return self.placed(one)
        listed = ", ".join(one.words for one in self.segments()[:10])
        remedy = f"it holds {listed}" if listed else "segment the structure or leave the subject out"
        raise InputError(f"{self.path}: has no voxel of {wanted}; {remedy}")

    def _everything(self) -> BoolArray:
        mask: BoolArray = np.array(False)
        overlap = False
        for number in range(len(self.layers)):
            layer = self._labels(number)
            _check_is_label_map(self.path, layer)
            overlap |= bool((mask & (layer > 0)).any())
            mask = mask | (layer > 0)
        if overlap:
            listed = ", ".join(one.words for one in self.segments())
            raise InputError(
                f"{self.path}: its segments overlap ({listed}), so that together they are no one structure; "
                "choose one by its name"
            )
        if not mask.any():
            raise InputError(
                f"{self.path}: has no voxel above 0; segment the structure or leave the subject out"
            )
        return mask

    def placed(self, segment: Segment) -> Segmentation:
        """Return the voxels of one of `segments`."""
        return self._placed(np.asarray(self._labels(segment.layer) == segment.value), segment.name)

    def _labels(self, number: int) -> Array:
        """Return the values of a layer, whole numbers; raises InputError if they are none."""
        values = self.layers[number]
        if not np.issubdtype(values.dtype, np.floating):
            return values
        if not np.isfinite(values).all():
            raise InputError(f"{self.path}: holds values that are not numbers; export the label map again")
        whole: Array = np.rint(values)
        if any(np.abs(one - other).max() > _ROUNDING for one, other in zip(values, whole, strict=True)):
            raise InputError(f"{self.path}: holds fractions, so it is no label map; threshold it first")
        return whole

    def _placed(self, mask: BoolArray, name: str = "") -> Segmentation:
        """Put the mask in its place, on right-handed axes."""
        axes, origin = self.index_to_world[:3, :3], self.index_to_world[:3, 3]
        spacing = np.linalg.norm(axes, axis=0)
        if not np.isfinite([*origin, *spacing]).all() or spacing.min() <= 0.0:
            raise InputError(f"{self.path}: has the spacing {spacing} and origin {origin}; mend the header")
        rotation = axes / spacing
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
            raise InputError(
                f"{self.path}: its axes are not at right angles; resample it to an orthogonal grid"
            )
        if np.linalg.det(rotation) < 0.0:
            mask = mask[::-1]
            origin = origin + axes[:, 0] * (len(mask) - 1)
            rotation = rotation * [-1.0, 1.0, 1.0]
        return Segmentation(mask, rotation, spacing, origin, self.notes, name)


def check_size(path: Path, shape: Sequence[int], voxel_bytes: float) -> None:
    """Refuse, by what the header says, what is no volume or too large for this machine.

    Raises
    ------
    InputError
        With the number of GB if memory would not do.
    """
    words = " x ".join(map(str, shape))
    if len(shape) != 3 or min(shape) < 2:
        raise InputError(f"{path}: is not a 3-D volume but {words}; export one label map per subject")
    needed = float(np.prod(shape, dtype=np.float64)) * (voxel_bytes + _MASKS)
    check_fits(f"{path} ({words} voxels)", needed, "crop it or make it coarser, or mend its header")


def _same(name: str, other: str) -> bool:
    return name.strip().casefold() == other.strip().casefold()


def _check_is_label_map(path: Path, values: Array) -> None:
    """Refuse a picture, whose voxels above 0 would be taken for the structure."""
    if values.min() < 0:
        raise InputError(
            f"{path}: holds values below 0, so it is a picture rather than a label map; segment the "
            "structure first, or name a label"
        )
    step = max(1, values.size // _LOOKED_AT)
    if len(np.unique(values.ravel(order="K")[::step])) > _MOST_VALUES:
        raise InputError(
            f"{path}: holds more than {_MOST_VALUES} different values, so it is a picture rather than a "
            "label map; segment the structure first, or name a label"
        )
