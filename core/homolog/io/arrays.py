"""Named arrays in one compressed file (npz), never pickled."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np

from homolog.arrays import Array, frozen
from homolog.errors import InputError
from homolog.io.atomic import atomic_write
from homolog.io.bounded import check_is_file
from homolog.memory import check_fits

__all__ = ["read_arrays", "write_arrays"]


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays, numbers and texts by name, atomically.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


def read_arrays(
    path: Path, remedy: str = "delete it and run again", names: Collection[str] | None = None
) -> dict[str, Array]:
    """Read what `write_arrays` wrote, as read-only arrays.

    Parameters
    ----------
    path : Path
    remedy : str
        The remedy in messages about a damaged file.
    names : collection of str, optional
        Names of the arrays to read, if present; by default all.

    Raises
    ------
    InputError
        If the file is missing or damaged, contains anything but plain arrays, or unpacks to more than the
        memory.
    """
    check_is_file(Path(path))
    try:
        if not is_zipfile(path):
            raise InputError(f"{path}: is cut off, or another kind of file; {remedy}")
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            unpacked = sum(item.file_size for item in stored.zip.infolist())
            check_fits(path, unpacked, remedy)
            chosen = [name for name in stored.files if names is None or name in names]
            arrays = {name: stored[name] for name in chosen}
            return {name: frozen(array) if array.ndim else array for name, array in arrays.items()}
    except InputError:
        raise
    except Exception as error:  # zip, zlib and npy readers raise many kinds of errors
        raise InputError(f"{path}: is damaged: {error}; {remedy}") from error
