"""Reading of foreign files as bytes and as JSON, bounded in kind, size and depth."""

import json
from pathlib import Path
from typing import Any

from homolog.errors import InputError

__all__ = ["check_is_file", "read_bytes", "read_json"]

_LARGEST = 256 * 2**20


def read_bytes(path: Path, kind: str) -> bytes:
    """Return the content of a file of at most 256 MB.

    Parameters
    ----------
    path : Path
    kind : str
        Expected kind of file, for messages, such as ``"ShapeWorks project"``.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    InputError
        If it is missing, not a file, too large, or can't be read.
    """
    check_is_file(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path}: is too large for a {kind}; choose another file")
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: can't be read as a {kind}: {error.strerror}; check its permissions"
        ) from error


def check_is_file(path: Path) -> None:
    """Refuse folders, pipes and devices, which may have no end."""
    try:
        if path.is_file():
            return
        exists = path.exists()
    except (OSError, ValueError) as error:  # not a path, or in a folder without permission
        raise InputError(f"{path}: can't be read: {error}; correct the path") from error
    raise InputError(f"{path}: {'is not a file' if exists else 'does not exist'}; correct the path")


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Read a JSON object.

    Parameters
    ----------
    path : Path
    kind : str
        Expected kind of file, for messages, such as ``"ShapeWorks project"``.

    Returns
    -------
    dict
        The object in the file.

    Raises
    ------
    InputError
        If the file is missing, too large, or not a JSON object.
    """
    stored = read_bytes(path, kind)
    try:
        content = json.loads(stored)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: can't be read as a {kind}: {error}; save it again") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: is not a {kind}; choose another file")
    return content
