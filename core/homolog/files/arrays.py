"""Named arrays in one compressed file (npz), never pickled."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, frozen
from homolog.errors import InputError
from homolog.files.atomic import atomic_write
from homolog.files.bounded import check_is_file
from homolog.memory import check_fits

__all__ = ["read_arrays", "write_arrays"]


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays, numbers and texts by name, whole or not at all.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


def read_arrays(path: Path) -> dict[str, Array]:
    """Read what `write_arrays` wrote, as read-only arrays.

    Raises
    ------
    InputError
        If the file is missing or damaged, holds anything but plain arrays, or unpacks to more than memory
        holds.
    """
    check_is_file(Path(path))
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            unpacked = sum(item.file_size for item in stored.zip.infolist())
            check_fits(path, unpacked, "delete it and run again")
            return {
                name: frozen(stored[name]) if stored[name].ndim else stored[name] for name in stored.files
            }
    except InputError:
        raise
    except Exception as error:  # what zip, zlib and npy readers raise on damaged files is no short list
        raise InputError(f"{path}: is damaged: {error}; delete it and run again") from error
