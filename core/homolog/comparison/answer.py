"""Answers: the tests of a question, asked of a sample."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from homolog.arrays import FloatArray, IntArray, data_frame, frozen, html_of
from homolog.cohort import outside_notes
from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.comparison.question import Question
from homolog.comparison.sample import LOG_SIZE, SHAPE_SIZE, SIZE, Sample, category_of, levels
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.anova import unequal_slopes
from homolog.statistics.comparison import Comparison, prepare_shapes
from homolog.statistics.covariates import with_covariate_effects, with_unadjusted
from homolog.statistics.data_notes import PARTNER_MISSING, exclusion_notes, spelling_notes
from homolog.statistics.design import (
    Design,
    covariate_columns,
    make_design,
    numbers,
    refuse_repeated,
    shorthand,
)
from homolog.statistics.studies import (
    compare_groups,
    compare_pairs,
    compare_two_groups,
    pair_members,
    regress,
)
from homolog.surfaces.nearest import areas_of_particles, nearest_particles

__all__ = [
    "Answer",
    "TextTable",
    "ask_groups",
    "column_notes",
    "members_of_pairs",
    "steps_of",
    "surface_areas",
]

TextTable = tuple[str, Mapping[str, str], Sequence[Sequence[str | float | int | None]]]
"""A table: file name, meanings of the columns, rows."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A question and its answer.

    Attributes
    ----------
    question : Question
        The question.
    overall : Comparison
        Comparison of all groups, or the only comparison.
    pairwise : tuple of Comparison
        Comparisons of all pairs of three or more groups.
    labels : tuple of str
        Value of the question's column for each subject of the sample.
    left_out : dict
        Excluded subjects of the sample, with reasons.
    areas : (N,) array
        Area of the mean surface that belongs to each particle [mm²]; 1 without a surface.
    names : tuple of str
        The subjects of the sample.
    notes : tuple of str
        Remarks on the data, each a sentence.
    steps : mapping of str to float
        For each numeric variable the step in which its effect is told: the power of ten nearest its standard
        deviation.
    edge : float
        Edge of the files' voxels [mm]; 0 if unknown. Positions are no finer than a tenth of it.
    """

    question: Question
    overall: Comparison
    pairwise: tuple[Comparison, ...]
    labels: tuple[str, ...]
    left_out: Mapping[str, str]
    areas: FloatArray
    names: tuple[str, ...]
    notes: tuple[str, ...] = ()
    steps: Mapping[str, float] = field(default_factory=dict)
    edge: float = 0.0

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "areas", frozen(self.areas, np.float64))

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All comparisons, the overall one first."""
        return (self.overall, *self.pairwise)

    @property
    def between_two(self) -> tuple[Comparison, ...]:
        """The comparisons of two groups, or the only comparison."""
        return self.pairwise or (self.overall,)

    @property
    def table_lines(self) -> list[str]:
        """Lines of a table that a printed answer begins with."""
        return []

    @property
    def further_lines(self) -> list[str]:
        """Lines that a printed answer has after its findings."""
        return []

    @property
    def tables(self) -> Iterable[TextTable]:
        """Tables besides those of all answers."""
        return ()

    def to_dataframe(self) -> Any:  # noqa: ANN401 - pandas is imported when it is needed
        """Return a `pandas.DataFrame`: the first of the answer's own tables, else that of its particles."""
        for _, columns, rows in self.tables:
            cells = zip(*rows, strict=True)
            return data_frame(dict(zip(columns, cells, strict=True)), range(1, len(rows) + 1), "row")
        return self.overall.to_dataframe()

    def _repr_html_(self) -> str:
        """Return the summary that notebooks show."""
        return html_of(self.question.title, self.to_dataframe(), [*self.further_lines, *self.notes])


def ask_groups(sample: Sample, question: Question, tick: Tick = no_tick) -> Answer:
    """Answer a question about groups, pairs or a variable.

    Parameters
    ----------
    sample : Sample
        The shapes and what is known of them.
    question : Question
        The question.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If a column or group does not exist, values are missing, or there are too few subjects.
    """
    _check(sample, question)
    labels = sample.texts(question.column)
    left_out = _left_out(sample, question, labels)
    taken = ["" if name in left_out else label for name, label in zip(sample.names, labels, strict=True)]
    _refuse_repeated(sample, question, taken)
    shapes, options = sample.compared(question.alignment), question.options
    main, later = part_of(tick, 0.0, 0.6 if question.covariates else 1.0), part_of(tick, 0.6, 1.0)
    pairwise: tuple[Comparison, ...] = ()
    if question.kind == "regression":
        overall = _regression(sample, question, taken, main)
    elif question.kind == "pairs":
        first, second = members_of_pairs(sample, question, taken)
        title = f"{question.between[1]} - {question.between[0]}"
        overall = compare_pairs(shapes, first, second, title, options=options, names=sample.names, tick=main)
    else:
        members = np.flatnonzero(np.isin(taken, question.between))
        columns = _covariates(sample, question, members)
        if question.covariates:
            _design(sample, question, members)  # refuses what can't be estimated before it is computed
        if len(question.between) > 2:
            overall, pairwise = compare_groups(
                shapes,
                taken,
                question.between,
                covariates=columns,
                options=options,
                names=sample.names,
                tick=main,
            )
            pairwise = with_unadjusted(pairwise, _table(sample, question, np.arange(len(labels)))[0])
        else:
            two = question.between[0], question.between[1]
            overall = compare_two_groups(
                shapes, taken, two, covariates=columns, options=options, names=sample.names, tick=main
            )
    if question.covariates:
        table, categories = _table(sample, question, overall.subjects)
        own = [labels[index] for index in overall.subjects]
        tested = numbers(own) if question.kind == "regression" else own
        assert tested is not None
        overall = with_covariate_effects(
            overall, shapes, tested, table, categories=categories, options=options, tick=later
        )
    notes = [*_notes(sample, question), *exclusion_notes(left_out)]
    if question.kind == "groups" and question.covariates:
        notes += _slope_notes(sample, question, overall, shapes)
    others = _others(sample, question, overall, labels, left_out)
    return Answer(
        question,
        overall,
        pairwise,
        tuple(labels),
        left_out | others,
        surface_areas(sample),
        sample.names,
        tuple(notes),
        _steps(sample, question, overall),
        sample.edge,
    )


def _steps(sample: Sample, question: Question, overall: Comparison) -> dict[str, float]:
    """Return the power of ten nearest the standard deviation of each numeric variable."""
    named = dict(category_of(covariate, sample.columns) for covariate in question.covariates)
    named |= {question.column: False} if question.kind == "regression" else {}
    variables = {}
    for column, is_category in named.items():
        cells = [sample.column(column)[index] for index in overall.subjects.tolist()]
        if not is_category and (values := numbers(cells)) is not None:
            variables[column] = values
    return steps_of(variables)


def steps_of(variables: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return the power of ten nearest the standard deviation of each variable that has one."""
    spreads = {name: float(values.std(ddof=1)) for name, values in variables.items()}
    return {name: float(10.0 ** round(np.log10(spread))) for name, spread in spreads.items() if spread > 0.0}


def _refuse_repeated(sample: Sample, question: Question, taken: Sequence[str]) -> None:
    """Refuse several rows of one subject, unless they are compared as pairs."""
    if question.kind == "pairs":
        return
    groups = question.between or levels(taken)
    rows = [row for row, label in enumerate(taken) if label in groups]
    named = [category_of(name, sample.columns)[0] for name in question.covariates]
    table = {name: [sample.texts(name)[row] for row in rows] for name in sample.columns}
    refuse_repeated(
        [sample.names[row] for row in rows],
        {plain_name(name): own for name, own in table.items() if name not in (question.column, *named)},
        {plain_name(name): own for name, own in table.items() if name in (question.column, *named)},
        shorthand(question.column, list(map(plain_name, named))),
    )


def _design(sample: Sample, question: Question, members: IntArray) -> Design:
    """Return the formula of groups and covariates; raise InputError if it can't be estimated."""
    table, categories = _table(sample, question, members)
    table = {plain_name(name): cells for name, cells in table.items()}
    covariates, labels = list(table), sample.texts(question.column)
    table[question.column] = [labels[index] for index in members.tolist()]
    return make_design(
        shorthand(question.column, covariates),
        table,
        categories={question.column, *map(plain_name, categories)},
        names=[sample.names[index] for index in members.tolist()],
    )


def _slope_notes(sample: Sample, question: Question, overall: Comparison, shapes: FloatArray) -> list[str]:
    """Return notes on covariates whose slope differs between the compared groups."""
    return unequal_slopes(
        prepare_shapes(shapes[overall.subjects], question.options),
        _design(sample, question, overall.subjects),
        [question.column],
        permutations=question.permutations,
        seed=question.seed,
    )


def _others(
    sample: Sample,
    question: Question,
    overall: Comparison,
    labels: Sequence[str],
    left_out: Mapping[str, str],
) -> dict[str, str]:
    """Return the subjects that belong to no compared group, with reasons."""
    compared = {sample.names[index] for index in overall.subjects.tolist()}
    return {
        name: f"{question.column} is {label!r}" if label else "no group"
        for name, label in zip(sample.names, labels, strict=True)
        if name not in left_out
        and name not in compared
        and not (question.kind == "pairs" and label in question.between)
    }


def _check(sample: Sample, question: Question) -> None:
    """Raise InputError for invalid questions before any computation."""
    known = sample.columns
    named = [category_of(covariate, known)[0] for covariate in question.covariates]
    twice = [item for item, count in Counter(named).items() if count > 1]
    if twice:
        raise InputError(f"the covariate {twice[0]!r} is given twice; give it once")
    if question.kind == "pairs" and question.covariates:
        raise InputError("a paired comparison is made within pairs and has no covariates; omit them")
    plain, is_category = category_of(question.column, known)
    if is_category and (question.kind == "regression" or not plain.endswith(CATEGORY)):
        raise InputError(
            f"{question.column!r} is declared a category, which is possible for covariates only; compare the "
            f"groups of {plain!r} instead"
        )
    groups = levels(sample.column(question.column))
    if not groups:
        raise InputError(
            f"column {question.column!r}: is empty; add its values with homolog table, or use another column"
        )
    for group in question.between:
        if group not in groups:
            raise InputError(
                f"column {question.column!r}: no subject is in {group!r}; groups are: {', '.join(groups)}"
            )
    if question.kind == "pairs" and len(question.between) != 2:
        raise InputError(
            f"a paired comparison is between two values of column {question.column!r}; choose two of: "
            f"{', '.join(groups)}"
        )
    if question.kind == "groups" and len(question.between) < 2:
        count = "has one group only" if len(groups) < 2 else f"only {groups[0]!r} is given"
        raise InputError(f"column {question.column!r}: {count}; a comparison needs two")
    if plain in named:
        raise InputError(f"{question.column!r} is the tested variable itself; remove it from the covariates")


def _left_out(sample: Sample, question: Question, labels: Sequence[str]) -> dict[str, str]:
    """Return the subjects without a value or partner, with reasons, if complete cases are requested."""
    if not question.complete_cases:
        return {}
    used = [category_of(covariate, sample.columns)[0] for covariate in question.covariates]
    used += [question.column] if question.kind == "regression" else []
    used += [question.pairs] if question.pairs else []
    compared = [question.kind == "regression" or label in question.between for label in labels]
    reasons: dict[str, str] = {}
    for column in used:
        for name, value, is_compared in zip(sample.names, sample.texts(column), compared, strict=True):
            if is_compared and not value:
                reasons.setdefault(name, f"no value of {column.removesuffix(CATEGORY)}")
    if question.pairs:
        pairs = sample.texts(question.pairs)
        kept = [
            (pair, name)
            for pair, name, is_compared in zip(pairs, sample.names, compared, strict=True)
            if is_compared and name not in reasons
        ]
        counts = Counter(pair for pair, _ in kept)
        reasons |= {name: PARTNER_MISSING for pair, name in kept if counts[pair] == 1}
    return reasons


def _regression(sample: Sample, question: Question, taken: Sequence[str], tick: Tick) -> Comparison:
    members = np.arange(len(taken))
    if question.complete_cases:
        members = np.flatnonzero([bool(label) for label in taken])
    names = [sample.names[index] for index in members.tolist()]
    cells = [taken[index] for index in members.tolist()]
    covariate_columns({question.column: cells}, names)  # checks the cells
    values = numbers(cells)
    if values is None:
        raise InputError(f"column {question.column!r} contains text; compare its groups instead")
    extra = _covariates(sample, question, members)
    return regress(
        sample.compared(question.alignment)[members],
        values,
        question.column,
        covariates=None if extra is None else extra[members],
        options=question.options,
        names=names,
        tick=tick,
    ).renumbered(members)


def members_of_pairs(sample: Sample, question: Question, labels: Sequence[str]) -> tuple[IntArray, IntArray]:
    """Return the indices of the first and the second member of each pair, (P,) each.

    Labels of excluded subjects are empty.

    Raises
    ------
    InputError
        If a subject has no pair, or a pair not two members.
    """
    column = question.pairs or ""
    pairs = sample.texts(column)
    alone = [
        name
        for name, pair, label in zip(sample.names, pairs, labels, strict=True)
        if label in question.between and not pair
    ]
    if alone:
        raise InputError(
            f"{column!r}: no pair for {', '.join(alone[:5])}; fill it in, or exclude such subjects "
            "(complete cases)"
        )
    two = question.between[0], question.between[1]
    return pair_members(pairs, labels, two, sample.names, column=column)


def _covariates(sample: Sample, question: Question, members: IntArray) -> FloatArray | None:
    """Return covariates with a row for each subject; rows of subjects other than the members are zero."""
    if not question.covariates:
        return None
    table, categories = _table(sample, question, members)
    columns = covariate_columns(table, [sample.names[index] for index in members], categories=categories)
    spread = np.zeros((len(sample.names), columns.shape[1]))
    spread[members] = columns
    return spread


def _table(
    sample: Sample, question: Question, members: IntArray
) -> tuple[dict[str, list[str | float]], set[str]]:
    """Return the members' values of each covariate, and which covariates are categories."""
    named = dict(category_of(covariate, sample.columns) for covariate in question.covariates)
    table = {column: [sample.column(column)[index] for index in members] for column in named}
    return table, {column for column, is_category in named.items() if is_category}


def surface_areas(sample: Sample) -> FloatArray:
    """Return the area of the mean surface nearest to each particle [mm²]."""
    if sample.mean_surface is None:
        return np.ones(sample.shapes.shape[1])
    nearest = nearest_particles(sample.mean_surface, sample.shapes.mean(axis=0))
    return areas_of_particles(sample.mean_surface, nearest, sample.shapes.shape[1])


def column_notes(sample: Sample, categories: Sequence[str], variables: Sequence[str]) -> list[str]:
    """Return notes on spellings of categories, on numbers outside their column, and on the name of size."""
    notes = []
    for column in categories:
        notes += spelling_notes(f"Column {column!r}", sample.texts(column))
    known = [column for column in variables if column != LOG_SIZE]
    for column in known:
        notes += outside_notes(column, dict(zip(sample.names, sample.texts(column), strict=True)))
    if SIZE in sample.columns and SIZE in (*categories, *variables):
        notes.append(f"'size' is the column of the cohort's table; the size of the shapes is {SHAPE_SIZE!r}.")
    return notes


def _is_number(sample: Sample, column: str) -> bool:
    return numbers([value for value in sample.texts(column) if value]) is not None


def _notes(sample: Sample, question: Question) -> list[str]:
    """Return notes on columns and on questions of earlier versions."""
    covariates = dict(category_of(covariate, sample.columns) for covariate in question.covariates)
    tested = {question.column: question.kind != "regression"}
    named = tested | covariates
    numeric = {name for name, is_category in named.items() if not is_category and _is_number(sample, name)}
    notes = column_notes(sample, [name for name in named if name not in numeric], sorted(numeric))
    if question.earlier:
        notes.append(
            "An earlier version stored this question and compared shapes as they lie. Now they are aligned "
            "rigidly before; alignment as-it-lies gives the earlier answer."
        )
    return notes
