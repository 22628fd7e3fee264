"""NIfTI 1 and 2 label maps, with their two ways of saying where they lie."""

import zlib
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.grooming.volumes import Volume, check_size

__all__ = ["read_nifti"]

_TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
_UNITS = {"meter": 1000.0, "mm": 1.0, "micron": 0.001, "unknown": 1.0}
_NO_PLACE = "its header does not say how the patient lay (no qform or sform); RAS axes were assumed"
_AGREE = 0.1  # voxels: most that qform and sform may differ anywhere in the volume


def read_nifti(path: Path) -> Volume:
    """Read a NIfTI file.

    Parameters
    ----------
    path : Path
        Ends in .nii or .nii.gz.

    Raises
    ------
    InputError
        If it can't be read, is no 3-D volume of single numbers, too large, or if qform and sform put its
        voxels at different places.
    """
    import nibabel
    from nibabel.filebasedimages import ImageFileError
    from nibabel.spatialimages import HeaderDataError

    try:
        image: Any = nibabel.load(path, mmap=False)
    except (
        ImageFileError,
        HeaderDataError,
        OSError,
        EOFError,
        zlib.error,
        ValueError,
        OverflowError,
    ) as error:
        raise InputError(
            f"{path}: is no readable image; export it again, or leave it out ({error})"
        ) from error
    if not isinstance(image, nibabel.Nifti1Image):
        raise InputError(f"{path}: is no NIfTI file but another kind under its name; rename or export it")
    header: Any = image.header
    shape = list(image.shape)
    while len(shape) > 3 and shape[-1] == 1:
        shape.pop()
    kind = header.get_data_dtype()
    if kind.fields is not None or kind.kind not in "iuf":
        raise InputError(f"{path}: has {kind} voxels, not single numbers; export a label map")
    check_size(path, shape, 8.0 if header.get_slope_inter()[0] not in (None, 1.0) else kind.itemsize)
    matrix, notes = _placement(path, header, shape)
    try:
        values: Array = np.asanyarray(image.dataobj).reshape(shape)
    except (OSError, EOFError, zlib.error, ValueError, MemoryError) as error:
        raise InputError(f"{path}: is cut short or damaged; copy or export it again ({error})") from error
    return Volume(path, [values], _TO_LPS @ matrix, notes=notes)


def _placement(
    path: Path,
    header: Any,  # noqa: ANN401 - half of nibabel is untyped
    shape: list[int],
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the matrix from indices to RAS [mm], refusing headers that contradict themselves."""
    from nibabel.spatialimages import HeaderDataError

    try:
        (q, _), (s, _) = header.get_qform(coded=True), header.get_sform(coded=True)
        unit = _UNITS[header.get_xyzt_units()[0]]
    except (HeaderDataError, KeyError, ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{path}: its qform or unit is damaged; export it again ({error})") from error
    zooms = np.array(header.get_zooms()[:3], dtype=np.float64)
    scale = np.diag([unit, unit, unit, 1.0])
    if q is None and s is None:
        return scale @ np.diag([*zooms, 1.0]), (_NO_PLACE,)
    if q is not None and s is not None:
        corners = np.stack(np.meshgrid(*[(0.0, size - 1.0) for size in shape], indexing="ij"), axis=-1)
        apart = np.linalg.norm(corners @ (q - s)[:3, :3].T + (q - s)[:3, 3], axis=-1).max()
        if not apart <= _AGREE * zooms.min():
            raise InputError(
                f"{path}: its qform and sform put voxels up to {apart * unit:.1f} mm apart; export it "
                "again with one of them, the one in the scanner's frame"
            )
    elif s is not None and not np.allclose(np.linalg.norm(s[:3, :3], axis=0), zooms, rtol=0.01):
        raise InputError(
            f"{path}: its sform and its voxel sizes {zooms} contradict each other; export it again"
        )
    return scale @ np.asarray(q if s is None else s, dtype=np.float64), ()
