"""Atomic writing: files are written next to their destination, flushed, then renamed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from homolog.errors import InputError

__all__ = ["atomic_write", "is_stale_temp", "replace_folder", "report_os_errors", "write_text"]

_TEMP_PREFIX = ".part-"


@contextmanager
def report_os_errors(path: Path) -> Iterator[None]:
    """Convert system errors of writing to `path` into an `InputError` with a remedy."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"{path}: can't be written: {reason}; choose a writable folder with enough free space"
        ) from error


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a path to write to, which replaces `path` when the block ends without an error.

    Parameters
    ----------
    path : Path
        The file to create or replace. Its folder is created if necessary.

    Yields
    ------
    Path
        A hidden file in the same folder with the same suffix.

    Raises
    ------
    InputError
        If the folder can't be written to or the disk is full; `path` is then unchanged.
    """
    path = Path(path)
    temp = path.with_name(f"{_TEMP_PREFIX}{os.getpid()}-{path.name}")
    with report_os_errors(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temp.unlink(missing_ok=True)  # an existing file or link of this name is never written to
            yield temp
            with temp.open("rb+") as stream:
                os.fsync(stream.fileno())
            temp.replace(path)
        except InputError as error:
            raise _in_place(error, temp, path) from error
        finally:
            temp.unlink(missing_ok=True)


@contextmanager
def replace_folder(path: Path) -> Iterator[Path]:
    """Yield a folder to write to. It becomes `path` if the block ends without an error, or is removed.

    Remains of killed processes for the same folder are removed, too.

    Raises
    ------
    InputError
        If `path` is a file or a folder that is not empty, or can't be written to.
    """
    path = Path(path)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{path}: already exists; choose a new name or an empty folder")
    temp = path.with_name(f"{_TEMP_PREFIX}{os.getpid()}-{path.name}")
    with report_os_errors(path):
        try:
            _remove_abandoned(path)
            temp.mkdir(parents=True)
            yield temp
            if path.is_dir():
                path.rmdir()
            temp.replace(path)
        except InputError as error:
            raise _in_place(error, temp, path) from error
        finally:
            shutil.rmtree(temp, ignore_errors=True)


def _remove_abandoned(path: Path) -> None:
    """Remove temporary folders for `path` of terminated processes."""
    if not path.parent.is_dir():
        return
    for item in path.parent.iterdir():
        pid, _, name = item.name.removeprefix(_TEMP_PREFIX).partition("-")
        begun = item.name.startswith(_TEMP_PREFIX) and name == path.name and pid.isdecimal()
        if begun and item.is_dir() and not psutil.pid_exists(int(pid)):
            shutil.rmtree(item, ignore_errors=True)


def _in_place(error: InputError, temp: Path, path: Path) -> InputError:
    """Return an error that names the requested file instead of the hidden one."""
    return InputError(str(error).replace(str(temp), str(path)))


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically; raises as `atomic_write` does."""
    with atomic_write(path) as temp:
        temp.write_text(text, encoding="utf-8", newline="")


def is_stale_temp(name: str) -> bool:
    """Return whether a file is a temporary file of another process, by its name."""
    return name.startswith(_TEMP_PREFIX) and not name.startswith(f"{_TEMP_PREFIX}{os.getpid()}-")
