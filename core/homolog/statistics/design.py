"""Linear designs: tested columns, nuisance columns, and exchangeability under the null.

Two groups, several groups, a continuous variable and paired subjects are one kind of test, with tested
columns and nuisance columns (the intercept, and covariates from a table's numbers and categories).
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.spreadsheets import MISSING

__all__ = [
    "Design",
    "Exchange",
    "adjusted_design",
    "covariate_columns",
    "group_design",
    "indicators",
    "is_missing",
    "lookalikes",
    "names_reference",
    "numbers",
    "paired_design",
    "reference_first",
    "regression_design",
]

_COMMA = re.compile(r"[+-]?\d+,\d+")


def is_missing(value: str | float) -> bool:
    """Return whether a cell is empty, ``NA``, ``n/a``, ``nan``, ``none`` or ``null``."""
    if isinstance(value, str):
        return value.strip().lower() in MISSING
    return bool(np.isnan(value))


def covariate_columns(
    table: Mapping[str, Sequence[str | float]],
    names: Sequence[str] | None = None,
    *,
    categories: Collection[str] = (),
) -> FloatArray:
    """Return covariates as standardised columns; each category but the first becomes an indicator column.

    Parameters
    ----------
    table : mapping of str to sequences
        Values of each covariate for the M subjects; numbers may be text.
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
        If a value is missing, infinite or a word among numbers, or a covariate is constant.
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
        block = indicators(values) if numeric is None else numeric[:, None]
        if block.shape[1] == 0 or np.ptp(block[:, 0]) == 0.0:
            raise InputError(f"covariate {title!r} is the same for all compared subjects; remove it")
        columns.append(block)
    joined = np.hstack(columns)
    standardised: FloatArray = (joined - joined.mean(axis=0)) / joined.std(axis=0)
    return standardised


def indicators(values: Sequence[str | float] | FloatArray) -> FloatArray:
    """Return an indicator column for each value but the first in alphabetical order."""
    texts = np.array([str(value).strip() for value in values])
    columns: FloatArray = (texts[:, None] == np.unique(texts)[1:]).astype(np.float64)
    return columns


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
    """Return the values as numbers, None if they are words; refuse single words among numbers."""
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
        value = values[infinite[0]]
        shown = repr(value) if isinstance(value, str) else f"{value}"
        raise InputError(
            f"{title!r}: {shown} of {_name(names, int(infinite[0]))} is not finite; correct or empty the cell"
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
        If the commas may separate thousands.
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


_DEPENDENT = 1e-8
"""Least independent fraction of a column's length; below it, it is a combination of the others."""


# fmt: off
_REFERENCES = frozenset([
    "baseline", "cn", "control", "controls", "ctrl", "hc", "healthy", "nor", "normal", "reference",
    "gesund", "gesunde", "kontrolle", "kontrollen", "sain", "sains", "témoin", "témoins", "sano", "sanos",
    "controlli", "controllo", "sani",
])
# fmt: on


def names_reference(value: str) -> bool:
    """Return whether a group's name denotes controls, such as ``healthy``."""
    return value.lower() in _REFERENCES


def reference_first(values: Iterable[str]) -> list[str]:
    """Return the distinct values in alphabetical order, names of controls first."""
    distinct = {value for value in values if not is_missing(value)}
    return sorted(distinct, key=lambda value: (not names_reference(value), value))


class Exchange(StrEnum):
    """What may be exchanged under the null hypothesis."""

    ROWS = "rows"
    """Subjects, or with covariates their residuals (Freedman and Lane 1983)."""
    SIGNS = "signs"
    """Signs of differences."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """A linear design with orthonormal bases. Arrays are read-only.

    Attributes
    ----------
    columns : (M, d) array
        Tested columns with the nuisance columns projected out, in their original units.
    tested : (M, d) array
        Orthonormal basis of `columns`.
    nuisance : (M, q) array
        Orthonormal basis of intercept and covariates; the first column is the intercept, if there is one.
    exchange : Exchange
        Exchangeable units under the null.
    given : (M, d) array
        Original tested columns: indicators of all groups but the first, or the variable.
    """

    columns: FloatArray
    tested: FloatArray
    nuisance: FloatArray
    exchange: Exchange
    given: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("columns", "tested", "nuisance", "given"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def error_dof(self) -> int:
        """Degrees of freedom left for the error: M - q - d."""
        return len(self.tested) - int(self.nuisance.shape[1] + self.tested.shape[1])

    @property
    def covariates(self) -> FloatArray:
        """The nuisance basis without its intercept, shape (M, q - 1) or (M, 0)."""
        return self.nuisance[:, 1:]

    def of(self, rows: BoolArray) -> "Design":
        """Return the same design for some of the rows.

        Raises
        ------
        InputError
            If these rows do not separate tested and nuisance columns, or leave no degrees of freedom.
        """
        columns, nuisance = self.given[rows], self.nuisance[rows]
        if self.exchange is Exchange.SIGNS:
            return paired_design(len(columns))
        return _design(columns, nuisance[:, 1:] if nuisance.shape[1] > 1 else None, "what is tested")

    def residuals(self, data: FloatArray) -> FloatArray:
        """Return data (M, P) with the nuisance columns regressed out."""
        rest: FloatArray = data - self.nuisance @ (self.nuisance.T @ data)
        return rest

    def coefficients(self, data: FloatArray) -> FloatArray:
        """Return the least-squares coefficients (d, P) of the tested columns, adjusted for the others."""
        return np.asarray(np.linalg.lstsq(self.columns, data, rcond=None)[0], np.float64)


def group_design(groups: Sequence[str], order: Sequence[str], covariates: FloatArray | None = None) -> Design:
    """Return the design that tests for any difference between groups.

    Parameters
    ----------
    groups : sequence of str
        Group of each of the M subjects.
    order : sequence of str
        The groups in order; the coefficients are differences from the first.
    covariates : (M, c) array, optional
        Columns from `homolog.statistics.design.covariate_columns`.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If a group has fewer than two subjects, a subject is in none of the groups, or group and covariates
        are confounded.
    """
    if len(order) < 2 or len(set(order)) < len(order):
        raise InputError(
            f"a comparison needs two or more different groups, not: {', '.join(order) or 'none'}"
        )
    labels = np.asarray(groups)
    unknown = sorted(set(groups) - set(order))
    if unknown:
        raise InputError(f"group {unknown[0]!r} is not among those compared: {', '.join(order)}")
    for entry in order:
        count = int(np.count_nonzero(labels == entry))
        if count < 2:
            raise InputError(
                f"group {entry!r} has {count} of the two or more subjects that a comparison needs"
            )
    columns = np.column_stack([labels == item for item in order[1:]]).astype(np.float64)
    return _design(columns, covariates, "the group")


def regression_design(values: FloatArray, covariates: FloatArray | None = None) -> Design:
    """Return the design that tests for a linear effect of a continuous variable.

    Parameters
    ----------
    values : (M,) array_like
        The variable; coefficients are per its unit.
    covariates : (M, c) array, optional
        Columns from `homolog.statistics.design.covariate_columns`.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If the values are not finite, all the same, or a combination of the covariates.
    """
    column = np.asarray(values, dtype=np.float64)
    if column.ndim != 1 or not np.isfinite(column).all():
        raise InputError("the variable has values that are missing or not finite; exclude those subjects")
    if np.ptp(column) == 0.0:
        raise InputError("the variable is the same for all subjects; it allows no regression")
    return _design(column[:, None], covariates, "the variable")


def adjusted_design(columns: FloatArray, nuisance: FloatArray, name: str) -> Design:
    """Return the design that tests columns (M, d), adjusted for others (M, c) and an intercept.

    Raises
    ------
    InputError
        If the tested columns, called `name` in the message, are confounded with the others.
    """
    return _design(columns, nuisance, repr(name))


def paired_design(pairs: int) -> Design:
    """Return the design that tests whether the differences of pairs have mean zero."""
    if pairs < 2:
        raise InputError(f"a paired comparison needs at least two pairs, not {pairs}")
    ones = np.ones((pairs, 1))
    return Design(ones, ones / np.sqrt(pairs), np.zeros((pairs, 0)), Exchange.SIGNS, ones)


def _design(columns: FloatArray, covariates: FloatArray | None, what: str) -> Design:
    subjects = len(columns)
    nuisance = np.full((subjects, 1), 1.0 / np.sqrt(subjects))
    if covariates is not None:
        nuisance = _extended(nuisance, covariates, "a covariate is a combination of the others")
    tested = _extended(nuisance, columns, f"{what} is confounded with the covariates")
    basis = tested[:, nuisance.shape[1] :]
    projected = columns - nuisance @ (nuisance.T @ columns)
    design = Design(projected, basis, nuisance, Exchange.ROWS, columns)
    if design.error_dof < 1:
        raise InputError(
            f"{subjects} subjects are too few for {nuisance.shape[1] + basis.shape[1]} columns of the "
            "design; use fewer covariates or more subjects"
        )
    return design


def _extended(basis: FloatArray, columns: FloatArray, fault: str) -> FloatArray:
    """Add columns to an orthonormal basis, each orthogonal to all before it."""
    for column in columns.T:
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        if length <= _DEPENDENT * np.linalg.norm(column):
            raise InputError(f"{fault}; remove one of them")
        basis = np.column_stack([basis, rest / length])
    return basis
