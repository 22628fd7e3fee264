"""The optimizer's state on disk, for a run that was cancelled or killed."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array
from homolog.correspondence import Checkpoint
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays

__all__ = ["read_checkpoint", "write_checkpoint"]

FRACTION = "fraction"  # not in checkpoints of versions before 0.3


def write_checkpoint(path: Path, checkpoint: Checkpoint, fingerprint: str, fraction: float) -> None:
    """Replace the checkpoint atomically.

    Parameters
    ----------
    path : Path
    checkpoint : Checkpoint
    fingerprint : str
        Fingerprint of the settings and shapes of the run.
    fraction : float
        Fraction of the whole run that is done, in [0, 1], for display.
    """
    values = {field.name: getattr(checkpoint, field.name) for field in fields(checkpoint)}
    write_arrays(path, values | {"fingerprint": fingerprint, FRACTION: fraction})


def read_checkpoint(path: Path, fingerprint: str) -> Checkpoint | None:
    """Read a checkpoint; None if there is none yet.

    Raises
    ------
    InputError
        If it is damaged, or belongs to other settings or shapes.
    """
    if not path.is_file():
        return None
    stored = read_arrays(path)
    names = {field.name for field in fields(Checkpoint)}
    if names | {"fingerprint"} != set(stored) - {FRACTION}:
        raise InputError(f"{path}: is not a checkpoint of this version; start a new run")
    if str(stored["fingerprint"]) != fingerprint:
        raise InputError(
            f"{path}: the settings or surfaces are not those of the interrupted run; start a new run"
        )
    if not _fits_together(stored):
        raise InputError(f"{path}: is damaged: its arrays do not match; start a new run")
    values: dict[str, Any] = {
        name: stored[name] if stored[name].ndim else stored[name].item() for name in names
    }
    return Checkpoint(**values)


def _fits_together(stored: dict[str, Array]) -> bool:
    """Return whether a checkpoint's arrays are consistent, as kernels require."""
    counts = [stored[name] for name in ("left", "done", "iteration")]
    shape = stored["positions"].shape
    return (
        all(count.ndim == 0 and count.dtype.kind == "i" and count >= 0 for count in counts)
        and all(
            stored[name].ndim == 0 and stored[name].dtype.kind in "fi"
            for name in ("tangential_weight", "parts", "variance", "left_out")
        )
        and len(shape) == 3
        and shape[2] == 3
        and stored["widths"].shape == stored["faces"].shape == stored["repaired"].shape == shape[:2]
        and stored["means"].shape == shape[1:]
        and stored["neighbours"].shape
        == stored["coefficients"].shape
        == (shape[1], *stored["neighbours"].shape[1:])
        and stored["neighbours"].dtype == np.int32
        and bool(((stored["neighbours"] >= 0) & (stored["neighbours"] < shape[1])).all())
        and stored["poses"].shape[1:] == (4, 4)
        and len(stored["poses"]) in range(shape[0], shape[0] * shape[1], shape[0])  # of each structure
        and stored["energies"].shape[1:] == (4,)
        and stored["faces"].dtype == stored["repaired"].dtype == np.int32
        and all(stored[name].dtype == np.float32 for name in ("positions", "widths", "means", "coefficients"))
        and all(stored[name].dtype == np.float64 for name in ("energies", "poses"))
        and all(np.isfinite(item).all() for item in stored.values() if item.dtype.kind == "f")
    )
