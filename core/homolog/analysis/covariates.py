"""Covariates from a table: numbers and words to columns of a design."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError

__all__ = ["covariate_columns", "numbers"]

_COMMA = re.compile(r"[+-]?\d+,\d+")


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
        If a value is missing or can't be told, or a covariate is the same for all subjects.
    """
    columns: list[FloatArray] = []
    for title, values in table.items():
        missing = [index for index, value in enumerate(values) if _missing(value)]
        if missing:
            who = ", ".join(names[index] if names else f"subject {index + 1}" for index in missing[:5])
            raise InputError(f"covariate {title!r}: no value for {who}; fill it in or leave the subjects out")
        try:
            found = numbers(values)
        except InputError as error:
            raise InputError(f"covariate {title!r}: {error}") from error
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
    """Return the values as numbers, or None if one of them is a word.

    Decimals may be written with commas.

    Raises
    ------
    InputError
        If commas may as well be between thousands.
    """
    texts = [str(value).strip() for value in values]
    commas = [text for text in texts if _COMMA.fullmatch(text)]
    if commas and all(len(text.rpartition(",")[2]) == 3 for text in commas):
        raise InputError(
            f"{commas[0]} may be a decimal number or thousands; write such values without the comma"
        )
    try:
        return np.array([float(text.replace(",", ".") if text in commas else text) for text in texts])
    except ValueError:
        return None
