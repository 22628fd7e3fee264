"""A question answered: the statistics of `homolog.analysis` on a project's result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from homolog.analysis.comparison import Comparison, Options
from homolog.analysis.covariates import covariate_columns, numbers
from homolog.analysis.procrustes import sizes
from homolog.analysis.studies import compare_groups, compare_pairs, compare_two_groups, regress
from homolog.arrays import FloatArray, IntArray
from homolog.errors import InputError
from homolog.files.results import Result
from homolog.progress import Tick, no_tick
from homolog_app.report.request import StudyRequest

__all__ = ["Study", "column_of", "levels", "run_study"]

SIZE = "size"


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A question and its answer.

    Attributes
    ----------
    request : StudyRequest
        The question.
    overall : Comparison
        Of all the groups, or the only comparison.
    pairwise : tuple of Comparison
        Each two of three or more groups.
    labels : tuple of str
        Value of the request's column for each subject of the result.
    """

    request: StudyRequest
    overall: Comparison
    pairwise: tuple[Comparison, ...]
    labels: tuple[str, ...]

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All of them, the overall one first."""
        return (self.overall, *self.pairwise)


def levels(values: Sequence[str]) -> list[str]:
    """Return the different values in the order in which they appear, empty ones left out."""
    return [value for value in dict.fromkeys(values) if value]


def column_of(result: Result, column: str) -> list[str]:
    """Return a column of the cohort's table for each subject; ``group`` and ``size`` are always there.

    Raises
    ------
    InputError
        If there is no such column.
    """
    if column == "group":
        return [one or "" for one in result.groups]
    if column == SIZE:
        return [repr(float(one)) for one in sizes(result.world)]
    known = sorted({name for columns in result.columns for name in columns})
    if column not in known:
        there = ", ".join(["group", SIZE, *known])
        raise InputError(f"there is no column {column!r}; the cohort has: {there}")
    return [columns.get(column, "") for columns in result.columns]


def run_study(result: Result, request: StudyRequest, tick: Tick = no_tick) -> Study:
    """Answer a question.

    Parameters
    ----------
    result : Result
        Of a project.
    request : StudyRequest
        The question.
    tick : Tick
        Progress and cancelling.

    Raises
    ------
    InputError
        If a column or group is not there, values are missing, or subjects are too few; says which.
    """
    labels = column_of(result, request.column)
    run = {"groups": _groups, "regression": _regression, "pairs": _pairs}[request.kind]
    options = Options(
        scaling=request.scaling,
        modes=request.modes,
        permutations=request.permutations,
        null_repeats=request.null_repeats,
        seed=request.seed,
    )
    overall, pairwise = run(result, request, labels, options, tick)
    return Study(request, overall, pairwise, tuple(labels))


_Answer = tuple[Comparison, tuple[Comparison, ...]]


def _groups(
    result: Result, request: StudyRequest, labels: Sequence[str], options: Options, tick: Tick
) -> _Answer:
    for group in request.between:
        if group not in labels:
            there = ", ".join(levels(labels))
            raise InputError(f"column {request.column!r}: no subject is in {group!r}; there are: {there}")
    members = np.flatnonzero(np.isin(labels, request.between))
    extra = _covariates(result, request, members)
    if len(request.between) > 2:
        return compare_groups(
            result.world,
            labels,
            request.between,
            covariates=extra,
            options=options,
            names=result.names,
            tick=tick,
        )
    if len(request.between) < 2:
        raise InputError(f"column {request.column!r}: has one group only; a comparison needs two")
    two = request.between[0], request.between[1]
    found = compare_two_groups(
        result.world, labels, two, covariates=extra, options=options, names=result.names, tick=tick
    )
    return found, ()


def _regression(
    result: Result, request: StudyRequest, labels: Sequence[str], options: Options, tick: Tick
) -> _Answer:
    covariate_columns({request.column: labels}, result.names)  # names what is missing or constant
    values = numbers(labels)
    if values is None:
        raise InputError(
            f"column {request.column!r} holds words; compare its groups in place of a regression"
        )
    extra = _covariates(result, request, np.arange(len(labels)))
    found = regress(
        result.world,
        values,
        request.column,
        covariates=extra,
        options=options,
        names=result.names,
        tick=tick,
    )
    return found, ()


def _pairs(
    result: Result, request: StudyRequest, labels: Sequence[str], options: Options, tick: Tick
) -> _Answer:
    if len(request.between) != 2 or request.covariates:
        raise InputError("a paired comparison is between two values of a column and takes no covariates")
    found: dict[str, dict[str, int]] = {}
    for index, (pair, label) in enumerate(zip(column_of(result, request.pairs or ""), labels, strict=True)):
        if label in request.between and pair:
            if label in found.setdefault(pair, {}):
                raise InputError(f"{result.names[index]}: pair {pair!r} has two subjects that are {label!r}")
            found[pair][label] = index
    alone = [pair for pair, both in found.items() if len(both) < 2]
    if alone:
        raise InputError(f"pair {alone[0]!r} has one subject only; leave it out or add the other one")
    first, second = (_indices(found, label) for label in request.between)
    title = f"{request.between[1]} - {request.between[0]}"
    comparison = compare_pairs(
        result.world, first, second, title, options=options, names=result.names, tick=tick
    )
    return comparison, ()


def _indices(pairs: Mapping[str, Mapping[str, int]], label: str) -> IntArray:
    return np.array([both[label] for both in pairs.values()], dtype=np.int64)


def _covariates(result: Result, request: StudyRequest, members: IntArray) -> FloatArray | None:
    """Covariates of the members in the rows of all subjects; rows of others are zero and not used."""
    if not request.covariates:
        return None
    table = {}
    for column in request.covariates:
        values = column_of(result, column)
        table[column] = [values[index] for index in members]
    columns = covariate_columns(table, [result.names[index] for index in members])
    spread = np.zeros((len(result.names), columns.shape[1]))
    spread[members] = columns
    return spread
