"""Questions about groups or a number: computation, repetition, storage, and maps of their answers."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from homolog.arrays import BoolArray, Float32Array, FloatArray, IntArray
from homolog.cohort import Cohort
from homolog.comparison.answer import Answer, members_of_pairs
from homolog.comparison.ask import ask
from homolog.comparison.formula import FormulaAnswer
from homolog.comparison.question import Question
from homolog.comparison.sample import Sample, category_of
from homolog.errors import InputError
from homolog.io.results import Result
from homolog.progress import Tick, part_of
from homolog.statistics.cautions import LEVEL
from homolog.statistics.comparison import Comparison
from homolog.statistics.procrustes import aligned
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import nearest_particles
from homolog_app.rendering.colours import common_limit
from homolog_app.rendering.text import short
from homolog_app.scenes.model_shape import ModelShape

__all__ = [
    "Answers",
    "Asked",
    "GroupAnswer",
    "GroupMap",
    "answer_groups",
    "answer_question",
    "carried_answer",
    "map_answers",
    "question_of",
]


@dataclass(frozen=True, slots=True, eq=False)
class GroupMap:
    """The displacement from the first group to the second on the mean surface of both.

    Attributes
    ----------
    ways : (V, 3) array
        Displacement of each vertex [mm].
    outward : (V,) array
        Its part along the outward normals [mm].
    significant : (V,) bool array
        For the difference: FWE-corrected p of the nearest particle is at most 0.05. For the discriminant: the
        95 % bootstrap bounds exclude zero, and the test of the whole shape is significant.
    """

    ways: Float32Array
    outward: Float32Array
    significant: BoolArray

    def middle(self, mesh: TriangleMesh) -> int:
        """Return the vertex of the surface nearest to the centre of the largest significant region."""
        edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]]])
        kept = edges[self.significant[edges].all(axis=1)]
        count = len(self.significant)
        graph = coo_matrix((np.ones(len(kept)), kept.T), shape=(count, count))
        labels = connected_components(graph, directed=False)[1]
        largest = np.bincount(labels[self.significant]).argmax()
        chosen = np.flatnonzero(self.significant & (labels == largest))
        away = mesh.vertices[chosen] - mesh.vertices[chosen].mean(axis=0)
        return int(chosen[np.linalg.norm(away, axis=1).argmin()])


@dataclass(frozen=True, slots=True, eq=False)
class GroupAnswer:
    """The answer for two groups, or for a number, in the model of one run.

    Attributes
    ----------
    shape : ModelShape
    study : Answer
        All comparisons.
    pair : Comparison
        Comparison of the two mapped groups, or the regression.
    first, second : str
        Names of these groups, or the lowest and the highest value as text.
    start : (V, 3) array
        Displacement of the model's mean surface to the first group's mean, or to the shape at the lowest
        value [mm].
    difference : GroupMap
        From `start` to the second group or value.
    discriminant : GroupMap or None
        Along the linear discriminant; None without retained modes, and for a regression.
    places : (m,) array or None
        Positions of the subjects along the discriminant, the mean difference of pairs, or the effect of the
        number, as root mean square displacement of the particles [mm].
    values : (m,) array or None
        Values of the number, for a regression.
    groups : tuple of str
        Compared groups of these subjects, for a number their groups in the current table.
    limit : float
        End of the colour scale that fits both maps [mm].
    subjects : (m,) int array
        Indices of the subjects with a position: those of the compared groups; for pairs, the first and second
        members.
    """

    shape: ModelShape
    study: Answer
    pair: Comparison
    first: str
    second: str
    start: Float32Array
    difference: GroupMap
    discriminant: GroupMap | None
    places: FloatArray | None
    limit: float
    values: FloatArray | None = None
    groups: tuple[str, ...] = ()
    subjects: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def ends(self) -> tuple[str, str]:
        """Labels of both ends of the morph."""
        if self.study.question.kind == "formula" and self.values is None:
            return self.first, self.second
        if self.values is None:
            return f"mean of {self.first}", f"mean of {self.second}"
        return f"{self.pair.title} {self.first}", f"{self.pair.title} {self.second}"

    def at(self, way: float) -> str:
        """Return the label of a position on the morph, 0 at the first and 1 at the second."""
        if self.values is None:
            return f"{self.first} to {self.second} at {100 * way:.0f} %"
        low, high = float(self.values.min()), float(self.values.max())
        return f"{self.pair.title} {short(low + way * (high - low))}"


def answer_groups(
    shape: ModelShape, result: Result, request: Question, tick: Tick, pair: int = 0
) -> GroupAnswer:
    """Answer a question, and map the difference of two of its groups, or the slope, to the surface.

    Parameters
    ----------
    shape : ModelShape
    result : Result
        Result of the model, with the columns of the question.
    request : Question
        Request of any kind.
    tick : Tick
        Progress and cancellation.
    pair : int
        Index of the two groups among the study's pairs.

    Raises
    ------
    InputError
        If groups are too small or values are missing; the message names them.
    """
    study = ask(Sample.of(result), request, part_of(tick, 0.0, 0.9))
    return carried_answer(shape, result, study, pair, part_of(tick, 0.9, 1.0))


def carried_answer(shape: ModelShape, result: Result, study: Answer, index: int, tick: Tick) -> GroupAnswer:
    """Map the difference of a study's pair of groups, or its slope, to the surface.

    Raises
    ------
    InputError
        If the study has no such pair.
    """
    tick(0.0, "mapping the difference to the surface")
    pairs, request = study.between_two, study.question
    if index >= len(pairs):
        raise InputError(f"there is no pair {index} of groups; there are {len(pairs)}")
    pair = pairs[index]
    separation = pair.discriminant
    if isinstance(study, FormulaAnswer):
        way = _of_term(study, index)
    else:
        way = _slope(study, pair) if request.kind == "regression" else _between(request, pair)
    subjects = pair.subjects if request.kind != "pairs" else _paired(result, study)
    fields = [pair.mean - shape.model.mean_ - way.share * way.effect, way.effect]
    carried = shape.carried(np.array([*fields, *(separation.modes if separation is not None else ())]))
    start, ways = carried[0], carried[1]
    middle = start + np.float32(way.share) * ways
    normals = shape.normals(shape.mean.vertices.astype(np.float32) + middle)
    nearest = nearest_particles(shape.mean, shape.model.mean_)
    outward = np.einsum("...vi,vi->...v", carried[1:], normals)
    difference = GroupMap(ways, outward[0], pair.p_fwe[nearest] <= LEVEL)
    discriminant = places = None
    if separation is not None and len(separation.modes):
        low, high = separation.bounds(outward[1:])
        along = np.tensordot(separation.weights.astype(np.float32), carried[2:], axes=1)
        firm = ((low > 0) | (high < 0)) & (pair.p_adjusted <= LEVEL)
        discriminant = GroupMap(along, separation.weights.astype(np.float32) @ outward[1:], firm)
        places = separation.cross_validated
    elif way.labels or way.values is not None or request.kind == "pairs":
        places = _along(result, request, pair, subjects, way.effect)
        places = places - places.mean() if way.values is None else places
    maps = [item.outward for item in (difference, discriminant) if item is not None]
    return GroupAnswer(
        shape,
        study,
        pair,
        way.first,
        way.second,
        start,
        difference,
        discriminant,
        places,
        max(common_limit([np.asarray(values, np.float64)]) for values in maps),
        way.values,
        way.labels or _labels(result, study, subjects),
        subjects,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _MorphPath:
    """Names of start and end, the effect (N, 3), and the share of it before the subjects' mean."""

    first: str
    second: str
    effect: FloatArray
    share: float
    values: FloatArray | None = None
    labels: tuple[str, ...] = ()


def _of_term(study: FormulaAnswer, index: int) -> _MorphPath:
    """Return the path of a term: between two levels, along a number, or from no interaction to that found.

    Of a category with more levels it is the difference of the first two, and the significance of all.
    """
    pair, design, factors = study.terms[index], study.design, study.design.terms[index].factors
    along = [design.numbers[name] for name in factors if name in design.numbers]
    effect = pair.pointwise.effect[0] * float(np.prod([np.ptp(values) for values in along]))
    if len(factors) > 1:
        return _MorphPath("sum of effects", "with interaction", effect, 0.5)
    if along:
        low, high = float(along[0].min()), float(along[0].max())
        share = float((along[0].mean() - low) / (high - low))
        return _MorphPath(short(low), short(high), effect, share, along[0])
    first, second, *others = design.levels[factors[0]]
    labels = () if others else design.labels(factors[0])
    return _MorphPath(first, second, effect, 0.5, labels=labels)


def _between(request: Question, pair: Comparison) -> _MorphPath:
    if request.kind == "pairs":
        first, second = request.between
        return _MorphPath(first, second, pair.pointwise.effect[0], 0.0)  # the mean of the first members
    first, second = pair.counts
    return _MorphPath(
        first, second, pair.pointwise.effect[0], pair.counts[second] / sum(pair.counts.values())
    )


def _labels(result: Result, study: Answer, subjects: IntArray) -> tuple[str, ...]:
    """Return the compared groups of subjects, or those of the current table."""
    own = study.labels if study.question.between else [group or "" for group in result.groups]
    return tuple(own[subject] for subject in subjects)


def _slope(study: Answer, pair: Comparison) -> _MorphPath:
    """Return the path from the lowest to the highest value."""
    values = np.array([float(study.labels[subject]) for subject in pair.subjects])
    low, high = float(values.min()), float(values.max())
    first, second = short(low), short(high)
    share = float((values.mean() - low) / (high - low))
    return _MorphPath(first, second, pair.pointwise.effect[0] * (high - low), share, values)


def _paired(result: Result, study: Answer) -> IntArray:
    """Return the subjects of all pairs: all first members, then all second ones."""
    taking = [
        label if name not in study.left_out else ""
        for name, label in zip(result.names, study.labels, strict=True)
    ]
    return np.concatenate(members_of_pairs(Sample.of(result), study.question, taking))


def _along(
    result: Result, request: Question, pair: Comparison, subjects: IntArray, effect: FloatArray
) -> FloatArray:
    """Return the position of each subject along an effect (N, 3), as RMS over the particles [mm]."""
    own = Sample.of(result).compared(request.alignment)[subjects]
    shapes = aligned(own, request.alignment) - pair.mean
    length = max(float(np.linalg.norm(effect)), np.finfo(float).tiny)
    return np.asarray(np.einsum("mni,ni->m", shapes, effect) / length / np.sqrt(len(effect)))


@dataclass(frozen=True, slots=True)
class Asked:
    """Requests that are answered together, and their data.

    Attributes
    ----------
    requests : tuple of Question
        A request, or one for each alignment.
    cells : tuple of (str, ...)
        The used columns of the table, with a value for each subject of the result.
    """

    requests: tuple[Question, ...]
    cells: tuple[tuple[str, ...], ...]

    @property
    def titles(self) -> frozenset[str]:
        """Identifiers of the requests, regardless of the precision of their answers."""
        return frozenset(request.identity for request in self.requests)

    @property
    def arguments(self) -> list[str]:
        """The equivalent options of ``homolog analyze``."""
        return [*self.requests[0].arguments, *(request.alignment.value for request in self.requests[1:])]


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """The answers to a question.

    Attributes
    ----------
    question : Asked
    models : tuple of ModelShape
        Models that were tested: that of the open result, and optionally one for comparison.
    studies : tuple of (Answer, ...)
        Studies of each model, for each request.
    """

    question: Asked
    models: "tuple[ModelShape, ...]"
    studies: "tuple[tuple[Answer, ...], ...]"

    @property
    def own(self) -> "tuple[Answer, ...]":
        """The studies of the open result, one for each request."""
        return tuple(row[0] for row in self.studies)


def question_of(requests: Sequence[Question], result: Result, cohort: Cohort) -> Asked:
    """Return a question with the table's current values, so that later changes can be detected."""
    present = result.with_table_of(cohort.subjects)
    known = dict.fromkeys(name for columns in present.columns for name in columns)
    used = [request.column for request in requests]
    used += [category_of(name, known)[0] for request in requests for name in request.named_columns]
    for request in requests:
        used += [name for name in (request.pairs, request.subject, request.strata) if name]
    cells = tuple(
        tuple(group or "" for group in present.groups)
        if column == "group"
        else tuple(columns.get(column, "") for columns in present.columns)
        for column in dict.fromkeys(used)
    )
    return Asked(tuple(requests), cells)


def answer_question(
    models: "Sequence[ModelShape]", cohort: Cohort, requests: Sequence[Question], tick: Tick
) -> "tuple[Answers, list[GroupAnswer]]":
    """Answer all requests in each model, and map the first two groups' difference to the surface.

    Raises
    ------
    InputError
        If groups are too small or values are missing; the message names them.
    """
    count = len(models) * len(requests)
    studies: list[Answer] = []
    for index, request in enumerate(requests):
        for number, model in enumerate(models):
            done = index * len(models) + number
            part = part_of(tick, 0.9 * done / count, 0.9 * (done + 1) / count)
            studies.append(ask(Sample.of(model.result.with_table_of(cohort.subjects)), request, part))
    rows = tuple(tuple(studies[at : at + len(models)]) for at in range(0, count, len(models)))
    answers = Answers(question_of(requests, models[0].result, cohort), tuple(models), rows)
    return answers, map_answers(answers, models, cohort, (0, 0), part_of(tick, 0.9, 1.0))


def map_answers(
    answers: Answers, models: "Sequence[ModelShape]", cohort: Cohort, which: tuple[int, int], tick: Tick
) -> "list[GroupAnswer]":
    """Map a difference or slope to the surfaces of the displayed models.

    Parameters
    ----------
    answers : Answers
    models : sequence of ModelShape
        The displayed models.
    cohort : Cohort
        All subjects with the current table.
    which : (int, int)
        Indices of request and pair of groups.
    tick : Tick
        Progress and cancellation.
    """
    return [
        carried_answer(model, model.result.with_table_of(cohort.subjects), study, which[1], tick)
        for model, study in zip(answers.models, answers.studies[which[0]], strict=True)
        if model in models
    ]
