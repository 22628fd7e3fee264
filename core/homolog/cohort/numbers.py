"""Numbers that stand for missing values, such as -999: declared by the user, or far outside their column."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.cohort.column_types import CATEGORY, number_of
from homolog.cohort.subject import Cohort, Subject
from homolog.errors import listed

__all__ = ["declared_missing", "is_code", "notes_on_numbers", "outside_notes"]

_LEVEL = 0.05


def is_code(text: str, codes: Sequence[str]) -> bool:
    """Return whether a cell is a value declared as missing, as text or as number."""
    number = number_of(text)
    return any(text == code or (number is not None and number == number_of(code)) for code in codes)


def declared_missing(cohort: Cohort, codes: Sequence[str]) -> Cohort:
    """Return a cohort whose cells with a declared value are empty."""
    if not codes:
        return cohort
    subjects = []
    for subject in cohort.subjects:
        columns = {name: "" if is_code(value, codes) else value for name, value in subject.columns.items()}
        group = None if subject.group is not None and is_code(subject.group, codes) else subject.group
        subjects.append(replace(subject, columns=MappingProxyType(columns), group=group))
    return replace(cohort, subjects=tuple(subjects))


def notes_on_numbers(subjects: Sequence[Subject]) -> list[str]:
    """Return a note on each column with numbers far outside the others that are written like codes."""
    columns = dict.fromkeys(name for subject in subjects for name in subject.columns)
    return [
        note
        for column in columns
        if not column.endswith(CATEGORY)
        for note in outside_notes(
            column, {item.name: item.columns.get(column, "") for item in subjects}, only_codes=True
        )
    ]


def outside_notes(column: str, cells: Mapping[str, str], *, only_codes: bool = False) -> list[str]:
    """Return a note on the numbers of a column that lie far outside the others, if there are any.

    Parameters
    ----------
    column : str
    cells : mapping of str to str
        The column's text by subject. Cells that are no numbers are left aside.
    only_codes : bool
        Whether only numbers are told that are written like codes: 9, 99, 999, or zero and below where all
        others are positive.
    """
    numbers = {name: number for name, text in cells.items() if (number := number_of(text)) is not None}
    values = np.array(list(numbers.values()))
    outside = _outside(values, only_codes)
    if not outside.any():
        return []
    names = [name for name, is_outside in zip(numbers, outside, strict=True) if is_outside]
    texts = list(dict.fromkeys(cells[name] for name in names))
    rest = values[~outside]
    lies, stands = ("lies", "it stands") if len(texts) == 1 else ("lie", "they stand")
    return [
        f"{column}: {', '.join(texts)} of {listed(names)} {lies} far outside the other values "
        f"({rest.min():g} to {rest.max():g}); if {stands} for a missing value, declare it (missing: "
        f"{', '.join(texts)})"
    ]


def _outside(values: FloatArray, only_codes: bool) -> BoolArray:
    """Return which values lie far outside the others.

    These are the lowest or highest ones, at most half, beyond a gap wider than every gap among the others, of
    which the nearest is unlikely as a further draw from the normal distribution of the others: p below 0.05,
    corrected for the number of values that might be chosen. What is written like a code (9, 99, 999, or zero
    and below where all others are positive) needs no correction: such a value is chosen by its writing.
    Positive numbers must be so far in their logarithms, too, since volumes and doses are skewed.
    """
    outside = np.zeros(len(values), bool)
    while len(farthest := _one_side(values[~outside], only_codes)):
        outside |= np.isin(values, farthest)
    return outside


def _one_side(values: FloatArray, only_codes: bool) -> FloatArray:
    distinct = np.unique(values)
    for ordered in (distinct, distinct[::-1]):
        for count in range(1, len(ordered) // 2):
            nearest, others = ordered[count - 1], values[~np.isin(values, ordered[:count])]
            if 2 * len(others) < len(values):
                break
            is_coded = _is_like_code(nearest, others)
            chosen_from = 1 if is_coded else len(distinct)
            are_positive = min(nearest, others.min()) > 0.0
            scales = (np.asarray, np.log) if are_positive else (np.asarray,)
            if (is_coded or not only_codes) and all(
                _is_far(scale(nearest), scale(others), chosen_from) for scale in scales
            ):
                return ordered[:count]
    return np.zeros(0)


def _is_far(value: FloatArray, others: FloatArray, chosen_from: int) -> bool:
    from scipy.special import stdtr

    distinct = np.unique(others)
    if np.abs(distinct - value).min() <= np.diff(distinct).max():
        return False
    deviation = abs(value - others.mean()) / (others.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(others)))
    return bool(2.0 * chosen_from * stdtr(len(others) - 1, -deviation) < _LEVEL)


def _is_like_code(value: float, others: FloatArray) -> bool:
    digits = f"{abs(value):g}"
    return set(digits) == {"9"} or (value <= 0.0 < others.min())
