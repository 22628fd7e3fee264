"""The optimizer's state on disk, for a run that was cancelled or killed."""

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from homolog.correspondence import Checkpoint
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays

__all__ = ["read_checkpoint", "write_checkpoint"]

_NAMES = [item.name for item in fields(Checkpoint) if item.name != "others"]
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
    values = {
        (f"{number}.{name}" if number else name): getattr(item, name)
        for number, item in enumerate((checkpoint, *checkpoint.others))
        for name in _NAMES
    }
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
    kept = {key: value for key, value in stored.items() if key not in ("fingerprint", FRACTION)}
    number = len(kept) // len(_NAMES)
    each: list[dict[str, Any]] = [
        {name: kept.get(f"{index}.{name}" if index else name) for name in _NAMES} for index in range(number)
    ]
    missing = any(value is None for item in each for value in item.values())
    if not each or missing or len(kept) > number * len(_NAMES) or "fingerprint" not in stored:
        raise InputError(f"{path}: is not a checkpoint of this version; start a new run")
    if str(stored["fingerprint"]) != fingerprint:
        raise InputError(
            f"{path}: the settings or surfaces are not those of the interrupted run; start a new run"
        )
    if not all(map(_fits_together, each)):
        raise InputError(f"{path}: is damaged: its arrays do not match; start a new run")
    first, *others = (
        Checkpoint(**{name: value if value.ndim else value.item() for name, value in item.items()})
        for item in each
    )
    return replace(first, others=tuple(others))


def _fits_together(stored: Mapping[str, Any]) -> bool:
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
        and stored["poses"].shape == (shape[0], 4, 4)
        and stored["energies"].shape[1:] == (4,)
        and stored["faces"].dtype == stored["repaired"].dtype == np.int32
        and all(stored[name].dtype == np.float32 for name in ("positions", "widths", "means", "coefficients"))
        and all(stored[name].dtype == np.float64 for name in ("energies", "poses"))
        and all(np.isfinite(item).all() for item in stored.values() if item.dtype.kind == "f")
    )
