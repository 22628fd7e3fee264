"""Covariates from a table: numbers and words to columns of a design."""

import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.spreadsheets import MISSING

__all__ = ["covariate_columns", "is_missing", "lookalikes", "numbers"]

_COMMA = re.compile(r"[+-]?\d+,\d+")


def is_missing(value: str | float) -> bool:
    """Return whether a cell holds no value: empty, ``NA``, ``n/a``, ``nan``, ``none`` or ``null``."""
    if isinstance(value, str):
        return value.strip().lower() in MISSING
    return bool(np.isnan(value))


def covariate_columns(
    table: Mapping[str, Sequence[str | float]],
    names: Sequence[str] | None = None,
    *,
    categories: Collection[str] = (),
) -> FloatArray:
    """Return covariates as standardised columns; categories become one column for each but the first.

    Parameters
    ----------
    table : mapping of str to sequences
        Values of each covariate for the M subjects; numbers may come as text.
    names : sequence of str, optional
        Subject names, for messages.
    categories : collection of str
        Covariates whose numbers are codes of categories.

    Returns
    -------
    (M, c) array

    Raises
    ------
    InputError
        If a value is missing, infinite or a word among numbers, or a covariate is the same for all subjects.
    """
    columns: list[FloatArray] = []
    for title, values in table.items():
        missing = [index for index, value in enumerate(values) if is_missing(value)]
        if missing:
            who = ", ".join(_name(names, index) for index in missing[:5])
            raise InputError(
                f"{title!r}: no value for {who}; fill it in, or exclude such subjects (complete cases)"
            )
        numeric = None if title in categories else _numeric(title, values, names)
        if numeric is None:
            texts = np.array([str(value).strip() for value in values])
            levels = np.unique(texts)
            block = (texts[:, None] == levels[1:]).astype(np.float64)
        else:
            block = numeric[:, None]
        if block.shape[1] == 0 or np.ptp(block[:, 0]) == 0.0:
            raise InputError(f"covariate {title!r} is the same for all subjects; remove it")
        columns.append(block)
    joined = np.hstack(columns)
    standardised: FloatArray = (joined - joined.mean(axis=0)) / joined.std(axis=0)
    return standardised


def lookalikes(values: Sequence[str]) -> list[tuple[str, ...]]:
    """Return categories spelled in different ways, such as ``Male`` and ``male``, or ``1`` and ``1.0``."""
    spelled: dict[str, list[str]] = {}
    for value in dict.fromkeys(item for item in values if not is_missing(item)):
        plain = " ".join(value.casefold().split())
        with suppress(ValueError):
            plain = repr(float(plain))
        spelled.setdefault(plain, []).append(value)
    return [tuple(item) for item in spelled.values() if len(item) > 1]


def _numeric(title: str, values: Sequence[str | float], names: Sequence[str] | None) -> FloatArray | None:
    """Return the values as numbers, None if they are words; refuse a few words among numbers."""
    try:
        numeric = numbers(values)
    except InputError as error:
        raise InputError(f"covariate {title!r}: {error}") from error
    if numeric is None:
        odd = [index for index, value in enumerate(values) if _is_word(value)]
        if len(odd) < len(values) / 2.0:
            cells = ", ".join(f"{values[index]!r} of {_name(names, index)}" for index in odd[:5])
            raise InputError(
                f"{title!r} contains numbers, but also {cells}; correct or empty the cell, or declare "
                f"categories ({title}:c)"
            )
        return None
    infinite = np.flatnonzero(~np.isfinite(numeric))
    if len(infinite):
        raise InputError(
            f"{title!r}: {values[infinite[0]]!r} of {_name(names, int(infinite[0]))} is not finite; "
            "correct or empty the cell"
        )
    return numeric


def _is_word(value: str | float) -> bool:
    return (
        numbers([value] if not isinstance(value, str) or "," not in value else [value.replace(",", ".")])
        is None
    )


def _name(names: Sequence[str] | None, index: int) -> str:
    return names[index] if names else f"subject {index + 1}"


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
