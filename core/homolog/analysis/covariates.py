"""Covariates from a table: numbers and words to columns of a design."""

from collections.abc import Mapping, Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError

__all__ = ["covariate_columns", "numbers"]


def covariate_columns(
    table: Mapping[str, Sequence[str | float]], names: Sequence[str] | None = None
) -> FloatArray:
    """Return covariates as standardised columns; words become one column for each but the first.

    Parameters
    ----------
    table : mapping of str to sequences
        Values of each covariate for the M subjects; numbers may come as text.
    names : sequence of str, optional
        Subject names, for messages.

    Returns
    -------
    (M, c) array

    Raises
    ------
    InputError
        If a value is missing, or a covariate is the same for all subjects.
    """
    columns: list[FloatArray] = []
    for title, values in table.items():
        missing = [index for index, value in enumerate(values) if _missing(value)]
        if missing:
            who = ", ".join(names[index] if names else f"subject {index + 1}" for index in missing[:5])
            raise InputError(f"covariate {title!r}: no value for {who}; fill it in or leave the subjects out")
        found = numbers(values)
        if found is None:
            words = np.array([str(value).strip() for value in values])
            levels = np.unique(words)
            block = (words[:, None] == levels[1:]).astype(np.float64)
        else:
            block = found[:, None]
        if block.shape[1] == 0 or np.ptp(block[:, 0]) == 0.0:
            raise InputError(f"covariate {title!r} is the same for all subjects; leave it out")
        columns.append(block)
    joined = np.hstack(columns)
    standardised: FloatArray = (joined - joined.mean(axis=0)) / joined.std(axis=0)
    return standardised


def _missing(value: str | float) -> bool:
    if isinstance(value, str):
        return value.strip().lower() in ("", "na", "n/a", "nan", "none", "null")
    return not np.isfinite(value)


def numbers(values: Sequence[str | float]) -> FloatArray | None:
    """Return the values as numbers, or None if one of them is a word."""
    try:
        return np.array([float(value) for value in values])
    except ValueError:
        return None
