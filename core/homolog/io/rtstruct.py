"""Contours of radiotherapy structures (DICOM RTSTRUCT), drawn into a grid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.errors import InputError
from homolog.io.dicom_faults import dicom_faults
from homolog.io.layers import Layers
from homolog.io.volumes import Segment, Volume, check_size

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
_FINER = 0.45
"""Least distance of common slices, relative to that of each structure's own."""
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
    are left to grooming. A structure that is not in the planes of most others is not available.

    Raises
    ------
    InputError
        If the file is damaged or contains no closed contours, or no structure is in parallel, evenly spaced
        planes.
    """
    import pydicom

    with dicom_faults(path, _KIND):
        structures = _structures(pydicom.dcmread(path))
    if not structures:
        raise InputError(f"{path}: contains no closed contours; export the structures again")
    rotation, unavailable = _common_planes(path, structures)
    drawn = {name: item for name, item in structures.items() if name not in unavailable}
    if not drawn:
        raise InputError(next(iter(unavailable.values())))
    grid = _grid_of(path, rotation, list(chain.from_iterable(drawn.values())))
    named = tuple(Segment(name, 1, layer) for layer, name in enumerate(drawn))
    x, y, z = grid.spacing
    note = f"contours were drawn into a grid of {x:.3g} x {y:.3g} x {z:.3g} mm"
    contours = list(drawn.values())
    layers = Layers(len(contours), lambda layer: grid.drawn(contours[layer]).view(np.uint8))
    return Volume(path, layers, grid.index_to_world, named, (note,), unavailable)


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


def _common_planes(
    path: Path, structures: Mapping[str, Sequence[FloatArray]]
) -> tuple[FloatArray, dict[str, str]]:
    """Return the axes of most structures, and why others are not in slices of these, by name."""
    normals = {
        name: max(map(_normal, item), key=lambda normal: float(normal @ normal))
        for name, item in structures.items()
    }
    rotations = {axes.tobytes(): axes for axes in map(_axes, normals.values())}  # mostly one
    flat = {key: _flat(axes, structures) for key, axes in rotations.items()}
    largest = max(normals.values(), key=lambda normal: float(normal @ normal))
    rotation = max(
        rotations.values(),
        key=lambda axes: (len(flat[axes.tobytes()]), float(np.abs(largest @ axes[:, 2]))),
    )
    places = {
        name: _planes(np.array([(contour @ rotation)[:, 2].mean() for contour in structures[name]]))
        for name in flat[rotation.tobytes()]
    }
    unavailable = {
        name: f"{path}: the contours of {name} are not in planes parallel to others; {_REMEDY}"
        for name in structures
        if name not in places
    }
    distances = dict[str, float]()
    for name, own in places.items():
        try:
            distances[name] = _slices(path, own, name)[1] if len(own) > 1 else np.inf
        except InputError as error:
            unavailable[name] = str(error)
    fitting = max(
        (_fitting(path, name, places, distances) for name in distances),
        key=lambda names: sum(len(places[name]) for name in names),
        default=[],
    )
    for name in distances.keys() - fitting:
        unavailable[name] = f"{path}: the contours of {name} are not in the slices of others; {_REMEDY}"
    return rotation, {name: unavailable[name] for name in structures if name in unavailable}


def _flat(rotation: FloatArray, structures: Mapping[str, Sequence[FloatArray]]) -> list[str]:
    """Return the structures whose contours are in planes across the third axis."""
    return [
        name
        for name, item in structures.items()
        if all(np.ptp((contour @ rotation)[:, 2]) <= _FLAT for contour in item)
    ]


def _fitting(
    path: Path, first: str, places: Mapping[str, FloatArray], distances: Mapping[str, float]
) -> list[str]:
    """Return the structures that have evenly spaced slices in common with one of them."""
    fitting, every = [first], places[first]
    for name in distances:
        together = _planes(np.concatenate([every, places[name]]))
        finest = min(distances[item] for item in (*fitting, name))
        try:
            distance = _slices(path, together)[1]
        except InputError:
            continue
        if name != first and (distance >= _FINER * finest or finest == np.inf):
            fitting.append(name)
            every = together
    return fitting


def _grid_of(path: Path, rotation: FloatArray, contours: _Contours) -> _Grid:
    turned = [contour @ rotation for contour in contours]
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


def _slices(path: Path, places: FloatArray, name: str = "") -> tuple[float, float, int]:
    """Return the place of the first slice, the distance of slices [mm], and their number.

    Raises
    ------
    InputError
        If slices are not evenly spaced, or there is only one; the message names the structure.
    """
    whose = f"the contours of {name}" if name else "its contours"
    planes = _planes(places)
    gaps = np.diff(planes)
    if not gaps.size:
        raise InputError(f"{path}: all contours are in one plane; export the whole structures")
    for distance in (float(np.median(gaps)), float(gaps.min())):
        steps = np.round((planes - planes[0]) / distance)
        off = np.abs(planes - planes[0] - steps * distance).max()
        if off <= _OFF_GRID * distance and (np.diff(steps) > 0).all():
            return float(planes[0]), float((planes[-1] - planes[0]) / steps[-1]), int(steps[-1]) + 1
    apart = f"{gaps.min():.3g} to {gaps.max():.3g} mm"
    raise InputError(f"{path}: {whose} are in unevenly spaced planes ({apart} apart); {_REMEDY}")


def _planes(places: FloatArray) -> FloatArray:
    """Return places in order, one for each plane."""
    ordered = np.sort(places)
    planes: FloatArray = ordered[np.concatenate([[True], np.diff(ordered) > _SAME_PLANE])]
    return planes


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
