"""Answers to questions: the statistics of `homolog.statistics` on a project's result."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.cohort.column_types import CATEGORY
from homolog.cohort.file_names import words_of_individual
from homolog.errors import InputError
from homolog.io.results import Result
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.comparison import Comparison, Options
from homolog.statistics.covariates import with_covariate_effects, with_unadjusted
from homolog.statistics.data_notes import PARTNER_MISSING, exclusion_notes, repeated_notes, spelling_notes
from homolog.statistics.design import covariate_columns, numbers
from homolog.statistics.studies import (
    compare_groups,
    compare_pairs,
    compare_two_groups,
    pair_members,
    regress,
)
from homolog.surfaces.nearest import areas_of_particles, nearest_particles
from homolog_app.report.request import (
    SHAPE_SIZE,
    SIZE,
    StudyRequest,
    category_of,
    column_of,
    columns_of,
    compared_shapes,
    levels,
)

__all__ = ["Study", "run_study", "study_options"]


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A question and its answer.

    Attributes
    ----------
    request : StudyRequest
        The question.
    overall : Comparison
        Comparison of all groups, or the only comparison.
    pairwise : tuple of Comparison
        Comparisons of all pairs of three or more groups.
    labels : tuple of str
        Value of the request's column for each subject of the result.
    left_out : dict
        Excluded subjects of the result, with reasons.
    areas : (N,) array
        Area of the mean surface that belongs to each particle [mm²].
    names : tuple of str
        The subjects of the result.
    notes : tuple of str
        Remarks on the data, each a sentence.
    """

    request: StudyRequest
    overall: Comparison
    pairwise: tuple[Comparison, ...]
    labels: tuple[str, ...]
    left_out: Mapping[str, str]
    areas: FloatArray
    names: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "areas", frozen(self.areas, np.float64))

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All comparisons, the overall one first."""
        return (self.overall, *self.pairwise)


def study_options(request: StudyRequest) -> Options:
    """Return the options of a question's computation."""
    return Options(
        alignment=request.alignment,
        modes=request.modes,
        permutations=request.permutations,
        null_repeats=request.null_repeats,
        seed=request.seed,
        answers=request.answers,
    )


def run_study(result: Result, request: StudyRequest, tick: Tick = no_tick) -> Study:
    """Answer a question.

    Parameters
    ----------
    result : Result
        Result of a project.
    request : StudyRequest
        The question.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If a column or group does not exist, values are missing, or there are too few subjects.
    """
    _check(result, request)
    labels = column_of(result, request.column)
    left_out = _left_out(result, request, labels)
    incomplete = dict(left_out)
    taking = np.array([name not in left_out for name in result.names])
    question = _Question(
        result,
        request,
        compared_shapes(result, request.alignment),
        [label if takes else "" for label, takes in zip(labels, taking, strict=True)],
        study_options(request),
        part_of(tick, 0.0, 0.6 if request.covariates else 1.0),
    )
    pairwise: tuple[Comparison, ...] = ()
    if request.kind == "regression":
        overall = _regression(question)
    elif request.kind == "pairs":
        overall = _pairs(question)
    elif len(request.between) > 2:
        overall, pairwise = compare_groups(
            question.shapes, question.labels, request.between, **_details(question)
        )
        pairwise = with_unadjusted(pairwise, _table(question, np.arange(len(labels)))[0])
    else:
        two = request.between[0], request.between[1]
        overall = compare_two_groups(question.shapes, question.labels, two, **_details(question))
    if request.covariates:
        overall = _with_covariates(question, overall, part_of(tick, 0.6, 1.0))
    taken = set(overall.subjects.tolist())
    if request.kind == "pairs":
        taken |= {index for index, label in enumerate(question.labels) if label in request.between}
    for index, name in enumerate(result.names):
        if index not in taken and name not in left_out:
            left_out[name] = f"{request.column} is {labels[index]!r}" if labels[index] else "no group"
    notes = [*study_notes(result, request), *exclusion_notes(incomplete)]
    if request.kind != "pairs":
        compared = [result.names[index] for index in overall.subjects.tolist()]
        notes += repeated_notes({name: words_of_individual(name) for name in compared})
    return Study(
        request,
        overall,
        pairwise,
        tuple(labels),
        left_out,
        _areas(result),
        tuple(result.names),
        tuple(notes),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Question:
    """A request with the shapes and labels of its subjects; labels of excluded ones are empty."""

    result: Result
    request: StudyRequest
    shapes: FloatArray
    labels: list[str]
    options: Options
    tick: Tick


class _Details(TypedDict):
    """Arguments of the comparisons of groups."""

    covariates: FloatArray | None
    options: Options
    names: Sequence[str]
    tick: Tick


def _check(result: Result, request: StudyRequest) -> None:
    """Raise InputError for invalid questions before any computation."""
    known = columns_of(result)
    named = [category_of(covariate, known)[0] for covariate in request.covariates]
    twice = [item for item, count in Counter(named).items() if count > 1]
    if twice:
        raise InputError(f"the covariate {twice[0]!r} is given twice; give it once")
    if request.kind == "pairs" and request.covariates:
        raise InputError("a paired comparison is made within pairs and has no covariates; omit them")
    plain, is_category = category_of(request.column, known)
    if is_category and (request.kind == "regression" or not plain.endswith(CATEGORY)):
        raise InputError(
            f"{request.column!r} is declared a category, which is possible for covariates only; compare the "
            f"groups of {plain!r} instead"
        )
    labels = column_of(result, request.column)
    groups = levels(labels)
    if not groups:
        raise InputError(
            f"column {request.column!r}: is empty; add its values with homolog table, or use another column"
        )
    for group in request.between:
        if group not in groups:
            raise InputError(
                f"column {request.column!r}: no subject is in {group!r}; groups are: {', '.join(groups)}"
            )
    if request.kind == "pairs" and len(request.between) != 2:
        raise InputError(
            f"a paired comparison is between two values of column {request.column!r}; choose two of: "
            f"{', '.join(groups)}"
        )
    if request.kind == "groups" and len(request.between) < 2:
        raise InputError(f"column {request.column!r}: has one group only; a comparison needs two")
    if plain in named:
        raise InputError(f"{request.column!r} is the tested variable itself; remove it from the covariates")


def _left_out(result: Result, request: StudyRequest, labels: Sequence[str]) -> dict[str, str]:
    """Return the subjects without a value, with reasons; empty unless complete cases are requested."""
    if not request.complete_cases:
        return {}
    known = columns_of(result)
    used = [category_of(covariate, known)[0] for covariate in request.covariates]
    used += [request.column] if request.kind == "regression" else []
    used += [request.pairs] if request.pairs else []
    reasons: dict[str, str] = {}
    for column in used:
        for index, value in enumerate(column_of(result, column)):
            compared = request.kind == "regression" or labels[index] in request.between
            if compared and not value:
                reasons.setdefault(result.names[index], f"no value of {column}")
    if request.kind == "pairs":
        reasons |= _partners(result, request, labels, reasons)
    return reasons


def _partners(
    result: Result, request: StudyRequest, labels: Sequence[str], excluded: Mapping[str, str]
) -> dict[str, str]:
    """Return the subjects whose partner is missing."""
    by_pair: dict[str, list[int]] = {}
    for index, pair in enumerate(column_of(result, request.pairs or "")):
        if labels[index] in request.between and pair and result.names[index] not in excluded:
            by_pair.setdefault(pair, []).append(index)
    alone = [members[0] for members in by_pair.values() if len(members) == 1]
    return {result.names[index]: PARTNER_MISSING for index in alone}


def _details(question: _Question) -> _Details:
    """Return the further arguments of a comparison of groups."""
    members = np.flatnonzero(np.isin(question.labels, question.request.between))
    return _Details(
        covariates=_covariates(question, members),
        options=question.options,
        names=question.result.names,
        tick=question.tick,
    )


def _regression(question: _Question) -> Comparison:
    request, names = question.request, question.result.names
    members = np.flatnonzero([bool(label) for label in question.labels])
    if not request.complete_cases:
        members = np.arange(len(names))
    cells = [question.labels[index] for index in members]
    covariate_columns({request.column: cells}, [names[index] for index in members])  # checks the cells
    values = numbers(cells)
    if values is None:
        raise InputError(f"column {request.column!r} contains text; compare its groups instead")
    extra = _covariates(question, members)
    regression = regress(
        question.shapes[members],
        values,
        request.column,
        covariates=None if extra is None else extra[members],
        options=question.options,
        names=[names[index] for index in members],
        tick=question.tick,
    )
    return regression.renumbered(members)


def _pairs(question: _Question) -> Comparison:
    request, names = question.request, question.result.names
    column = request.pairs or ""
    pairs = column_of(question.result, column)
    alone = [
        name
        for name, pair, label in zip(names, pairs, question.labels, strict=True)
        if label in request.between and not pair
    ]
    if alone:
        raise InputError(
            f"{column!r}: no pair for {', '.join(alone[:5])}; fill it in, or exclude such subjects "
            "(complete cases)"
        )
    first, second = pair_members(
        pairs,
        question.labels,
        (request.between[0], request.between[1]),
        names,
        column=column,
    )
    title = f"{request.between[1]} - {request.between[0]}"
    return compare_pairs(
        question.shapes, first, second, title, options=question.options, names=names, tick=question.tick
    )


def _covariates(question: _Question, members: IntArray) -> FloatArray | None:
    """Return covariates with a row for each subject; rows of subjects other than the members are zero."""
    if not question.request.covariates:
        return None
    names = question.result.names
    table, categories = _table(question, members)
    columns = covariate_columns(table, [names[index] for index in members], categories=categories)
    spread = np.zeros((len(names), columns.shape[1]))
    spread[members] = columns
    return spread


def _table(question: _Question, members: IntArray) -> tuple[dict[str, list[str]], set[str]]:
    """Return the members' values of each covariate, and which covariates are categories."""
    known = columns_of(question.result)
    table: dict[str, list[str]] = {}
    categories = set()
    for covariate in question.request.covariates:
        column, is_category = category_of(covariate, known)
        values = column_of(question.result, column)
        table[column] = [values[index] for index in members]
        if is_category:
            categories.add(column)
    return table, categories


def _with_covariates(question: _Question, overall: Comparison, tick: Tick) -> Comparison:
    """Return the comparison of all groups, or of the variable, with the effects of its covariates."""
    table, categories = _table(question, overall.subjects)
    own = [question.labels[index] for index in overall.subjects]
    tested = numbers(own) if question.request.kind == "regression" else own
    assert tested is not None
    return with_covariate_effects(
        overall, question.shapes, tested, table, categories=categories, options=question.options,
        tick=tick,
    )  # fmt: skip


def _areas(result: Result) -> FloatArray:
    """Return the area of the mean surface nearest to each particle [mm²]."""
    nearest = nearest_particles(result.mean_surface, result.world.mean(axis=0))
    return areas_of_particles(result.mean_surface, nearest, result.world.shape[1])


def study_notes(result: Result, request: StudyRequest) -> tuple[str, ...]:
    """Return notes on columns and on questions of earlier versions."""
    known = columns_of(result)
    covariates = dict(category_of(covariate, known) for covariate in request.covariates)
    columns = list(covariates)
    notes = []
    for column in dict.fromkeys([*([] if request.kind == "regression" else [request.column]), *columns]):
        values = column_of(result, column)
        if covariates.get(column, True) or numbers(values) is None:
            notes += spelling_notes(f"Column {column!r}", values)
    if SIZE in known and SIZE in (request.column, *columns):
        notes.append(f"'size' is the column of the cohort's table; the size of the shapes is {SHAPE_SIZE!r}.")
    if request.earlier:
        notes.append(
            "An earlier version stored this question and compared shapes as they lie. Now they are aligned "
            "rigidly before; alignment as-it-lies gives the earlier answer."
        )
    return tuple(notes)
