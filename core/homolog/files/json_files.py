"""JSON that others wrote: bounded in size and depth, and read as what it should be or not at all."""

import json
from pathlib import Path
from typing import Any

from homolog.errors import InputError

__all__ = ["read_json"]

_LARGEST = 256 * 2**20


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Read a JSON object.

    Parameters
    ----------
    path : Path
    kind : str
        What the file should be, for messages: ``"ShapeWorks project"``.

    Raises
    ------
    InputError
        If the file is missing, too large, or holds no JSON object.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path}: is too large for a {kind}; choose another file")
        content = json.loads(path.read_bytes())
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file; correct the path") from error
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: can't be read as a {kind}: {error}; save it again") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: is no {kind}; choose another file")
    return content
