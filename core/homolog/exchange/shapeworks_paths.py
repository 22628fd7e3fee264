"""Paths in ShapeWorks projects, which may have been written on another machine or system."""

import os
from pathlib import Path, PurePosixPath, PureWindowsPath

from homolog.cohort import checked_path
from homolog.errors import InputError

__all__ = ["leads_out", "place_of", "plain_path"]


def plain_path(path: str) -> str:
    """Return a path with the slashes and spaces of this system.

    Raises
    ------
    InputError
        If it is not a valid path on any system.
    """
    try:
        return checked_path(path.replace("\\", "/").replace("%20", " "))
    except ValueError as error:
        raise InputError(f"the path {path[:80]!r} {error}; save the project again") from error


def place_of(path: str, folder: Path) -> Path | None:
    r"""Return the target of a path in a project of a folder.

    For an absolute path of another machine (``C:\study\a.ply``, ``\\server\study\a.ply``, ``/home/me/a.ply``)
    it is the file in the folder with the longest end of that path, None if there is none.
    """
    plain = plain_path(path)
    place = folder / plain
    literal = folder / path.replace("\\", "/")  # a file may be named a%20b
    if os.path.exists(literal):  # it never raises
        return literal
    if not _is_integer(plain) or os.path.exists(place):
        return place
    parts = [part for part in PureWindowsPath(plain).parts[1:] if part != "."]
    if ".." in parts:
        return None
    ends = (folder.joinpath(*parts[start:]) for start in range(len(parts)))
    return next((end for end in ends if os.path.exists(end)), None)


def leads_out(path: str) -> bool:
    """Return whether a path leads out of the project's folder, or to another machine."""
    plain = path.replace("\\", "/")
    return _is_integer(plain) or ".." in PurePosixPath(plain).parts


def _is_integer(plain: str) -> bool:
    return plain.startswith("/") or bool(PureWindowsPath(plain).drive)
