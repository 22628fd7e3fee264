"""DICOM: a segmentation (SEG), contours (RTSTRUCT), or a folder with the slices of a series.

pydicom and highdicom (an extra) read the files; SimpleITK's GDCM allocates gigabytes for damaged lengths.
"""

import io
import os
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.cohort import dicom_files, dicom_segmentations, dicom_slices, is_dicom_seg
from homolog.errors import InputError, listed
from homolog.io.bounded import read_bytes
from homolog.io.volumes import Segment, Stored, Volume, check_size
from homolog.memory import OnDemand
from homolog.progress import Tick

__all__ = ["read_dicom", "read_series"]

_SHOWN = 3


def read_dicom(path: Path) -> Volume | None:
    """Read a DICOM SEG or RTSTRUCT, or a folder with one of them; None for a folder with slices only.

    Raises
    ------
    InputError
        If a package is missing, the file is neither, or the folder contains several.
    """
    files = dicom_files(path) if path.is_dir() else [path]
    segmentations = dicom_segmentations(files)
    if path.is_file() and not segmentations:
        raise InputError(
            f"{path}: is neither DICOM SEG nor RTSTRUCT; if it is one slice of a label map, give the folder "
            "of its series"
        )
    if len(segmentations) == 1 == len(files):
        read = read_seg if is_dicom_seg(segmentations[0]) else read_rtstruct
        return read(segmentations[0])
    if segmentations:
        names = listed([file.name for file in segmentations], _SHOWN)
        raise InputError(
            f"{path}: contains segmentations ({names}) among {len(files)} DICOM files; enter one of them in "
            "the column path of a table, or keep each segmentation in a folder of its own"
        )
    return None


@contextmanager
def dicom_faults(path: Path, kind: str) -> Iterator[None]:
    """Convert any exception into an InputError, and suppress other output.

    Both packages print file names and header values, which may identify a patient, to the standard error.

    Parameters
    ----------
    path : Path
    kind : str
        Expected kind of file, such as ``"DICOM SEG"``.
    """
    with redirect_stderr(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except (InputError, ModuleNotFoundError):
            raise
        except Exception as error:  # they raise many kinds of errors on bad files
            raise InputError(
                f"{path}: can't be read as {kind}; export it again ({_reason(error)})"
            ) from error


def _reason(error: Exception) -> str:
    if isinstance(error, AttributeError) and error.name:
        return f"it lacks {error.name}"
    return str(error).splitlines()[0] if str(error) else "it is damaged"


LARGEST = 256 * 2**20
_PREAMBLE, _GROUP_LENGTH = 132, 12  # bytes before the file's meta information


def unpacked(path: Path) -> str | BinaryIO:
    """Return a file's path, or the unpacked content of a deflated file (explicit, little-endian).

    Raises
    ------
    InputError
        If it unpacks to more than 256 MB.
    Exception
        Any error of pydicom on damaged files.
    """
    from pydicom.filebase import DicomBytesIO
    from pydicom.filereader import read_file_meta_info
    from pydicom.filewriter import write_file_meta_info
    from pydicom.uid import ExplicitVRLittleEndian

    meta = read_file_meta_info(path)
    if not meta.TransferSyntaxUID.is_deflated:
        return os.fspath(path)
    content = read_bytes(path, "DICOM file")
    start = _PREAMBLE + _GROUP_LENGTH + meta.FileMetaInformationGroupLength
    plain = zlib.decompressobj(-zlib.MAX_WBITS).decompress(content[start:], LARGEST + 1)
    if len(plain) > LARGEST:
        raise InputError(f"{path}: unpacks to more than 256 MB; export it without compression")
    stream = DicomBytesIO(content[:_PREAMBLE])
    stream.seek(_PREAMBLE)
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    write_file_meta_info(stream, meta)
    stream.write(plain)
    stream.seek(0)
    return stream.parent  # type: ignore[return-value]


_KIND = "a slice of a DICOM series"
_UNEVEN = 0.01  # tolerance of positions, as a fraction of the slice distance
_SPACINGS = ("PixelSpacing", "NominalScannedPixelSpacing", "ImagerPixelSpacing")
"""Attributes that give the pixel size, depending on the kind of image; the first one present is used."""


@dataclass(frozen=True, slots=True, eq=False)
class _Slice:
    """Header of a slice: series, size (columns, rows), position and axes [mm, LPS], slope and intercept."""

    path: Path
    series: str
    size: tuple[int, int]
    place: FloatArray
    axes: FloatArray
    scale: tuple[float, float]

    @property
    def height(self) -> float:
        """Position along the normal [mm]."""
        return float(np.cross(self.axes[0], self.axes[1]) @ self.place)


def read_series(folder: Path, tick: Tick) -> Stored:
    """Read the slices of one series, ordered by position, into one array of the files' type.

    Their values are scaled if their slopes and intercepts differ.

    Raises
    ------
    InputError
        If there are none or several series, slices are missing, not parallel, of several sizes or damaged.
    """
    files = dicom_slices(folder)
    slices = []
    for number, path in enumerate(files):
        tick(0.3 * number / len(files), f"reading {folder.name}")
        slices.append(_header(path))
    count = len({item.series for item in slices})
    if count != 1:
        raise InputError(
            f"{folder}: contains {count or 'no readable'} DICOM series; give each its own folder"
        )
    slices.sort(key=lambda item: item.height)
    step = _step(folder, slices)
    check_size(folder, (*slices[0].size, len(slices)), 4.0)
    scales = {item.scale for item in slices}
    slope, intercept = scales.pop() if len(scales) == 1 else (1.0, 0.0)
    first = _pixels(slices[0])
    kind = first.dtype if not scales else np.dtype(np.float64)
    values: Array = np.empty((*slices[0].size, len(slices)), kind, order="F")
    for number, item in enumerate(slices):
        tick(0.3 + 0.7 * number / len(slices), f"reading {folder.name}")
        pixels = _pixels(item) if number else first
        if not scales and pixels.dtype != values.dtype:
            values = values.astype(np.promote_types(values.dtype, pixels.dtype), order="F")
        values[..., number] = pixels * item.scale[0] + item.scale[1] if scales else pixels
    matrix = np.eye(4)
    matrix[:3, :2], matrix[:3, 2], matrix[:3, 3] = slices[0].axes.T, step, slices[0].place
    return Stored(values, matrix, slope, intercept)


def _header(path: Path) -> _Slice:
    with dicom_faults(path, _KIND):
        content = _read(path, without_pixels=True)
        if int(content.get("NumberOfFrames") or 1) > 1:
            raise ValueError("it has several frames")
        sizes = [content[name].value for name in _SPACINGS if name in content]
        if not sizes:
            raise ValueError(f"it lacks {_SPACINGS[0]}")
        spacing = np.array(sizes[0], np.float64)
        axes = np.array(content.ImageOrientationPatient, np.float64).reshape(2, 3)
        place = np.array(content.ImagePositionPatient, np.float64).reshape(3)
        axes = axes * spacing[::-1].reshape(2, 1)
        if not np.isfinite([*place, *axes.ravel()]).all() or spacing.min() <= 0.0:
            raise ValueError(f"its pixels are {spacing} mm large, at {place}")
        size = int(content.Columns), int(content.Rows)
        scale = float(content.get("RescaleSlope", 1)), float(content.get("RescaleIntercept", 0))
        return _Slice(path, str(content.SeriesInstanceUID), size, place, axes, scale)


def _read(path: Path, *, without_pixels: bool) -> Any:  # noqa: ANN401 - pydicom's datasets have any attribute
    import pydicom

    syntax = pydicom.filereader.read_file_meta_info(path).get("TransferSyntaxUID")
    if syntax is not None and syntax.is_deflated:
        raise InputError(f"{path}: uses deflate compression; export it without that")
    return pydicom.dcmread(path, stop_before_pixels=without_pixels)


def _step(folder: Path, slices: Sequence[_Slice]) -> FloatArray:
    """Return the step from slice to slice [mm]; refuse slices that are not parallel and evenly spaced."""
    alike = all(
        item.size == slices[0].size and np.allclose(item.axes, slices[0].axes, rtol=0.0, atol=1e-3)
        for item in slices
    )
    steps = np.diff([item.place for item in slices], axis=0) if len(slices) > 1 else np.zeros((1, 3))
    usual: FloatArray = np.median(steps, axis=0)
    length = float(np.linalg.norm(usual))
    if np.linalg.norm(steps, axis=1).min() <= _UNEVEN * length and len(slices) > 1:
        raise InputError(
            f"{folder}: several of its {len(slices)} slices have the same position (copies, or several time "
            "points); keep one at each position"
        )
    if not alike or not length > 0.0 or np.abs(steps - usual).max() > _UNEVEN * length:
        raise InputError(
            f"{folder}: its {len(slices)} slices are not equal in size, parallel and {length:.3g} mm apart "
            "throughout; copy the missing ones, or export a label map with evenly spaced slices"
        )
    whole: FloatArray = steps.mean(axis=0)  # the mean, since many files round positions
    return whole


def _pixels(_slice: _Slice) -> Array:
    """Return a slice's stored values by column and row."""
    with dicom_faults(_slice.path, _KIND):
        content = _read(_slice.path, without_pixels=False)
        values: Array = content.pixel_array
        if values.shape != _slice.size[::-1]:
            raise ValueError("it has several frames or colours")
        return values.T


_SEG_KIND = "DICOM SEG"
_EXTRA = 'DICOM SEG needs the package highdicom; install it: pip install "homolog[dicom]"'


_ROOM = ((1, 1), (0, 0), (0, 0))
"""Omitted frames are empty: an empty frame at either end shows that the structure is not cut off there."""


def read_seg(path: Path) -> Volume:
    """Read a segmentation object; its segments are layers, which may overlap.

    Raises
    ------
    InputError
        If the package is missing, or the file is damaged, too large or not a stack of slices.
    """
    try:
        from highdicom.seg import segread
    except ImportError as error:
        raise InputError(f"{path}: {_EXTRA}") from error
    with dicom_faults(path, _SEG_KIND):
        seg = segread(unpacked(path), lazy_frame_retrieval=True)
        if seg.BitsAllocated == 1 and seg.Rows * seg.Columns % 8 > 0:
            seg = segread(unpacked(path))  # highdicom's lazy reader cuts off frames that end within a byte
        if len(seg.PerFrameFunctionalGroupsSequence) != seg.get("NumberOfFrames", 1):
            raise InputError(f"{path}: describes more or fewer frames than it contains; export it again")
        numbers = [int(segment_number) for segment_number in seg.segment_numbers]
        names = [str(seg.get_segment_description(number).segment_label) for number in numbers]
        geometry = seg.get_volume_geometry(allow_missing_positions=True)
        if geometry is None:
            raise InputError(
                f"{path}: its frames are not a stack of parallel, evenly spaced slices; export it again"
            )
        check_size(path, geometry.spatial_shape, 8.0)
    named = tuple(Segment(name, 1, layer) for layer, name in enumerate(names))
    affine = np.array(geometry.affine, np.float64)
    affine[:3, 3] -= affine[:3, 0]

    def segment(layer: int) -> Array:
        with dicom_faults(path, _SEG_KIND):
            volume = seg.get_volume(segment_numbers=[numbers[layer]])
        return np.pad(np.asarray(volume.array)[..., 0], _ROOM)

    return Volume(path, OnDemand(len(numbers), lru_cache(maxsize=1)(segment)), affine, named)


_RTSTRUCT_KIND = "DICOM RTSTRUCT"
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

    with dicom_faults(path, _RTSTRUCT_KIND):
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
    layers = OnDemand(
        len(contours), lru_cache(maxsize=1)(lambda layer: grid.drawn(contours[layer]).view(np.uint8))
    )
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
