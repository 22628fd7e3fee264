"""Checks of the input of statistics: clear messages instead of NaN."""

import hashlib
from collections.abc import Sequence

import numpy as np

from homolog.arrays import ArrayLike, FloatArray, frozen
from homolog.errors import InputError

__all__ = ["checked_particles", "finite_numbers", "refuse_duplicates"]


def checked_particles(particles: ArrayLike, names: Sequence[str] | None = None) -> FloatArray:
    """Return the particles as a read-only float64 array; raise InputError if they are invalid.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Corresponding points of M subjects [mm].
    names : sequence of str, optional
        Subject names for the messages; ``subject 1`` … by default.

    Returns
    -------
    (M, N, 3) float64 array
        Read-only [mm].

    Raises
    ------
    InputError
        If the array has another shape, fewer than two subjects, or values that are not finite, or if the
        numbers of subjects and names differ.
    """
    try:
        array = np.asarray(particles, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"particles need the same number of points (x, y, z) for each subject: {error}"
        ) from error
    if array.ndim != 3 or array.shape[2] != 3 or array.shape[1] == 0:
        raise InputError(f"particles need an array of shape (subjects, particles, 3), not {array.shape}")
    if names is not None and (isinstance(names, str) or not hasattr(names, "__len__")):
        raise InputError(f"names: give the name of each subject, not {type(names).__name__}")
    if names is not None and len(names) != len(array):
        raise InputError(f"names: {len(names)} given for {len(array)} subjects; give one for each")
    if len(array) < 2:
        raise InputError(f"statistics need at least two subjects, not {len(array)}; add subjects")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=(1, 2)))
    if len(bad):
        who = ", ".join(_name(names, item) for item in bad[:5])
        raise InputError(f"{who}: particle positions that are not finite numbers; exclude it or run again")
    return frozen(array)


def finite_numbers(values: ArrayLike, what: str) -> FloatArray:
    """Return values as a float64 array; raise InputError if they are not finite numbers.

    Parameters
    ----------
    values : array_like
        Array of any shape.
    what : str
        Name of the values in the message.

    Returns
    -------
    float64 array
        Array of the same shape.

    Raises
    ------
    InputError
        If a value is not a finite number, or rows differ in length.
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind == "c":
            raise InputError(f"{what}: Complex data not supported; give real numbers")
        numbers = given.astype(np.float64, copy=False)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: must be an array of numbers: {error}") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{what}: must be finite numbers, without NaN and infinity")
    return numbers


def refuse_duplicates(particles: FloatArray, names: Sequence[str] | None = None) -> None:
    """Refuse duplicate subjects: a test would count the same evidence twice.

    Parameters
    ----------
    particles : (M, N, 3) array
        Checked particles [mm].
    names : sequence of str, optional
        Subject names for the messages.

    Raises
    ------
    InputError
        If two subjects have the same name, or exactly the same particles.
    """
    if names is not None and len(set(names)) < len(names):
        twice = next(name for name in names if list(names).count(name) > 1)
        raise InputError(f"{twice}: the name occurs more than once; give each subject its own name")
    originals: dict[bytes, int] = {}
    for item, shape in enumerate(particles):
        digest = hashlib.blake2b((shape + 0.0).tobytes()).digest()  # -0.0 is 0.0
        if (original := originals.setdefault(digest, item)) != item:
            raise InputError(
                f"{_name(names, item)}: has exactly the particles of {_name(names, original)}; "
                "exclude one of them"
            )


def _name(names: Sequence[str] | None, index: int) -> str:
    return names[index] if names is not None else f"subject {index + 1}"
