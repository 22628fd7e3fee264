"""NIfTI volumes in one file or two, Analyze's, and FreeSurfer's MGH and MGZ, through nibabel."""

import gzip
import html
import io
import logging
import math
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
from nibabel.filebasedimages import ImageFileError
from nibabel.freesurfer.mghformat import MGHHeader
from nibabel.imageglobals import ErrorLevel, logger
from nibabel.nifti1 import Nifti1PairHeader
from nibabel.spatialimages import HeaderDataError
from nibabel.spm99analyze import Spm99AnalyzeHeader
from nibabel.wrapstruct import WrapStructError

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.values import labels_of_channels
from homolog.io.volumes import Segment, StoredScan, Volume, check_size
from homolog.progress import Tick, no_tick

__all__ = [
    "read_mgh",
    "read_mgh_scan",
    "read_nifti",
    "read_nifti_scan",
    "read_pair",
    "read_pair_scan",
    "stored_values",
    "voxels_in_memory",
]

logger.setLevel(logging.CRITICAL + 1)  # faults that nibabel logs are reported as InputError

_TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
_UNITS = {"meter": 1000.0, "mm": 1.0, "micron": 0.001, "unknown": 1.0}
_NO_PLACE = "its header gives no patient orientation (no qform or sform); RAS axes were assumed"
_SIZES_OF_SFORM = "its voxel sizes are zero or negative; those of its sform were used"
_HEADER, _FARTHEST, _PART = 348, 2**28, 2**22  # bytes
_MGH_HEADER = 284
_NO_MGH_PLACE = "its header gives no patient orientation; FreeSurfer's coronal axes were assumed"
_NAMED = re.compile(
    r"""<Label\s[^>]*?\bKey=["'](\d{1,9})["'][^>]*>\s*(?:<!\[CDATA\[(.{1,200}?)\]\]>|([^<]{1,200}))""",
    re.DOTALL,
)
"""An entry of the label table that TotalSegmentator and Connectome Workbench write into an extension."""
_GZIP = b"\x1f\x8b"
_NIFTI_2 = (b"\x1c\x02", b"\x02\x1c")
"""First bytes of a header of 540 bytes."""
DUBIOUS = 30  # nibabel's level of sizes of zero or below and of unknown codes
_FAULTS = (
    ImageFileError,
    HeaderDataError,
    WrapStructError,
    OSError,
    EOFError,
    zlib.error,
    ValueError,
    OverflowError,
)
_AGREE = 0.1  # voxels: larger differences of qform and sform are not due to rounding
_SCANNER = 1
_FRAMES = {_SCANNER: "scanner", 2: "aligned", 3: "Talairach", 4: "MNI", 5: "template"}


def read_nifti(path: Path) -> Volume:
    """Read a NIfTI file.

    Parameters
    ----------
    path : Path
        File that ends in .nii or .nii.gz.

    Raises
    ------
    InputError
        If it can't be read, is not a 3-D volume of single numbers, is too large, or if qform and sform
        contradict each other in left and right.
    """
    image, shape, matrix, notes = _nifti_header(path, channels=True)
    kind, proxy = image.header.get_data_dtype(), image.dataobj
    begin = int(proxy.offset)
    content = _content(path, begin, begin + math.prod(shape) * kind.itemsize)
    try:
        values: Array
        if (proxy.slope, proxy.inter) != (1.0, 0.0):
            values = np.asanyarray(type(image).from_bytes(content).dataobj).reshape(shape)
        else:
            values = np.frombuffer(content, kind, math.prod(shape), begin)
            values = values.astype(kind.newbyteorder("="), copy=False).reshape(shape, order="F")
    except (*_FAULTS, MemoryError) as error:
        raise InputError(
            f"{path}: is cut short or damaged; copy or export it again ({_first_line(error)})"
        ) from error
    if len(shape) > 3:
        values, note = labels_of_channels(path, values)
        notes = (*notes, note)
    return Volume(path, [values], matrix, _named(image.header), notes)


def voxels_in_memory(image: Any) -> tuple[Array, FloatArray]:  # noqa: ANN401 - half of nibabel is untyped
    """Return the voxels of one of nibabel's images, (I, J, K), and the matrix from indices to LPS [mm]."""
    values = np.asanyarray(image.dataobj)
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    units = getattr(image.header, "get_xyzt_units", lambda: ("mm",))()[0]
    scale = np.diag([*3 * [_UNITS.get(units, 1.0)], 1.0])
    return values, _TO_LPS @ scale @ np.asarray(image.affine, np.float64)


def read_nifti_scan(path: Path, tick: Tick) -> StoredScan:
    """Read a NIfTI file of grey values as stored; see `homolog.io.scans.Scan`."""
    image, shape, matrix, notes = _nifti_header(path)
    proxy = image.dataobj
    values = stored_values(path, int(proxy.offset), shape, image.header.get_data_dtype(), tick)
    return values, matrix, float(proxy.slope), float(proxy.inter), notes


def _nifti_header(
    path: Path, *, channels: bool = False
) -> tuple[Any, list[int], FloatArray, tuple[str, ...]]:
    """Return nibabel's image, unread; its size (with channels, if wanted), matrix to LPS and notes."""
    try:
        image, sizes = _opened(path)
    except _FAULTS as error:
        raise InputError(
            f"{path}: is not a readable image; export it again, or exclude it ({_first_line(error)})"
        ) from error
    if not isinstance(image, nibabel.Nifti1Image):
        raise InputError(f"{path}: is not a NIfTI file, although its name says so; rename or export it")
    header: Any = image.header
    shape = list(image.shape)
    while len(shape) > 3 and shape[-1] == 1:
        shape.pop()
    if len(shape) == 5 and shape[3] == 1:  # vectors, as ITK stores them
        del shape[3]
    kind = header.get_data_dtype()
    if kind.fields is not None:
        raise InputError(f"{path}: has colours instead of single numbers; export a label map")
    if kind.kind not in "iuf":
        raise InputError(f"{path}: has {kind} voxels instead of single numbers; export a label map")
    count = shape[3] if channels and len(shape) == 4 else 1
    proxy: Any = image.dataobj
    scaled = (proxy.slope, proxy.inter) != (1.0, 0.0)
    check_size(
        path, shape[:3] if count > 1 else shape, count * (kind.itemsize + (8.0 if scaled else kind.itemsize))
    )
    matrix, notes = placement(path, header, shape[:3])
    notes = (*sizes, *notes, *_misnamed(path))
    return image, shape, _TO_LPS @ matrix, notes


def _named(header: Any) -> tuple[Segment, ...]:  # noqa: ANN401 - half of nibabel is untyped
    """Return the structures that an extension of the header names."""
    names: dict[int, str] = {}
    for extension in header.extensions:
        if b"<LabelTable" in extension.content:
            for item in _NAMED.finditer(extension.content.decode("utf-8", "replace")):
                names.setdefault(int(item[1]), html.unescape(item[3] or "") or item[2] or "")
    return tuple(Segment(name.strip(), value) for value, name in names.items() if value > 0 and name.strip())


def read_mgh(path: Path) -> Volume:
    """Read a volume of FreeSurfer's, compressed (.mgz) or not (.mgh).

    Raises
    ------
    InputError
        If it can't be read, is cut short, not a 3-D volume, or too large.
    """
    shape, kind, matrix, notes = _mgh_header(path)
    size = math.prod(shape) * kind.itemsize
    content = _unpacked(path, _MGH_HEADER + size)
    if len(content) < _MGH_HEADER + size:
        raise InputError(
            f"{path}: is cut short ({len(content)} of {_MGH_HEADER + size} bytes); copy or export it again"
        )
    values = np.frombuffer(content, kind, offset=_MGH_HEADER).astype(kind.newbyteorder("="))
    return Volume(path, [values.reshape(shape, order="F")], matrix, notes=notes)


def read_mgh_scan(path: Path, tick: Tick) -> StoredScan:
    """Read FreeSurfer's grey values as stored; see `homolog.io.scans.Scan`."""
    shape, kind, matrix, notes = _mgh_header(path)
    return stored_values(path, _MGH_HEADER, shape, kind, tick, to_end=False), matrix, 1.0, 0.0, notes


def _mgh_header(path: Path) -> tuple[list[int], np.dtype[Any], FloatArray, tuple[str, ...]]:
    """Return the size of an MGH volume, the type of its voxels, its matrix to LPS, and notes."""
    begin = _unpacked(path, _MGH_HEADER)
    if len(begin) < _MGH_HEADER:
        raise InputError(f"{path}: is cut short ({len(begin)} bytes); copy or export it again")
    try:
        header: Any = MGHHeader(begin)  # type: ignore[no-untyped-call]
        shape, kind = list(header.get_data_shape()), header.get_data_dtype()
        matrix = np.asarray(header.get_affine(), np.float64)
    except (*_FAULTS, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: is not a readable image; export it again, or exclude it ({_first_line(error)})"
        ) from error
    while len(shape) > 3 and shape[-1] == 1:
        shape.pop()
    check_size(path, shape, kind.itemsize * 2)
    placed = int.from_bytes(begin[28:30], "big") > 0
    notes = () if placed else (_NO_MGH_PLACE,)
    return shape, kind, _TO_LPS @ matrix, (*notes, *_misnamed(path))


def stored_values(
    path: Path, begin: int, shape: Sequence[int], kind: np.dtype[Any], tick: Tick, *, to_end: bool = True
) -> Array:
    """Return a file's voxels as stored: memory-mapped, or unpacked in parts into one array.

    With `to_end`, data after the voxels are an error.
    """
    if not 0 <= begin <= _FARTHEST:
        raise InputError(f"{path}: its header says that voxels begin at byte {begin}; export it again")
    count = math.prod(shape)
    size = count * kind.itemsize
    cut = f"{path}: is cut short, or contains more voxels than its header declares; copy or export it again"
    if not _is_packed(path):
        there = path.stat().st_size - begin
        if there < size or (to_end and there > size):
            raise InputError(f"{cut} ({there} of {size} bytes)")
        return np.memmap(path, kind, "r", begin, tuple(shape), "F")
    values = np.empty(count, kind)
    bytes_ = values.view(np.uint8).data
    done = 0
    try:
        with gzip.open(path) as stream:
            stream.seek(begin)
            while done < size and (got := stream.readinto(bytes_[done : done + _PART])):
                done += got
                tick(done / size, f"reading {path.name}")
            more = to_end and bool(stream.read(1))
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: is cut short or damaged; copy or export it again ({error})") from error
    if done < size or more:
        raise InputError(f"{cut} ({done} of {size} bytes)")
    return values.reshape(shape, order="F")


def _is_packed(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(2) == _GZIP


def _misnamed(path: Path) -> tuple[str, ...]:
    """Return a note on a file whose suffix does not match its compression."""
    packed = _is_packed(path)
    if packed == path.name.lower().endswith((".gz", ".mgz")):
        return ()
    return (f"is {'' if packed else 'not '}compressed, although its name says otherwise; it was read anyway",)


def _opened(path: Path) -> tuple[Any, tuple[str, ...]]:
    """Return an image with a valid header, and notes; nibabel would correct invalid headers silently."""
    with ErrorLevel(DUBIOUS):  # type: ignore[no-untyped-call]
        try:
            if not _misnamed(path):
                return nibabel.load(path, mmap=False), ()
            return _image_of(_unpacked(path, _FARTHEST)), ()
        except HeaderDataError as error:
            of_sizes = str(error).startswith("pixdim[1,2,3]")
            content = _with_voxel_sizes(_unpacked(path, _FARTHEST)) if of_sizes else b""
            if not content:
                raise
            return _image_of(content), (_SIZES_OF_SFORM,)


def _image_of(content: bytes) -> Any:  # noqa: ANN401 - half of nibabel is untyped
    kind: Any = nibabel.Nifti2Image if content[:2] in _NIFTI_2 else nibabel.Nifti1Image
    return kind.from_file_map({"image": nibabel.FileHolder(fileobj=io.BytesIO(content))}, mmap=False)


def _with_voxel_sizes(content: bytes) -> bytes:
    """Return a file's content with the voxel sizes of its sform; empty if it has none."""
    kind: Any = nibabel.Nifti2Header if content[:2] in _NIFTI_2 else nibabel.Nifti1Header
    size = int(kind.template_dtype.itemsize)
    header = kind(content[:size], check=False)
    matrix, code = header.get_sform(coded=True)
    sizes = np.linalg.norm(matrix[:3, :3], axis=0) if code > 0 else np.zeros(3)
    if not (np.isfinite(sizes).all() and sizes.min() > 0.0):
        return b""
    header["pixdim"][1:4] = sizes
    return bytes(header.binaryblock) + content[size:]


def _content(path: Path, begin: int, end: int) -> bytes:
    """Return a file's unpacked bytes; their number must be that of the header, and their checksum correct."""
    if not _HEADER <= begin <= _FARTHEST:
        raise InputError(f"{path}: its header says that voxels begin at byte {begin}; export it again")
    content = _unpacked(path, end + 1)
    if len(content) < end:
        raise InputError(f"{path}: is cut short ({len(content)} of {end} bytes); copy or export it again")
    if len(content) > end:
        raise InputError(
            f"{path}: contains more voxels than its header declares; correct its sizes or export it again"
        )
    return content


def _unpacked(path: Path, count: int) -> bytes:
    """Return the first unpacked bytes of a file, at most `count`."""
    try:
        with gzip.open(path) if _is_packed(path) else path.open("rb") as stream:
            content: bytes = stream.read(count)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: is cut short or damaged; copy or export it again ({error})") from error
    return content


def _first_line(error: BaseException) -> str:
    return str(error).partition("\n")[0]


def placement(
    path: Path,
    header: Any,  # noqa: ANN401 - half of nibabel is untyped
    shape: list[int],
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the matrix from indices to RAS [mm], and notes; refuses inconsistent headers."""
    try:
        (q, q_code), (s, s_code) = header.get_qform(coded=True), header.get_sform(coded=True)
        unit = _UNITS[header.get_xyzt_units()[0]]
    except (HeaderDataError, KeyError, ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{path}: its qform or unit is damaged; export it again ({error})") from error
    zooms = np.array(header.get_zooms()[:3], dtype=np.float64)
    notes: tuple[str, ...] = ()
    if q is None and s is None:
        matrix, notes = np.diag([*zooms, 1.0]), (_NO_PLACE,)
    elif s is None:
        matrix = q
    elif q is None:
        if not _fits(s, zooms):
            raise InputError(
                f"{path}: its sform is skewed or contradicts the voxel sizes {zooms}; export it again"
            )
        matrix = s
    elif (apart := _apart(q, s, shape)) <= _AGREE * zooms.min():
        matrix = s
    else:
        matrix, notes = _decided(path, (q, int(q_code)), (s, int(s_code)), zooms, apart * unit)
    return np.diag([unit, unit, unit, 1.0]) @ np.asarray(matrix, dtype=np.float64), notes


def _decided(
    path: Path, qform: tuple[FloatArray, int], sform: tuple[FloatArray, int], zooms: FloatArray, apart: float
) -> tuple[FloatArray, tuple[str, ...]]:
    """Choose one of two different matrices, with a note if they should not differ.

    The choice is that of ITK, and so of 3D Slicer, ITK-SNAP and ANTs: the sform if it maps to the scanner's
    frame, else the qform. Different codes denote different frames, which is not a fault. A sform with other
    voxel sizes (a registration that scales) is not used, because sizes would be wrong.
    """
    (q, q_code), (s, s_code) = qform, sform
    mirrored = np.linalg.det(q[:3, :3]) * np.linalg.det(s[:3, :3]) < 0.0
    if mirrored and q_code == s_code:
        raise InputError(
            f"{path}: its qform and sform are mirror images of each other, both called {_frame(q_code)}, so "
            "that left and right can't be distinguished; export it again with one of them"
        )
    stretched = s_code == _SCANNER and not _fits(s, zooms)
    taken, name = (s, "sform") if s_code == _SCANNER and not stretched else (q, "qform")
    if q_code != s_code and not mirrored and not stretched:
        return taken, ()
    mirror = ", one the mirror image of the other" if mirrored else ""
    why = "the sform is skewed or has other voxel sizes" if stretched else "as 3D Slicer does"
    return taken, (
        f"its qform ({_frame(q_code)}) and sform ({_frame(s_code)}) put voxels up to {apart:.1f} mm apart"
        f"{mirror}; the {name} was used, {why}",
    )


def _apart(q: FloatArray, s: FloatArray, shape: list[int]) -> float:
    """Return the largest distance between the two positions of a voxel [file's units]; infinite for NaN."""
    corners = np.stack(np.meshgrid(*[(0.0, size - 1.0) for size in shape], indexing="ij"), axis=-1)
    farthest = np.linalg.norm(corners @ (q - s)[:3, :3].T + (q - s)[:3, 3], axis=-1).max()
    return float(farthest) if np.isfinite(farthest) else math.inf


def _fits(matrix: FloatArray, zooms: FloatArray) -> bool:
    """Return whether a matrix has orthogonal axes and the header's voxel sizes."""
    axes = matrix[:3, :3] / zooms
    return bool(np.allclose(axes.T @ axes, np.eye(3), atol=0.02))


def _frame(code: int) -> str:
    return _FRAMES.get(code, f"code {code}")


_MAGIC = 344  # byte at which a NIfTI header names itself
_ASSUMED = (
    "Analyze headers do not distinguish left from right: LAS axes were assumed, as in FSL and SPM; shapes "
    "are mirror images if the files use other axes"
)


def read_pair(path: Path) -> Volume:
    """Read a volume of labels from a header and the file of voxels next to it.

    Parameters
    ----------
    path : Path
        The header, ending in .hdr or .hdr.gz. The file of voxels has the same name and ends in .img or
        .img.gz.

    Raises
    ------
    InputError
        If a file is missing, can't be read, or is not a 3-D volume of single numbers.
    """
    values, matrix, slope, intercept, notes = read_pair_scan(path, no_tick)
    if (slope, intercept) != (1.0, 0.0):
        values = values * slope + intercept
    return Volume(path, [values], matrix, notes=notes)


def read_pair_scan(path: Path, tick: Tick) -> StoredScan:
    """Read grey values as stored from a header and the file of voxels next to it, as `read_pair` does."""
    header, is_nifti = _header(path)
    shape, kind = list(header.get_data_shape()), header.get_data_dtype()
    while len(shape) > 3 and shape[-1] == 1:
        shape.pop()
    if kind.fields is not None or kind.kind not in "iuf":
        raise InputError(f"{path}: has {kind} voxels instead of single numbers; export a label map")
    check_size(path, shape, 2.0 * kind.itemsize)
    slope, intercept = header.get_slope_inter()
    notes: tuple[str, ...]
    if is_nifti:
        in_ras, notes = placement(path, header, shape)
        matrix = _TO_LPS @ in_ras
    else:
        matrix, notes = _las_matrix(path, header), (_ASSUMED,)
    values = stored_values(_voxels(path), int(header["vox_offset"]), shape, kind, tick)
    values = values.astype(kind.newbyteorder("="), copy=False)
    return values, matrix, 1.0 if slope is None else float(slope), float(intercept or 0.0), notes


def _header(path: Path) -> tuple[Any, bool]:
    """Return nibabel's header, and whether it is NIfTI's."""
    try:
        with gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as stream:
            content = stream.read(_HEADER)
        is_nifti = content[_MAGIC : _MAGIC + 3] == b"ni1"
        kind: Any = Nifti1PairHeader if is_nifti else Spm99AnalyzeHeader
        if len(content) < _HEADER or _HEADER not in (
            int.from_bytes(content[:4], "little"),
            int.from_bytes(content[:4], "big"),
        ):
            raise ValueError("it does not begin with its size")
        with ErrorLevel(DUBIOUS):  # type: ignore[no-untyped-call]
            return kind(content), is_nifti
    except (HeaderDataError, ValueError, EOFError, zlib.error, gzip.BadGzipFile, KeyError) as error:
        raise InputError(
            f"{path}: has no valid Analyze or NIfTI header; save the volume as .nii.gz or .nrrd ({error})"
        ) from error


def _voxels(path: Path) -> Path:
    """Return the file of voxels that belongs to a header, whatever the case of its name."""
    stem = path.name[: path.name.lower().rindex(".hdr")]
    wanted = (f"{stem}.img".casefold(), f"{stem}.img.gz".casefold())
    for entry in sorted(path.parent.iterdir()):
        if entry.name.casefold() in wanted:
            return entry
    raise InputError(f"{path}: its voxels, {stem}.img or {stem}.img.gz, are not next to it; copy them there")


def _las_matrix(path: Path, header: Any) -> FloatArray:  # noqa: ANN401 - half of nibabel is untyped
    zooms = np.array(header.get_zooms()[:3], np.float64)
    if not (np.isfinite(zooms).all() and (zooms > 0.0).all()):
        raise InputError(f"{path}: its voxels are {zooms} mm large; correct the header")
    return np.diag([*(zooms * (1.0, -1.0, 1.0)), 1.0])
