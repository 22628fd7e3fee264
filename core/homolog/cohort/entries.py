"""Entries of folders that can be read, and those that can't."""

import os
from pathlib import Path

from homolog.errors import listed

__all__ = ["notes_on_skipped", "readable_entries"]

_OF_SYSTEMS = {
    "#recycle",
    "#snapshot",
    "$recycle.bin",
    "@eadir",
    "__macosx",
    "lost+found",
    "system volume information",
}
"""Folders that operating systems and storage add, in lower case; some are unreadable."""
_DEPTH = 5
"""Number of levels of folders that are searched."""
_MOST = 1000
"""Largest number of folders in which unreadable entries are looked for."""


def readable_entries(folder: Path) -> list[Path]:
    """Return the entries of a folder in order: without hidden ones, those of systems, and unreadable ones.

    Folders are unreadable without permission, links if they lead nowhere.

    Raises
    ------
    OSError
        If the folder itself can't be read.
    """
    return [path for path, fault in _judged(folder) if not fault]


def notes_on_skipped(folder: Path) -> list[str]:
    """Return notes on the unreadable entries of a folder and of the folders below it."""
    by_fault: dict[str, list[str]] = {}
    waiting = [(folder, 0)]
    for place, depth in waiting:  # grows while it is walked
        for path, fault in _judged(place):
            if fault:
                by_fault.setdefault(fault, []).append(path.relative_to(folder).as_posix())
            elif depth < _DEPTH and len(waiting) < _MOST and path.is_dir():
                waiting.append((path, depth + 1))
    return [f"skipped, {fault}: {listed(names)}" for fault, names in by_fault.items()]


def _judged(folder: Path) -> list[tuple[Path, str]]:
    with os.scandir(folder) as entries:
        own = [
            entry for entry in entries if entry.name[0] != "." and entry.name.casefold() not in _OF_SYSTEMS
        ]
    return sorted((folder / entry.name, _fault(entry)) for entry in own)


def _fault(entry: os.DirEntry[str]) -> str:
    """Return why an entry can't be read, or an empty text."""
    is_folder = False
    try:
        if entry.is_symlink() and not Path(entry.path).exists():
            return "links that lead nowhere"
        if is_folder := entry.is_dir():
            with os.scandir(entry.path) as inner:
                for item in inner:  # names may be listed where files can't be opened
                    item.stat(follow_symlinks=False)
                    break
    except OSError as error:
        return f"{'folders' if is_folder else 'files'} that can't be read ({error.strerror})"
    return ""
