"""Linear models of shapes: formulas, their terms, and what one test asks of them.

A formula becomes a `Design`, which is refused if it can't be estimated. Each of its terms, each difference of
adjusted means and each slope is a `Hypothesis`: tested columns, nuisance columns, and independent units.
Groups, covariates, a regression and pairs are such designs, too.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import combinations, product

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.errors import InputError
from homolog.spreadsheets import MISSING

__all__ = [
    "PERSON",
    "Design",
    "Hypothesis",
    "Squares",
    "Term",
    "adjusted_design",
    "covariate_columns",
    "formula_text",
    "group_design",
    "indicators",
    "is_missing",
    "lookalikes",
    "make_design",
    "names_reference",
    "numbers",
    "paired_design",
    "parsed",
    "reference_first",
    "refuse_repeated",
    "regression_design",
    "shorthand",
]

_COMMA = re.compile(r"[+-]?\d+,\d+")


def is_missing(value: str | float) -> bool:
    """Return whether a cell is empty, ``.`` (SAS, Stata), ``NA``, ``n/a``, ``nan``, ``none`` or ``null``."""
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
        _refuse_missing(title, values, names)
        numeric = None if title in categories else _numeric(title, values, names)
        block = indicators(values) if numeric is None else numeric[:, None]
        if block.shape[1] == 0 or np.ptp(block[:, 0]) == 0.0:
            raise InputError(f"covariate {title!r} is the same for all compared subjects; remove it")
        columns.append(block)
    joined = np.hstack(columns)
    standardised: FloatArray = (joined - joined.mean(axis=0)) / joined.std(axis=0)
    return standardised


def _refuse_missing(title: str, values: Sequence[str | float], names: Sequence[str] | None) -> None:
    missing = [index for index, value in enumerate(values) if is_missing(value)]
    if missing:
        who = ", ".join(_name(names, index) for index in missing[:5])
        raise InputError(
            f"{title!r}: no value for {who}; fill it in, or exclude such subjects (complete cases)"
        )


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


class Squares(IntEnum):
    """Types of sums of squares: what a term is adjusted for."""

    SEQUENTIAL = 1
    """The terms before it."""
    MARGINAL = 2
    """All terms that do not contain it (the default)."""
    PARTIAL = 3
    """All other terms, with categories coded as differences whose levels sum to zero."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """What one test asks of a linear model, with orthonormal bases. Arrays are read-only.

    Attributes
    ----------
    name : str
        What is tested, such as ``"group"`` or ``"HCM - NOR"``.
    columns : (M, d) array
        Tested columns with the nuisance columns projected out; coefficients are in their units.
    tested : (M, d) array
        Orthonormal basis of `columns`.
    nuisance : (M, q) array
        Orthonormal basis of all that the effect is adjusted for. The first column is the intercept; without
        columns, data are differences of pairs.
    units : (M,) int array
        Independent unit of each row, 0 to K - 1: the subject of repeated measures, else the row itself.
    """

    name: str
    columns: FloatArray
    tested: FloatArray
    nuisance: FloatArray
    units: IntArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("columns", "tested", "nuisance"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        object.__setattr__(self, "units", frozen(self.units, np.int64))

    @property
    def error_dof(self) -> int:
        """Degrees of freedom left for the error: M - q - d."""
        return len(self.tested) - int(self.nuisance.shape[1] + self.tested.shape[1])

    @property
    def n_units(self) -> int:
        """Number of independent units K."""
        return int(self.units.max()) + 1

    @property
    def covariates(self) -> FloatArray:
        """The nuisance basis without its intercept, shape (M, q - 1) or (M, 0)."""
        return self.nuisance[:, 1:]

    def of(self, rows: BoolArray) -> "Hypothesis":
        """Return the same hypothesis for some of the rows.

        Raises
        ------
        InputError
            If these rows do not separate tested and nuisance columns, or leave no degrees of freedom.
        """
        units = np.unique(self.units[rows], return_inverse=True)[1].reshape(-1)
        return _hypothesis(self.name, self.columns[rows], self.nuisance[rows], units)

    def residuals(self, data: FloatArray) -> FloatArray:
        """Return data (M, P) with the nuisance columns regressed out."""
        rest: FloatArray = data - self.nuisance @ (self.nuisance.T @ data)
        return rest

    def coefficients(self, data: FloatArray) -> FloatArray:
        """Return the least-squares coefficients (d, P) of the tested columns, adjusted for the others."""
        return np.asarray(np.linalg.lstsq(self.columns, data, rcond=None)[0], np.float64)


@dataclass(frozen=True, slots=True)
class Term:
    """A term of a design.

    Attributes
    ----------
    name : str
        Its columns of the table, joined by colons: ``"group"``, ``"group:age"``.
    factors : tuple of str
        These columns.
    dof : int
        Its degrees of freedom.
    inflation : float
        Variance inflation: how many times the variance of the term's coefficients grows because the terms
        that don't contain it are not independent of it (mean over its columns; 1 without confounding).
    """

    name: str
    factors: tuple[str, ...]
    dof: int
    inflation: float


class Design:
    """A linear model of shapes by columns of a table. See `make_design`, which checks it.

    Attributes
    ----------
    formula : str
        Its formula, with all terms written out.
    levels : dict of str to tuple of str
        Levels of each category, the reference first.
    numbers : dict of str to (M,) array
        Values of each number.
    units : (M,) int array
        Independent unit of each row.
    strata : (M,) int array or None
        Stratum of each row; differences between strata are removed before anything is tested.
    """

    def __init__(
        self,
        factors: Sequence[tuple[str, ...]],
        levels: dict[str, tuple[str, ...]],
        codes: dict[str, IntArray],
        values: dict[str, FloatArray],
        units: IntArray,
        strata: IntArray | None,
    ) -> None:
        self.levels, self.numbers, self.units, self.strata = levels, values, units, strata
        self._codes, self._factors = codes, tuple(sorted(factors, key=len))
        self.formula = formula_text(self._factors)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Terms without intercept and strata, main effects first."""
        return tuple(
            Term(":".join(item), item, self._block(item).shape[1], self._inflation(item))
            for item in self._factors
        )

    @property
    def rows(self) -> int:
        """Number of rows M."""
        return len(self.units)

    def labels(self, factor: str) -> tuple[str, ...]:
        """Return the level of each row in a category."""
        return tuple(self._levels(factor)[code] for code in self._codes[factor])

    @property
    def matrix(self) -> FloatArray:
        """All columns (M, p): intercept, strata, and the terms in their order."""
        return self._joined(self._factors)

    def hypothesis(self, term: str, squares: Squares = Squares.MARGINAL) -> Hypothesis:
        """Return the hypothesis that a term has no effect.

        Parameters
        ----------
        term : str
            Name of the term.
        squares : Squares
            What it is adjusted for.

        Raises
        ------
        InputError
            If there is no such term.
        """
        names = [item.name for item in self.terms]
        if term not in names:
            raise InputError(f"{term!r} is not a term of {self.formula!r}; terms are: {', '.join(names)}")
        at = names.index(term)
        own, sums = self._factors[at], squares is Squares.PARTIAL
        if squares is Squares.SEQUENTIAL:
            others = self._factors[:at]
        elif sums:
            others = self._factors[:at] + self._factors[at + 1 :]
        else:
            others = tuple(item for item in self._factors if not set(own) <= set(item))
        return _hypothesis(term, self._block(own, sums=sums), self._joined(others, sums=sums), self.units)

    def contrast(self, weights: FloatArray, name: str) -> Hypothesis:
        """Return the hypothesis that a combination of the coefficients of `matrix` is zero.

        Parameters
        ----------
        weights : (p,) array
            The combination, such as the difference of two rows from `at`.
        name : str
            Its name.
        """
        matrix = self.matrix
        column = matrix @ np.linalg.solve(matrix.T @ matrix, weights)
        base = np.linalg.qr(matrix)[0]
        unit = column / np.linalg.norm(column)
        rest = base - np.outer(unit, unit @ base)
        left, sizes, _ = np.linalg.svd(rest, full_matrices=False)
        nuisance = left[:, sizes > 0.5]
        return Hypothesis(name, column[:, None] / float(column @ column), unit[:, None], nuisance, self.units)

    def at(self, values: Mapping[str, str | float]) -> FloatArray:
        """Return the row (p,) of `matrix` for a subject with given values.

        Numbers that are not given are at their mean; over categories not given, and strata, levels are
        averaged with equal weights. ``row @ coefficients`` is thus an adjusted mean.
        """
        blocks = [np.ones(1)]
        if self.strata is not None:
            strata = int(self.strata.max())
            blocks.append(np.full(strata, 1.0 / (strata + 1)))
        for factors in self._factors:
            block = np.ones(1)
            for name in factors:
                if name in self.numbers:
                    own = np.array([float(values.get(name, self.numbers[name].mean()))])
                else:
                    coding = self._coding(factors, name)
                    given = values.get(name)
                    own = (
                        coding.mean(axis=0) if given is None else coding[self.levels[name].index(str(given))]
                    )
                block = np.multiply.outer(block, own).reshape(-1)
            blocks.append(block)
        return np.concatenate(blocks)

    def differences(self, factor: str, values: Mapping[str, str | float] | None = None) -> list[Hypothesis]:
        """Return the difference of adjusted means of each pair of levels, the later minus the earlier.

        Parameters
        ----------
        factor : str
            A category.
        values : mapping, optional
            Values of other columns, as in `at`.
        """
        given = values or {}
        return [
            self.contrast(self.at({**given, factor: b}) - self.at({**given, factor: a}), f"{b} - {a}")
            for a, b in combinations(self._levels(factor), 2)
        ]

    def slopes(self, number: str, factor: str | None = None) -> list[Hypothesis]:
        """Return the slope along a number: one, or one for each level of a category."""
        levels = [] if factor is None else self._levels(factor)
        along: list[dict[str, str | float]] = [{str(factor): level} for level in levels] or [{}]
        return [
            self.contrast(self._slope(number, own), ", ".join([number, *map(str, own.values())]))
            for own in along
        ]

    def slope_differences(self, number: str, factor: str) -> list[Hypothesis]:
        """Return the difference of slopes of each pair of levels; the design needs their interaction."""
        if not any({number, factor} <= set(item) for item in self._factors):
            raise InputError(f"{self.formula!r} has no {factor}:{number}; slopes can't differ")
        return [
            self.contrast(
                self._slope(number, {factor: b}) - self._slope(number, {factor: a}), f"{number}, {b} - {a}"
            )
            for a, b in combinations(self._levels(factor), 2)
        ]

    def _slope(self, number: str, given: Mapping[str, str | float]) -> FloatArray:
        if number not in self.numbers:
            raise InputError(f"{number!r} is not a number of {self.formula!r}")
        slope: FloatArray = self.at({**given, number: 1.0}) - self.at({**given, number: 0.0})
        return slope

    def common_slope(self, number: str, factor: str) -> Hypothesis:
        """Return the hypothesis that a number has the same slope in all levels of a category.

        Test it before a covariate is adjusted for: with different slopes, adjusted means differ along it.
        """
        both = next((item for item in self._factors if set(item) == {number, factor}), None)
        if both is not None:
            return self.hypothesis(":".join(both))
        wider = Design(
            (*self._factors, (factor, number)),
            self.levels,
            self._codes,
            self.numbers,
            self.units,
            self.strata,
        )
        wider.check()
        return wider.hypothesis(f"{factor}:{number}")

    def check(self, names: Sequence[str] | None = None) -> None:
        """Refuse a design that can't be estimated; see `make_design`."""
        base = self._joined(())
        for factors in self._factors:
            name = ":".join(factors)
            self._refuse_empty_cells(factors)
            block = self._block(factors)
            wider = np.column_stack([base, block])
            if np.linalg.matrix_rank(_unit(wider)) < wider.shape[1]:
                raise InputError(
                    f"{name} can't be told from {self._aliases(factors)}: its columns are combinations of "
                    "theirs; remove one of them"
                )
            base = wider
        columns, units = base.shape[1], int(self.units.max()) + 1
        if self.rows <= columns or units < 3:
            what = f"{self.rows} rows" if units == self.rows else f"{self.rows} rows of {units} subjects"
            raise InputError(
                f"{what} are too few for {self.formula}, which has {columns} columns; use fewer terms or "
                "more subjects"
            )
        basis = np.linalg.qr(base)[0]
        for item in self.terms:
            self._refuse_single(item, basis, names)

    def _refuse_empty_cells(self, factors: tuple[str, ...]) -> None:
        categories = [name for name in factors if name in self.levels]
        if len(categories) < 2:
            return
        there = set(zip(*(self._codes[name].tolist() for name in categories), strict=True))
        for cell in product(*(range(len(self.levels[name])) for name in categories)):
            if cell not in there:
                cell_text = " and ".join(
                    f"{name} {self.levels[name][code]}" for name, code in zip(categories, cell, strict=True)
                )
                raise InputError(
                    f"{':'.join(factors)} can't be estimated: no subject has {cell_text}; remove the "
                    "interaction, or compare fewer levels"
                )

    def _aliases(self, factors: tuple[str, ...]) -> str:
        """Return the terms whose removal makes a term estimable."""
        own = self._block(factors)
        earlier = self._factors[: self._factors.index(factors)]
        culprits = []
        for other in earlier:
            rest = self._joined(tuple(item for item in earlier if item != other))
            both = np.column_stack([rest, own])
            if np.linalg.matrix_rank(_unit(both)) > np.linalg.matrix_rank(_unit(rest)) + own.shape[1] - 1:
                culprits.append(":".join(other))
        return " and ".join(culprits) or ("the strata" if self.strata is not None else "the terms before it")

    def _refuse_single(self, term: Term, basis: FloatArray, names: Sequence[str] | None) -> None:
        """Refuse a term that hangs on one unit: without it, the design has one column fewer."""
        tested = self.hypothesis(term.name).tested
        for unit in range(int(self.units.max()) + 1):
            own = self.units == unit
            left = np.linalg.eigvalsh(np.eye(basis.shape[1]) - basis[own].T @ basis[own])[0]
            if left < _DEPENDENT and np.square(tested[own]).sum() > _DEPENDENT:
                first = int(np.flatnonzero(own)[0])
                who = f"subject {first + 1}" if names is None else names[first]
                raise InputError(
                    f"{term.name} can be estimated by {who} alone: without this subject, it can't be told "
                    f"from the other terms (variance inflation {term.inflation:.1f}); remove a term, or "
                    "compare fewer levels"
                )

    def _code(self, factor: str, level: str) -> int:
        if level not in self.levels[factor]:
            raise InputError(f"{factor}: {level!r} is not among {', '.join(self.levels[factor])}")
        return self.levels[factor].index(level)

    def _levels(self, factor: str) -> tuple[str, ...]:
        if factor not in self.levels:
            raise InputError(f"{factor!r} is not a category of {self.formula!r}")
        return self.levels[factor]

    def _coding(self, factors: tuple[str, ...], name: str, *, sums: bool = False) -> FloatArray:
        """Return the row (K, c) of each level: contrasts where the term without it is there, else all."""
        count = len(self.levels[name])
        rest = tuple(item for item in factors if item != name)
        if rest and not any(set(item) == set(rest) for item in self._factors):
            return np.eye(count)
        coding = np.eye(count)[:, 1:]
        return coding - 1.0 / count if sums else coding

    def _block(self, factors: tuple[str, ...], *, sums: bool = False) -> FloatArray:
        """Return the columns (M, d) of a term."""
        block = np.ones((self.rows, 1))
        for name in factors:
            if name in self.numbers:
                own = self.numbers[name][:, None]
            else:
                own = self._coding(factors, name, sums=sums)[self._codes[name]]
            block = (block[:, :, None] * own[:, None, :]).reshape(self.rows, -1)
        return block

    def _joined(self, terms: Sequence[tuple[str, ...]], *, sums: bool = False) -> FloatArray:
        """Return intercept, strata and the columns of some terms, (M, q)."""
        columns = [np.ones((self.rows, 1))]
        if self.strata is not None:
            columns.append(np.eye(int(self.strata.max()) + 1)[self.strata][:, 1:])
        return np.hstack([*columns, *(self._block(item, sums=sums) for item in terms)])

    def _inflation(self, factors: tuple[str, ...]) -> float:
        """Return the variance inflation; numbers are centred, which products with them otherwise repeat."""
        if any(abs(own.mean()) > _DEPENDENT * own.std() for own in self.numbers.values()):
            centred = {name: own - own.mean() for name, own in self.numbers.items()}
            same = Design(self._factors, self.levels, self._codes, centred, self.units, self.strata)
            return same._inflation(factors)
        others = tuple(item for item in self._factors if not set(factors) <= set(item))
        intercept, nuisance = (_basis(self._joined(item)) for item in ((), others))
        own = self._block(factors)
        own = _basis(own - intercept @ (intercept.T @ own))
        left = np.linalg.svd(own - nuisance @ (nuisance.T @ own))[1]
        return float(np.mean(1.0 / np.maximum(np.square(left), _DEPENDENT)))


def _unit(columns: FloatArray) -> FloatArray:
    """Return columns of length 1; zeros stay zeros."""
    lengths = np.linalg.norm(columns, axis=0)
    unit: FloatArray = columns / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the space that columns span."""
    left, sizes, _ = np.linalg.svd(_unit(columns), full_matrices=False)
    basis: FloatArray = left[:, sizes > _DEPENDENT]
    return basis


def make_design(
    formula: str,
    table: Mapping[str, Sequence[str | float]],
    *,
    subject: Sequence[str] | None = None,
    strata: Sequence[str] | None = None,
    categories: Collection[str] = (),
    order: Mapping[str, Sequence[str]] | None = None,
    names: Sequence[str] | None = None,
) -> Design:
    """Return the design that a formula describes, or refuse one that can't be estimated.

    Parameters
    ----------
    formula : str
        Such as ``"~ group * age + sex"``: columns, ``+``, ``:`` (interaction), ``*`` (both and their
        interaction), ``^`` and parentheses. Names with other characters stand in backticks.
    table : mapping of str to sequences
        Values of each column for the M rows; numbers may be text. Columns that the formula doesn't name are
        ignored.
    subject : sequence of str, optional
        Subject of each row, for repeated measures: rows of one subject are randomized together, in effects
        within subjects as in those between them.
    strata : sequence of str, optional
        Stratum of each row, such as its site: effects are those within strata.
    categories : collection of str
        Columns whose numbers are codes of categories.
    order : mapping of str to sequence of str, optional
        Levels of categories in order; the first is the reference. By default names of controls come first,
        the others in alphabetical order.
    names : sequence of str, optional
        Names of the rows, for messages.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        Before anything is computed, in one line: if the formula can't be read or names no column, a value is
        missing, a column is constant, terms are aliased (with the terms they can't be told from), an
        interaction has an empty cell, a term hangs on a single subject (with its variance inflation), or rows
        are too few for the columns.
    """
    factors = parsed(formula)
    used = list(dict.fromkeys(name for item in factors for name in item))
    for name in used:
        if name not in table:
            raise InputError(f"formula: there is no column {name!r}; columns are: {', '.join(table)}")
    sizes = {len(table[name]) for name in used} | {
        len(item) for item in (subject, strata) if item is not None
    }
    if len(sizes) != 1:
        raise InputError(f"{formula}: columns need one value for each row, not {sorted(sizes)} values")
    rows = sizes.pop()
    levels: dict[str, tuple[str, ...]] = {}
    codes: dict[str, IntArray] = {}
    values: dict[str, FloatArray] = {}
    for name in used:
        column = table[name]
        _refuse_missing(name, column, names)
        numeric = None if name in categories else _numeric(name, column, names)
        if numeric is None:
            texts = [str(value).strip() for value in column]
            levels[name] = tuple((order or {}).get(name) or reference_first(texts))
            unknown = sorted(set(texts) - set(levels[name]))
            if unknown:
                raise InputError(f"{name}: {unknown[0]!r} is not among {', '.join(levels[name])}")
            codes[name] = np.array([levels[name].index(text) for text in texts], np.int64)
            numbers_of = np.bincount(codes[name], minlength=len(levels[name]))
            if len(levels[name]) > 1 and numbers_of.min() < 2:
                few = levels[name][int(numbers_of.argmin())]
                raise InputError(
                    f"{name} {few!r} has {numbers_of.min()} of the two or more rows that a comparison needs"
                )
        else:
            values[name] = numeric
        if (numeric is None and len(levels[name]) < 2) or (numeric is not None and np.ptp(numeric) == 0.0):
            raise InputError(f"{name} is the same for all compared rows; remove it from the formula")
    if subject is not None:
        _refuse_missing("subject", subject, names)
    units = np.arange(rows) if subject is None else _codes(subject)
    design = Design(factors, levels, codes, values, units, None if strata is None else _codes(strata))
    design.check(names)
    return design


def _codes(values: Sequence[str]) -> IntArray:
    codes: IntArray = np.unique(np.array([str(value) for value in values]), return_inverse=True)[1].reshape(
        -1
    )
    return codes


def parsed(formula: str) -> tuple[tuple[str, ...], ...]:
    """Return the columns of each term, without the intercept.

    Names of columns are all that a formula may call: it is never evaluated, since a project may come from
    others.
    """
    from formulaic.errors import FormulaicError  # it loads pandas, which takes a second
    from formulaic.parser import DefaultFormulaParser

    text = formula.strip()
    right = text.removeprefix("~")
    if "~" in right:
        raise InputError(f"formula {formula!r}: shape is what is explained; begin with '~'")
    unreadable = f"formula {formula!r} can't be read; use columns, +, :, *, ^ and parentheses"
    try:
        parsed_terms = DefaultFormulaParser().get_terms(f"~ {right}").root
    except (FormulaicError, SyntaxError, AttributeError, TypeError, ValueError) as error:
        raise InputError(unreadable) from error
    if isinstance(parsed_terms, tuple):  # of each part around a "|"
        raise InputError(unreadable)
    terms: list[tuple[str, ...]] = []
    intercept = False
    for term in parsed_terms:
        if any(factor.eval_method.value == "literal" for factor in term.factors):
            intercept = intercept or str(term) == "1"
            continue
        for factor in term.factors:
            if factor.eval_method.value != "lookup":
                raise InputError(
                    f"formula: {factor.expr!r} is not a column; use columns, +, :, *, ^ and parentheses, and "
                    "add a column of computed values to the table"
                )
        terms.append(tuple(factor.expr.strip("`") for factor in term.factors))
    if not intercept:
        raise InputError(f"formula {formula!r}: the intercept belongs to every design; remove 0 and -1")
    if not terms:
        raise InputError(f"formula {formula!r}: name a column whose effect on shape is asked for")
    return tuple(terms)


def shorthand(tested: str, covariates: Sequence[str] = (), *, interaction: bool = False) -> str:
    """Return the formula of a simple question.

    Groups and a regression are one tested column; pairs are groups with a `subject`; change compared between
    groups is an `interaction` of group and time.

    Parameters
    ----------
    tested : str
        The column of groups or of numbers.
    covariates : sequence of str
        Columns to adjust for.
    interaction : bool
        Whether the first covariate interacts with the tested column.
    """
    names = (*covariates, tested)
    return formula_text([*((name,) for name in names), *([(names[0], tested)] if interaction else [])])


def formula_text(terms: Sequence[Sequence[str]]) -> str:
    """Return the formula of terms, the columns of each."""
    quoted = [[name if name.isidentifier() else f"`{name}`" for name in term] for term in terms]
    return "~ " + " + ".join(":".join(term) for term in quoted)


PERSON = "subject"
"""Column of the person, for several scans or sides of one."""
_BY_CHANCE, _BY_CHANCE_IF_ALIKE = 0.001, 0.05
"""Probability below which the rows of a column's values don't differ in another column by chance: of any
values, and of those that stand in the same number of rows, which is evidence, too."""
_MOST_LEVELS = 8
"""Most values of a balanced factor, such as a grade; more that stand in equally many rows are subjects."""
_AT_NAME_PARTS = re.compile(r"[-_. ]+"), re.compile(r"[-_. ]+(?=[^-_. ]*$)")
"""Where names are divided into a subject and what numbers its rows: at the first separator, or the last."""


def refuse_repeated(
    names: Sequence[str],
    unused: Mapping[str, Sequence[str | float]],
    used: Mapping[str, Sequence[str | float]],
    formula: str,
) -> None:
    """Refuse rows of the same subject in a design without a `subject`: 32 to 58 % false findings.

    A column ``subject`` decides. Otherwise a column, or the beginning of the names, names subjects if it has
    more values than rows of one value, and another column (of names, their rest) numbers the rows of each
    value, as visits and sides do: no two rows of a value agree in it, which by chance is rare. Where each
    value stands in the same number of rows, weaker evidence suffices, and of many values none is needed. Few
    rows at each of many sites are neither.

    Parameters
    ----------
    names : sequence of str
        Names of the M rows.
    unused, used : mappings of str to sequences
        Columns that the question does not use, and those that it does.
    formula : str
        The question as a formula, for the message.

    Raises
    ------
    InputError
        If a name stands in two rows, or an unused column or the names name subjects.
    """
    table = {name: [str(value).strip() for value in column] for name, column in {**used, **unused}.items()}
    rows = {"the names": list(names)} | {name: own for name, own in table.items() if name == PERSON}
    for where, own in rows.items():
        known = [value for value in own if not is_missing(value)]
        twice = next((value for value, count in Counter(known).items() if count > 1), None)
        if twice is not None and len(set(known)) > 1 and where not in used:
            raise InputError(
                f"{twice} stands in more than one row, and rows of one subject are not independent; ask "
                f'"{formula}" with {where if where in table else "a column"} as its subject, compare pairs, '
                "or keep one row of each"
            )
    if PERSON in table:
        return
    for name in unused:
        others = [column for other, column in table.items() if other != name]
        count = _persons(table[name], others)
        if count:
            raise InputError(
                f"column {name!r} names {count} subjects in {len(names)} rows, which are not independent; "
                f'ask "{formula}" with {name} as its subject, or as its strata if it is a site, '
                f"compare pairs, or add a column {PERSON!r} that tells who is who"
            )
    for split in _AT_NAME_PARTS:
        parts = [split.split(name, maxsplit=1) for name in names]
        first, rest = ([part[end] for part in parts] for end in (0, -1))
        count = _persons(first, [rest]) if len(set(rest)) < len(set(first)) else 0
        if count and all(len(part) == 2 for part in parts):
            raise InputError(
                f"by their names ({names[0]} …), the {len(names)} rows are of {count} subjects, and rows of "
                f"one subject are not independent; add a column {PERSON!r} that tells who is who, and ask "
                f'"{formula}" with it as its subject, or compare pairs'
            )


def _persons(values: Sequence[str], others: Iterable[Sequence[str]]) -> int:
    """Return how many subjects of several rows some values name; 0 if they name none."""
    counts = Counter(values).values()
    if any(map(is_missing, values)) or not 1 < max(counts) < len(counts):
        return 0
    alike = len(set(counts)) == 1
    chance = min((_chance_of_numbering(column, values) for column in others), default=1.0)
    named = chance <= (_BY_CHANCE_IF_ALIKE if alike else _BY_CHANCE) or (alike and len(counts) > _MOST_LEVELS)
    return len(counts) if named else 0


def _chance_of_numbering(column: Sequence[str], values: Sequence[str]) -> float:
    """Return how likely it is by chance that no two rows with the same of some values agree in a column.

    It is 1 where two rows agree.
    """
    if len(set(zip(values, column, strict=True))) < len(column):
        return 1.0
    pairs, alike = (sum(count * (count - 1) for count in Counter(own).values()) for own in (values, column))
    agree = alike / (len(column) * (len(column) - 1))
    return float((1.0 - agree) ** (pairs / 2))


def group_design(
    groups: Sequence[str], order: Sequence[str], covariates: FloatArray | None = None
) -> Hypothesis:
    """Return the hypothesis that tests for any difference between groups.

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
    Hypothesis

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
    return _adjusted("group", columns, covariates)


def regression_design(values: FloatArray, covariates: FloatArray | None = None) -> Hypothesis:
    """Return the hypothesis that tests for a linear effect of a continuous variable.

    Parameters
    ----------
    values : (M,) array_like
        The variable; coefficients are per its unit.
    covariates : (M, c) array, optional
        Columns from `homolog.statistics.design.covariate_columns`.

    Returns
    -------
    Hypothesis

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
    return _adjusted("variable", column[:, None], covariates)


def adjusted_design(columns: FloatArray, nuisance: FloatArray, name: str) -> Hypothesis:
    """Return the hypothesis that tests columns (M, d), adjusted for others (M, c) and an intercept.

    Raises
    ------
    InputError
        If the tested columns, called `name` in the message, are confounded with the others.
    """
    return _adjusted(name, columns, nuisance)


def paired_design(pairs: int) -> Hypothesis:
    """Return the hypothesis that tests whether the differences of pairs have mean zero."""
    if pairs < 2:
        raise InputError(f"a paired comparison needs at least two pairs, not {pairs}")
    ones = np.ones((pairs, 1))
    return Hypothesis("difference", ones, ones / np.sqrt(pairs), np.zeros((pairs, 0)), np.arange(pairs))


def _adjusted(name: str, columns: FloatArray, covariates: FloatArray | None) -> Hypothesis:
    ones = np.ones((len(columns), 1))
    nuisance = ones if covariates is None else np.hstack([ones, covariates])
    return _hypothesis(name, columns, nuisance, np.arange(len(columns)))


def _hypothesis(name: str, columns: FloatArray, nuisance: FloatArray, units: IntArray) -> Hypothesis:
    """Return the hypothesis on columns (M, d), adjusted for columns (M, q), the intercept first."""
    empty = np.zeros((len(columns), 0))
    basis = _extended(empty, nuisance, "a covariate is a combination of the others")
    both = _extended(basis, columns, f"{name} is confounded with the covariates")
    hypothesis = Hypothesis(
        name, columns - basis @ (basis.T @ columns), both[:, basis.shape[1] :], basis, units
    )
    if hypothesis.error_dof < 1:
        raise InputError(
            f"{len(columns)} subjects are too few for {both.shape[1]} columns of the design; use fewer "
            "covariates or more subjects"
        )
    return hypothesis


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
