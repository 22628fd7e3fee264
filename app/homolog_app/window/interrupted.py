"""How far an unfinished run got, to be said when its project is opened."""

from functools import lru_cache
from pathlib import Path

from homolog.errors import InputError

__all__ = ["interrupted_text"]


def interrupted_text(checkpoint: Path, particles: int) -> str:
    """Return how far a run got whose checkpoint is there.

    Parameters
    ----------
    checkpoint : Path
        The file.
    particles : int
        How many were wanted.
    """
    try:
        placed, iterations = _read(checkpoint, checkpoint.stat().st_mtime_ns)
    except (InputError, OSError, KeyError, IndexError):
        return "The last run was interrupted, and its checkpoint can't be read; start a new run."
    share = round(100.0 * min(1.0, placed / max(1, particles)))
    return (
        f"The last run was interrupted after {iterations} iterations, with {placed} of {particles} particles "
        f"({share} %). Resume continues from its checkpoint."
    )


@lru_cache(maxsize=1)
def _read(checkpoint: Path, _changed: int) -> tuple[int, int]:
    """Return numbers of particles and iterations; read again only if the file has changed."""
    from homolog.files.arrays import read_arrays

    stored = read_arrays(checkpoint)
    return int(stored["positions"].shape[1]), int(stored["iteration"])
