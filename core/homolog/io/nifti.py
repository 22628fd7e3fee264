"""NIfTI volumes in one file or two, Analyze's, and FreeSurfer's MGH and MGZ: headers through nibabel.

Voxels are read here, since nibabel takes a file that is longer or shorter than its header says.
"""

import gzip
import html
import logging
import math
import re
import warnings
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
from nibabel.freesurfer.mghformat import MGHHeader
from nibabel.imageglobals import logger
from nibabel.nifti1 import Nifti1PairHeader
from nibabel.spatialimages import HeaderDataError
from nibabel.spm99analyze import Spm99AnalyzeHeader
from nibabel.wrapstruct import WrapStructError

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.volumes import Segment, Stored, check_size
from homolog.progress import Tick

__all__ = ["read_nifti", "voxels_in_memory"]

logger.setLevel(logging.CRITICAL + 1)  # faults that nibabel logs are reported as InputError

_TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
_UNITS = {"meter": 1000.0, "mm": 1.0, "micron": 0.001, "unknown": 1.0}
_NO_PLACE = "its header gives no patient orientation (no qform or sform); RAS axes were assumed"
_SIZES_OF_SFORM = "its voxel sizes are zero or negative; those of its sform were used"
_FARTHEST, _PART = 2**28, 2**22  # bytes
_NO_MGH_PLACE = "its header gives no patient orientation; FreeSurfer's coronal axes were assumed"
_ASSUMED = (
    "Analyze headers do not distinguish left from right: LAS axes were assumed, as in FSL and SPM; shapes "
    "are mirror images if the files use other axes"
)
_NAMED = re.compile(
    r"""<Label\s[^>]*?\bKey=["'](\d{1,9})["'][^>]*>\s*(?:<!\[CDATA\[(.{1,200}?)\]\]>|([^<]{1,200}))""",
    re.DOTALL,
)
"""An entry of the label table that TotalSegmentator and Connectome Workbench write into an extension."""
_GZIP = b"\x1f\x8b"
_NIFTI_2 = (b"\x1c\x02", b"\x02\x1c")
"""First bytes of a header of 540 bytes."""
_MAGIC = slice(344, 347)  # bytes in which a NIfTI header names itself
_PLACED = slice(28, 30)  # bytes of an MGH header that say whether it has a position
_MGH, _PAIR = (".mgz", ".mgh"), (".hdr", ".hdr.gz")
_DUBIOUS = 30  # nibabel's level of sizes of zero or below and of unknown codes
_FAULTS = (
    HeaderDataError,
    WrapStructError,
    OSError,
    EOFError,
    zlib.error,
    ValueError,
    OverflowError,
    MemoryError,
    KeyError,
    TypeError,
)
_AGREE = 0.1  # voxels: larger differences of qform and sform are not due to rounding
_SCANNER = 1
_FRAMES = {_SCANNER: "scanner", 2: "aligned", 3: "Talairach", 4: "MNI", 5: "template"}


def read_nifti(path: Path, tick: Tick) -> Stored:
    """Read a volume of labels or grey values, as stored.

    Parameters
    ----------
    path : Path
        A file that ends in .nii, .nii.gz, .mgh or .mgz; or a header that ends in .hdr or .hdr.gz, with
        voxels in a file of the same name that ends in .img or .img.gz.
    tick : Tick

    Raises
    ------
    InputError
        If it can't be read, is not a volume of single numbers, is too large or not as long as its header
        says, or if qform and sform contradict each other in left and right.
    """
    of_mgh, is_pair = (path.name.lower().endswith(ends) for ends in (_MGH, _PAIR))
    try:
        header, sizes = _header(path)
        shape, kind = list(header.get_data_shape()), header.get_data_dtype()
        begin = int(header.get_data_offset())
        slope, intercept = header.get_slope_inter()
        if not of_mgh:
            header.get_best_affine()
    except _FAULTS as error:
        first_line = str(error).partition("\n")[0]
        raise InputError(
            f"{path}: is not a readable image; export it again, or exclude it ({first_line})"
        ) from error
    while len(shape) > 3 and shape[-1] == 1:
        shape.pop()
    if len(shape) == 5 and shape[3] == 1:  # vectors, as ITK stores them
        del shape[3]
    if kind.fields is not None or kind.kind not in "iuf":
        raise InputError(f"{path}: has {kind} voxels instead of single numbers; export a label map")
    channels = shape[3] if len(shape) == 4 else 1
    check_size(path, shape if len(shape) != 4 else shape[:3], 2.0 * channels * kind.itemsize)
    matrix, notes = _placed(path, header, shape[:3])
    if not (0 if is_pair else header.template_dtype.itemsize) <= begin <= _FARTHEST:
        raise InputError(f"{path}: its header says that voxels begin at byte {begin}; export it again")
    place = _voxels(path) if is_pair else path
    values = _stored_values(place, begin, shape, kind, tick, to_end=not of_mgh)
    return Stored(
        values,
        _TO_LPS @ matrix,
        1.0 if slope is None else float(slope),
        float(intercept or 0.0),
        (*sizes, *notes, *_misnamed(path)),
        _named(header),
    )


def voxels_in_memory(image: Any) -> tuple[Array, FloatArray]:  # noqa: ANN401 - half of nibabel is untyped
    """Return the voxels of one of nibabel's images, (I, J, K), and the matrix from indices to LPS [mm]."""
    values = np.asanyarray(image.dataobj)
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    units = getattr(image.header, "get_xyzt_units", lambda: ("mm",))()[0]
    scale = np.diag([*3 * [_UNITS.get(units, 1.0)], 1.0])
    return values, _TO_LPS @ scale @ np.asarray(image.affine, np.float64)


def _header(path: Path) -> tuple[Any, tuple[str, ...]]:
    """Return nibabel's header, and a note; refuses invalid ones, which nibabel would correct silently."""
    with _opened(path) as stream:
        begin = stream.read(_MAGIC.stop)
        stream.seek(0)
        if path.name.lower().endswith(_MGH):
            content = stream.read(MGHHeader.template_dtype.itemsize)
            header: Any = MGHHeader(content)  # type: ignore[no-untyped-call]
            return header, () if int.from_bytes(content[_PLACED], "big") > 0 else (_NO_MGH_PLACE,)
        kind: Any = nibabel.Nifti2Header if begin[:2] in _NIFTI_2 else nibabel.Nifti1Header
        if path.name.lower().endswith(_PAIR):
            kind = Nifti1PairHeader if begin[_MAGIC] == b"ni1" else Spm99AnalyzeHeader
        with warnings.catch_warnings(action="ignore"):  # of odd extensions
            header = kind.from_fileobj(stream, check=False)
    sizes = header["pixdim"][1:4]
    notes: tuple[str, ...] = ()
    if kind is not Spm99AnalyzeHeader and not (sizes > 0.0).all() and not np.isnan(sizes).any():
        matrix, code = header.get_sform(coded=True)
        lengths = np.linalg.norm(matrix[:3, :3], axis=0) if code > 0 else np.zeros(3)
        if np.isfinite(lengths).all() and lengths.min() > 0.0:
            header["pixdim"][1:4], notes = lengths, (_SIZES_OF_SFORM,)
    header.check_fix(error_level=_DUBIOUS)
    return header, notes


def _opened(path: Path) -> Any:  # noqa: ANN401 - two kinds of streams
    return gzip.open(path) if _is_packed(path) else path.open("rb")


def _is_packed(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(2) == _GZIP


def _misnamed(path: Path) -> tuple[str, ...]:
    """Return a note on a file whose suffix does not match its compression."""
    packed = _is_packed(path)
    if packed == path.name.lower().endswith((".gz", ".mgz")):
        return ()
    return (f"is {'' if packed else 'not '}compressed, although its name says otherwise; it was read anyway",)


def _named(header: Any) -> tuple[Segment, ...]:  # noqa: ANN401 - half of nibabel is untyped
    """Return the structures that an extension of the header names."""
    names: dict[int, str] = {}
    for extension in getattr(header, "extensions", ()):
        if b"<LabelTable" in extension.content:
            for item in _NAMED.finditer(extension.content.decode("utf-8", "replace")):
                names.setdefault(int(item[1]), html.unescape(item[3] or "") or item[2] or "")
    return tuple(Segment(name.strip(), value) for value, name in names.items() if value > 0 and name.strip())


def _voxels(path: Path) -> Path:
    """Return the file of voxels that belongs to a header, whatever the case of its name."""
    stem = path.name[: path.name.lower().rindex(".hdr")]
    wanted = (f"{stem}.img".casefold(), f"{stem}.img.gz".casefold())
    for entry in sorted(path.parent.iterdir()):
        if entry.name.casefold() in wanted:
            return entry
    raise InputError(f"{path}: its voxels, {stem}.img or {stem}.img.gz, are not next to it; copy them there")


def _stored_values(
    path: Path, begin: int, shape: Sequence[int], kind: np.dtype[Any], tick: Tick, *, to_end: bool
) -> Array:
    """Return a file's voxels as stored: memory-mapped, or unpacked in parts into one array.

    With `to_end`, data after the voxels are an error.
    """
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


def _placed(path: Path, header: Any, shape: list[int]) -> tuple[FloatArray, tuple[str, ...]]:  # noqa: ANN401
    """Return the matrix from indices to RAS [mm], and notes; refuses inconsistent headers."""
    if isinstance(header, MGHHeader):
        return np.asarray(header.get_affine(), np.float64), ()  # type: ignore[no-untyped-call]
    zooms = np.array(header.get_zooms()[:3], dtype=np.float64)
    if isinstance(header, Spm99AnalyzeHeader):
        return np.diag([*(zooms * (-1.0, 1.0, 1.0)), 1.0]), (_ASSUMED,)
    try:
        (q, q_code), (s, s_code) = header.get_qform(coded=True), header.get_sform(coded=True)
        unit = _UNITS[header.get_xyzt_units()[0]]
    except (HeaderDataError, KeyError, ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{path}: its qform or unit is damaged; export it again ({error})") from error
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
