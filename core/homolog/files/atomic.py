"""Files appear whole or not at all: written beside their place, flushed, then renamed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from homolog.errors import InputError

__all__ = ["is_left_over", "replacing", "replacing_folder", "write_text", "writing"]

_PART = ".part-"


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says about writing to `path` into an `InputError` with a remedy."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"{path}: can't be written: {reason}; choose a folder that is writable and has room"
        ) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path to write to; it takes the place of `path` when the block ends well.

    Parameters
    ----------
    path : Path
        The file to make or replace. Its folder is made if need be.

    Yields
    ------
    Path
        A hidden file in the same folder with the same suffix.

    Raises
    ------
    InputError
        If the folder can't be written to or the disk is full; `path` is then as it was.
    """
    path = Path(path)
    part = path.with_name(f"{_PART}{os.getpid()}-{path.name}")
    with writing(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.unlink(missing_ok=True)  # what has that name is never written through
            yield part
            with part.open("rb+") as stream:
                os.fsync(stream.fileno())
            part.replace(path)
        except InputError as error:
            raise _in_place(error, part, path) from error
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """Give a folder to write to; it becomes `path` when the block ends well, and vanishes otherwise.

    Raises
    ------
    InputError
        If `path` is a file or a folder that holds anything, or the place can't be written to.
    """
    path = Path(path)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{path}: already exists; choose a new name or an empty folder")
    part = path.with_name(f"{_PART}{os.getpid()}-{path.name}")
    with writing(path):
        try:
            part.mkdir(parents=True)
            yield part
            if path.is_dir():
                path.rmdir()
            part.replace(path)
        except InputError as error:
            raise _in_place(error, part, path) from error
        finally:
            shutil.rmtree(part, ignore_errors=True)


def _in_place(error: InputError, part: Path, path: Path) -> InputError:
    """Return an error that names the file that was wanted, not the hidden one."""
    return InputError(str(error).replace(str(part), str(path)))


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file whole or not at all; raises as `replacing` does."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8", newline="")


def is_left_over(name: str) -> bool:
    """Return whether a file of this name was begun by another process, to be renamed when it is whole."""
    return name.startswith(_PART) and not name.startswith(f"{_PART}{os.getpid()}-")
