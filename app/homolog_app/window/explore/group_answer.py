"""The answer to a question about groups or a number, carried to the surface. Knows no Qt."""

from dataclasses import dataclass

import numpy as np

from homolog.analysis.comparison import Comparison, prepare_shapes
from homolog.arrays import BoolArray, Float32Array, FloatArray
from homolog.errors import InputError
from homolog.files.results import Result
from homolog.progress import Tick, part_of
from homolog.surfaces.nearest import nearest_particles
from homolog_app.pictures import common_limit
from homolog_app.rendering.text import short
from homolog_app.report.findings import LEVEL
from homolog_app.report.request import StudyRequest
from homolog_app.report.study import Study, compared_shapes, run_study, study_options
from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["GroupAnswer", "GroupMap", "answer_groups", "carried_answer"]


@dataclass(frozen=True, slots=True, eq=False)
class GroupMap:
    """A way from the first group to the second on the mean surface of both.

    Attributes
    ----------
    ways : (V, 3) array
        Displacement of each vertex [mm].
    outward : (V,) array
        Its part along the outward normals [mm].
    significant : (V,) bool array
        For the difference: family-wise corrected p of the nearest particle at most 0.05. For the
        discriminant: the 95 % bootstrap bounds leave out zero, and the test of the whole shape finds a
        difference.
    """

    ways: Float32Array
    outward: Float32Array
    significant: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class GroupAnswer:
    """What was found for two groups, or along a number, in the model of one run.

    Attributes
    ----------
    shape : ModelShape
    study : Study
        All comparisons, in words and numbers.
    pair : Comparison
        Of the two groups that are mapped, or the regression.
    first, second : str
        These groups, or the lowest and the highest value in words.
    start : (V, 3) array
        Way from the model's mean surface to the first group's mean, or the shape at the lowest value [mm].
    difference : GroupMap
        From there to the second.
    discriminant : GroupMap or None
        Along the linear discriminant; None if no mode is above chance, and for a regression.
    places : (m,) array or None
        Subjects' places along the discriminant, or along the change that the number brings, as root mean
        square displacement of the particles [mm].
    values : (m,) array or None
        The number, for a regression.
    groups : tuple of str
        Of these subjects, as the table has them now.
    limit : float
        End of the colour scale that fits both maps [mm].
    """

    shape: ModelShape
    study: Study
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

    @property
    def ends(self) -> tuple[str, str]:
        """What stands at both ends of the way, in words."""
        if self.values is None:
            return f"mean of {self.first}", f"mean of {self.second}"
        column = self.study.request.column
        return f"{column} {self.first}", f"{column} {self.second}"

    def at(self, way: float) -> str:
        """Return the words for a place on the way, 0 at the first and 1 at the second."""
        if self.values is None:
            return f"{self.first} to {self.second} at {100 * way:.0f} %"
        low, high = float(self.values.min()), float(self.values.max())
        return f"{self.study.request.column} {short(low + way * (high - low))}"


def answer_groups(
    shape: ModelShape, result: Result, request: StudyRequest, tick: Tick, pair: int = 0
) -> GroupAnswer:
    """Answer a question and carry the difference of two of its groups, or the slope, to the surface.

    Parameters
    ----------
    shape : ModelShape
    result : Result
        That of the model, with the columns to ask about.
    request : StudyRequest
        Of the kind ``"groups"`` or ``"regression"``.
    tick : Tick
        Progress and cancelling.
    pair : int
        Which two groups, in the order of the study's pairs.

    Raises
    ------
    InputError
        If groups are too small or values missing; says which.
    """
    study = run_study(result, request, part_of(tick, 0.0, 0.9))
    return carried_answer(shape, result, study, pair, part_of(tick, 0.9, 1.0))


def carried_answer(shape: ModelShape, result: Result, study: Study, index: int, tick: Tick) -> GroupAnswer:
    """Carry the difference of a study's pair of groups, or its slope, to the surface.

    Raises
    ------
    InputError
        If the study has no such pair.
    """
    tick(0.0, "carrying the difference to the surface")
    pairs, request = study.pairwise or (study.overall,), study.request
    if index >= len(pairs):
        raise InputError(f"there is no pair {index} of groups; there are {len(pairs)}")
    pair = pairs[index]
    separation = pair.discriminant
    way = _slope(study, pair) if request.kind == "regression" else _between(pair)
    fields = [pair.mean - shape.model.mean - way.share * way.effect, way.effect]
    carried = shape.carried(np.array([*fields, *(separation.modes if separation is not None else ())]))
    start, ways = carried[0], carried[1]
    middle = start + np.float32(way.share) * ways
    normals = shape.normals(shape.mean.vertices.astype(np.float32) + middle)
    nearest = nearest_particles(shape.mean, shape.model.mean)
    outward = np.einsum("...vi,vi->...v", carried[1:], normals)
    difference = GroupMap(ways, outward[0], pair.p_fwe[nearest] <= LEVEL)
    discriminant = places = None
    if separation is not None and len(separation.modes):
        low, high = separation.bounds(outward[1:])
        along = np.tensordot(separation.weights.astype(np.float32), carried[2:], axes=1)
        firm = ((low > 0) | (high < 0)) & (pair.p_adjusted <= LEVEL)
        discriminant = GroupMap(along, separation.weights.astype(np.float32) @ outward[1:], firm)
        places = separation.scores / np.sqrt(len(pair.mean))
    elif way.values is not None:
        places = _along(result, request, pair, way.effect)
    maps = [item.outward for item in (difference, discriminant) if item is not None]
    return GroupAnswer(
        shape, study, pair, way.first, way.second, start, difference, discriminant, places,
        max(common_limit([np.asarray(values, np.float64)]) for values in maps), way.values,
        tuple(result.groups[subject] or "" for subject in pair.subjects),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _MorphPath:
    """From where to where, by how much (N, 3), and which share of it comes before the subjects' mean."""

    first: str
    second: str
    effect: FloatArray
    share: float
    values: FloatArray | None = None


def _between(pair: Comparison) -> _MorphPath:
    first, second = pair.counts
    return _MorphPath(
        first, second, pair.pointwise.effect[0], pair.counts[second] / sum(pair.counts.values())
    )


def _slope(study: Study, pair: Comparison) -> _MorphPath:
    """Return the way from the lowest to the highest value."""
    values = np.array([float(study.labels[subject]) for subject in pair.subjects])
    low, high = float(values.min()), float(values.max())
    first, second = short(low), short(high)
    share = float((values.mean() - low) / (high - low))
    return _MorphPath(first, second, pair.pointwise.effect[0] * (high - low), share, values)


def _along(result: Result, request: StudyRequest, pair: Comparison, effect: FloatArray) -> FloatArray:
    """Return how far each subject lies along an effect (N, 3), as RMS over the particles [mm]."""
    own = compared_shapes(result, request.alignment)[pair.subjects]
    shapes = prepare_shapes(own, study_options(request)) - pair.mean
    length = max(float(np.linalg.norm(effect)), np.finfo(float).tiny)
    return np.asarray(np.einsum("mni,ni->m", shapes, effect) / length / np.sqrt(len(effect)))
