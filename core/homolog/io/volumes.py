"""Label volumes in one frame (LPS, mm), and the voxels of a structure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_fill_holes, generate_binary_structure

from homolog.arrays import Array, BoolArray, FloatArray, frozen
from homolog.cohort.subject import stem_of
from homolog.errors import InputError, listed
from homolog.io.label_names import label_table, matching, near, same_name, together
from homolog.io.values import (
    are_interpolated,
    counted,
    cropped,
    labels_apart,
    labels_from,
    labels_seen,
    sides_of,
)
from homolog.memory import check_fits
from homolog.settings import Values

__all__ = [
    "Extent",
    "Segment",
    "Segmentation",
    "Stored",
    "Volume",
    "check_size",
    "joined_names",
    "union_of",
]

_MASKS = 2
"""Additional bytes per voxel while the structure is extracted."""

_NAMED = 10
"""Largest number of structures in a message."""

_INTERPOLATED = "its labels pass through those between them at their edges, so they were interpolated"
_NEAREST = "resample the label map with nearest neighbour"


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """The voxels of one structure.

    Attributes
    ----------
    mask : (I, J, K) bool array
        True inside, read-only. Cropped to the structure and one voxel around it where the image extends
        beyond it: a structure at the border of the mask is at the border of the image.
    rotation : (3, 3) float64 array
        Proper rotation; its columns are the directions of the three grid axes in LPS.
    spacing : (3,) float64 array
        Distance of neighbouring voxel centres along the grid axes [mm].
    origin : (3,) float64 array
        Centre of voxel (0, 0, 0) [mm, LPS].
    notes : tuple of str
        Notes for the user.
    name : str
        Name of the structure in the file; may be empty.
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
    def title(self) -> str:
        """Name in messages."""
        return f"{self.name} ({self.value})" if self.name else str(self.value)


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """The voxels of a file as stored.

    Attributes
    ----------
    values : (I, J, K) or (I, J, K, C) array
        Of the file's type, and mapped from the file where its format allows.
    index_to_world : (4, 4) float64 array
        From voxel indices to LPS [mm].
    slope, intercept : float
        Value = slope * stored value + intercept.
    notes : tuple of str
        Notes for the user.
    named : tuple of Segment
        The structures that the file names.
    """

    values: Array
    index_to_world: FloatArray
    slope: float = 1.0
    intercept: float = 0.0
    notes: tuple[str, ...] = ()
    named: tuple[Segment, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A file of labels.

    Attributes
    ----------
    path : Path
        The file, for messages.
    layers : sequence of (I, J, K) arrays
        Label values; several layers if structures overlap. A layer may be read on access.
    index_to_world : (4, 4) float64 array
        From voxel indices to LPS [mm].
    named : tuple of Segment
        The structures that the file names.
    notes : tuple of str
        Notes for the user.
    unavailable : mapping of str to str
        Structures that the file names and that can't be read, each with the message that says why.
    declared : Values
        What the values of the layers are.
    """

    path: Path
    layers: Sequence[Array]
    index_to_world: FloatArray
    named: tuple[Segment, ...] = ()
    notes: tuple[str, ...] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)
    declared: Values = Values.LABELS

    def as_labels(self) -> "Volume":
        """Return the volume with labels, and a note if its values are others.

        Raises
        ------
        InputError
            If its values are not what they are declared to be.
        """
        if len(self.layers) > 1:
            return self
        labels, note = labels_from(self.path, self.layers[0], self.declared)
        if labels is self.layers[0]:
            return self
        notes = (*self.notes, note) if note else self.notes
        return replace(self, layers=[labels], notes=notes, declared=Values.LABELS)

    def segments(self) -> list[Segment]:
        """Return the structures that have voxels: named ones in the file's order, then other values."""
        return [extent.segment for extent in self.extents()]

    def extents(self) -> list["Extent"]:
        """Return the extents of the structures in `segments`, reading each layer once."""
        if (volume := self.as_labels()) is not self:
            return volume.extents()
        voxel = abs(float(np.linalg.det(self.index_to_world[:3, :3])))
        known = {(item.layer, item.value): item for item in self.named}
        contents = []
        for number in range(len(self.layers)):
            layer = self._labels(number)
            if not self.named:
                labels_seen(self.path, np.maximum(layer, 0))
            border = {value for side in sides_of(layer) for value in counted(side)}
            contents += [
                Extent(known.get((number, value), Segment("", value, number)), count * voxel, value in border)
                for value, count in sorted(counted(layer).items())
            ]
        order = {item: index for index, item in enumerate(self.named)}
        return sorted(contents, key=lambda item: (order.get(item.segment, len(order)), item.segment.value))

    def with_names(self, wanted: str | None = None) -> "Volume":
        """Return the volume with names from a table next to its file, or from a public list.

        It is unchanged if the file names its structures itself, or no names are known.

        Parameters
        ----------
        wanted : str, optional
            The structure that the user requests.

        Raises
        ------
        InputError
            If two tables next to the file contradict each other.
        """
        if self.named or len(self.layers) > 1:
            return self
        if (volume := self.as_labels()) is not self:
            return volume.with_names(wanted)
        table = label_table(self.path, counted(self._labels(0)), wanted)
        if table is None:
            return self
        named = tuple(Segment(name, value) for value, name in sorted(table.names.items()))
        if not table.is_known_list:
            return replace(self, named=named)
        note = (
            f"neither the file nor a table next to it names its labels; {table.source}'s numbers were taken"
        )
        return replace(self, named=named, notes=(*self.notes, note))

    @property
    def _has_names_of_its_own(self) -> bool:
        """Whether file or table name the structures; a public list also names rims of interpolated ones."""
        table = None if self.named else label_table(self.path, counted(self._labels(0)))
        return bool(self.named) or (table is not None and not table.is_known_list)

    def segmentation(self, label: int | None, segment: str | None = None) -> Segmentation:
        """Return the voxels of a structure.

        Parameters
        ----------
        label : int or None
            Value of the structure; every value above 0 if neither value nor name is given.
        segment : str or None
            Name of the structure; case, dashes and order of words are ignored. It has precedence over the
            value if the structures have names, from the file, a table next to it, or the public list that it
            follows. A single structure may have the name of its file.

        Raises
        ------
        InputError
            If there is no such structure, it has no voxels, the name is ambiguous, or overlapping structures
            would be combined.

        Notes
        -----
        ``2+3`` or ``wall+cavity`` are these structures together.
        """
        if (volume := self.as_labels()) is not self:
            return volume.segmentation(label, segment)
        if (names := joined_names(segment)) and not matching(
            ((item.name, item) for item in self.with_names(segment).named), str(segment)
        ):
            parts = [
                self.segmentation(int(name) if name.isdecimal() else None, None if name.isdecimal() else name)
                for name in names
            ]
            return union_of(parts, self.path)
        if segment is not None and not self.named and len(self.layers) == 1:
            named = self.with_names(segment)
            if named.named:
                return named.segmentation(label, segment)
            if same_name(stem_of(self.path), segment) and len(self.segments()) <= 1:
                return self._everything()
        if segment is not None and (self.named or label is None):
            return self._one(
                matching(((item.name, item) for item in self.named), segment), repr(segment), segment
            )
        if label is not None:
            same = [item for item in self.named if item.value == label]
            plain = [Segment("", label)] if len(self.layers) == 1 else []
            return self._one(same or plain, f"label {label}")
        return self._everything()

    def _one(self, segments: Sequence[Segment], wanted: str, name: str = "") -> Segmentation:
        if len(segments) > 1:
            raise InputError(
                f"{self.path}: {wanted} matches {' and '.join(self._titles(segments))}; choose one by its "
                "name or number, and give each its own name"
            )
        for item in segments:
            if (voxels := self.placed(item)) is not None:
                return voxels
        if name and (faults := matching(self.unavailable.items(), name)):
            raise InputError(faults[0])
        lacks = "has no voxel of" if segments or not name else "has no structure named"
        raise InputError(f"{self.path}: {lacks} {wanted}; {self._alternatives(name)}")

    def _alternatives(self, name: str) -> str:
        """Return similar names of a missing structure, and the content of the file."""
        if not (there := self.segments()):
            return "segment the structure or exclude the subject"
        alike = near([item.name for item in there], name) if name else []
        nearest = f"similar names: {', '.join(alike)}; " if alike else ""
        nameless = name and not any(item.name for item in there)
        remedy = "; put a table of the labels' names next to the files, or give a number" if nameless else ""
        return f"{nearest}it contains {listed(self._titles(there), _NAMED)}{remedy}"

    def _everything(self) -> Segmentation:
        notes = (*self.notes, *(fault.removeprefix(f"{self.path}: ") for fault in self.unavailable.values()))
        if len(self.layers) == 1:
            layer = self._labels(0)
            several = labels_seen(self.path, layer) > 1
            crop = cropped(layer, lambda values: values > 0)
        else:
            several = True
            crop = cropped(self._union(), lambda values: values)
        if crop is None:
            raise InputError(
                f"{self.path}: has no voxel above 0; segment the structure or exclude the subject"
            )
        if several and len(self.layers) == 1:
            mask, start = crop
            box = tuple(slice(low, low + size) for low, size in zip(start, mask.shape, strict=True))
            if not self._has_names_of_its_own and are_interpolated(layer[box]):
                raise InputError(
                    f"{self.path}: {_INTERPOLATED}, or it is a soft mask; {_NEAREST}, declare the "
                    "latter (values: probability), or name real layers in a table next to the file"
                )
            self._check_together(labels_apart(layer[box]))
        placed = self._placed(*crop)  # refuses impossible matrices
        if several:
            labels = [(item.value, item.name) for item in self.segments()]
            notes = (*notes, together(self.path, labels, numbered=self._is_numbered))
        return replace(placed, notes=notes)

    def _check_together(self, apart: list[int]) -> None:
        if not apart:
            return
        names = {item.value: item.name for item in self.with_names().named}
        called = [names.get(value) or str(value) for value in apart]
        raise InputError(
            f"{self.path}: its labels are structures that do not touch; choose one (label: {called[0]}), or "
            f"run a batch of all; available: {listed(called, _NAMED)}"
        )

    def _union(self) -> BoolArray:
        mask: BoolArray = np.array(False)
        overlap = False
        for number in range(len(self.layers)):
            layer = self._labels(number)
            labels_seen(self.path, layer)
            overlap |= bool((mask & (layer > 0)).any())
            mask = mask | (layer > 0)
        if overlap:
            names = ", ".join(self._titles(self.segments()))
            raise InputError(
                f"{self.path}: its segments overlap ({names}), so that they are not one structure; "
                "choose one by its name"
            )
        return mask

    def placed(self, segment: Segment) -> Segmentation | None:
        """Return the voxels of a structure; None if there are none."""
        layer = self._labels(segment.layer)
        crop = cropped(layer, lambda values: values == segment.value)
        if crop is None:
            return None
        mask, start = crop
        around = layer[tuple(slice(low, low + size) for low, size in zip(start, mask.shape, strict=True))]
        placed = self._placed(mask, start, segment.name)
        if ((around == 0) | (around == segment.value)).all() or not are_interpolated(around):
            return placed
        return replace(placed, notes=(*placed.notes, f"{_INTERPOLATED}; {_NEAREST}"))

    def _labels(self, number: int) -> Array:
        """Return the whole-number values of a layer; raises InputError for other values."""
        return labels_from(self.path, self.layers[number], self.declared)[0]

    def _titles(self, segments: Sequence[Segment]) -> list[str]:
        """Return names for messages, with the values where these differ."""
        return [item.title if self._is_numbered else item.name for item in segments]

    @property
    def _is_numbered(self) -> bool:
        return len(self.named) < 2 or len({item.value for item in self.named}) > 1

    def _placed(self, mask: BoolArray, start: Sequence[int], name: str = "") -> Segmentation:
        """Return a mask that begins at a voxel of the file with its position, on right-handed axes."""
        axes, origin = self.index_to_world[:3, :3], self.index_to_world[:3, 3]
        spacing = np.linalg.norm(axes, axis=0)
        if not np.isfinite([*origin, *spacing]).all() or spacing.min() <= 0.0:
            raise InputError(
                f"{self.path}: has the spacing {spacing} and origin {origin}; correct the header"
            )
        rotation = axes / spacing
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
            raise InputError(
                f"{self.path}: its axes are not at right angles; resample it to an orthogonal grid"
            )
        origin = origin + axes @ np.asarray(start, np.float64)
        if np.linalg.det(rotation) < 0.0:
            mask = mask[::-1]
            origin = origin + axes[:, 0] * (len(mask) - 1)
            rotation = rotation * [-1.0, 1.0, 1.0]
        return Segmentation(mask, rotation, spacing, origin, self.notes, name)


def joined_names(segment: str | None) -> list[str]:
    """Return the names of several structures that are requested together; none for a single one."""
    names = [name.strip() for name in (segment or "").split("+")]
    return names if len(names) > 1 and all(names) else []


def cavity_of(wall: Segmentation, path: Path) -> Segmentation:
    """Return the voxels that a wall encloses within slices, along the axis along which these are most.

    A closed wall encloses its cavity in the slices of every axis, one that is open at an end, as the
    myocardium at its base, in those across its length.

    Raises
    ------
    InputError
        If it encloses none.
    """
    cavities = []
    for axis in range(3):
        plane = np.ones((3, 3, 3), np.bool_)
        plane.swapaxes(0, axis)[[0, 2]] = False
        plane &= generate_binary_structure(3, 1)
        cavities.append(binary_fill_holes(wall.mask, plane) & ~wall.mask)
    mask = max(cavities, key=np.count_nonzero)
    if not mask.any():
        raise InputError(f"{path}: the wall encloses no voxel in any slice; check that it is a wall")
    return replace(wall, mask=mask)


def union_of(parts: Sequence[Segmentation], path: Path) -> Segmentation:
    """Return the voxels of several structures of one grid together.

    Raises
    ------
    InputError
        If their grids differ.
    """
    first = parts[0]
    starts = [(item.origin - first.origin) @ first.rotation / first.spacing for item in parts]
    begins = np.rint(starts).astype(int)
    for item, start, begin in zip(parts, starts, begins, strict=True):
        if not (
            np.allclose(item.rotation, first.rotation, atol=1e-4)
            and np.allclose(item.spacing, first.spacing, rtol=1e-4)
            and np.allclose(start, begin, atol=1e-2)
        ):
            raise InputError(
                f"{path}: the structures to be joined are on different grids; resample them to one"
            )
    low = begins.min(axis=0)
    ends = [begin + item.mask.shape for begin, item in zip(begins, parts, strict=True)]
    mask = np.zeros(np.max(ends, axis=0) - low, np.bool_)
    for begin, item in zip(begins - low, parts, strict=True):
        mask[tuple(slice(a, a + size) for a, size in zip(begin, item.mask.shape, strict=True))] |= item.mask
    origin = first.origin + first.rotation @ (low * first.spacing)
    return replace(
        first, mask=mask, origin=origin, notes=tuple(dict.fromkeys(n for p in parts for n in p.notes))
    )


@dataclass(frozen=True, slots=True)
class Extent:
    """Extent of a structure in a file: its volume [mm³], and whether it touches the border."""

    segment: Segment
    volume: float
    at_border: bool


def check_size(path: Path, shape: Sequence[int], voxel_bytes: float) -> None:
    """Refuse a file whose header describes no volume, or one too large for this machine.

    Raises
    ------
    InputError
        With the required GB if memory is insufficient.
    """
    size = " x ".join(map(str, shape))
    if len(shape) != 3 or min(shape) < 2:
        raise InputError(f"{path}: is not a 3-D volume but {size}; export one label map per subject")
    needed = float(np.prod(shape, dtype=np.float64)) * (voxel_bytes + _MASKS)
    check_fits(f"{path} ({size} voxels)", needed, "crop or resample it, or correct its header")
