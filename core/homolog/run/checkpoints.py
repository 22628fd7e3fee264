"""The optimizer's state on disk, for a run that was cancelled or killed."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from homolog.correspondence import Checkpoint
from homolog.errors import InputError
from homolog.files.arrays import read_arrays, write_arrays

__all__ = ["read_checkpoint", "write_checkpoint"]


def write_checkpoint(path: Path, checkpoint: Checkpoint, fingerprint: str) -> None:
    """Replace the checkpoint, whole or not at all.

    Parameters
    ----------
    path : Path
    checkpoint : Checkpoint
    fingerprint : str
        Of the settings and shapes that it belongs to.
    """
    values = {one.name: getattr(checkpoint, one.name) for one in fields(checkpoint)}
    write_arrays(path, values | {"fingerprint": fingerprint})


def read_checkpoint(path: Path, fingerprint: str) -> Checkpoint | None:
    """Read a checkpoint; None if the run did not get as far as one.

    Raises
    ------
    InputError
        If it is damaged, or belongs to other settings or shapes.
    """
    if not path.is_file():
        return None
    stored = read_arrays(path)
    names = {one.name for one in fields(Checkpoint)}
    if names | {"fingerprint"} != set(stored):
        raise InputError(f"{path}: is no checkpoint of this version; run without --resume")
    if str(stored["fingerprint"]) != fingerprint:
        raise InputError(
            f"{path}: the settings or surfaces are not those of the broken-off run; run without --resume"
        )
    values: dict[str, Any] = {
        name: stored[name] if stored[name].ndim else stored[name].item() for name in names
    }
    return Checkpoint(**values)
