"""Reading of foreign JSON files, bounded in size and depth."""

import json
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog.io.bounded import read_bytes

__all__ = ["read_json"]


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
