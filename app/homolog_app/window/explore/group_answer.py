"""The answer to a question about groups, carried to the surface where it is drawn. Knows no Qt."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from homolog.analysis.comparison import Comparison
from homolog.arrays import BoolArray, Float32Array, FloatArray
from homolog.files.results import Result
from homolog.progress import Tick, part_of
from homolog_app.pictures import common_limit
from homolog_app.report.findings import LEVEL
from homolog_app.report.request import StudyRequest
from homolog_app.report.study import Study, run_study
from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["GroupAnswer", "GroupMap", "answer_groups"]


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
        discriminant: the 95 % bootstrap bounds leave out zero.
    """

    ways: Float32Array
    outward: Float32Array
    significant: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class GroupAnswer:
    """What was found for two groups, in the model of one run.

    Attributes
    ----------
    shape : ModelShape
    study : Study
        All comparisons, in words and numbers.
    pair : Comparison
        Of the two groups that are mapped.
    first, second : str
        These groups.
    start : (V, 3) array
        Way from the model's mean surface to the first group's mean [mm].
    difference : GroupMap
        From mean to mean.
    discriminant : GroupMap or None
        Along the linear discriminant; None if no mode is above chance.
    places : (m,) array or None
        Subjects' places along the discriminant, as root mean square displacement of the particles [mm].
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


def answer_groups(shape: ModelShape, result: Result, request: StudyRequest, tick: Tick) -> GroupAnswer:
    """Test the groups of a request and carry the difference of its first two to the surface.

    Parameters
    ----------
    shape : ModelShape
    result : Result
        That of the model, with the groups to compare.
    request : StudyRequest
        Of the kind ``"groups"``.
    tick : Tick
        Progress and cancelling.

    Raises
    ------
    InputError
        If groups are too small or values missing; says which.
    """
    study = run_study(result, request, part_of(tick, 0.0, 0.9))
    tick(0.9, "carrying the difference to the surface")
    pair = study.pairwise[0] if study.pairwise else study.overall
    first, second = request.between[:2]
    effect, found = pair.local.effect[0], pair.discriminant
    share = pair.counts[second] / sum(pair.counts.values())
    fields = [pair.mean - shape.model.mean - share * effect, effect]
    modes = 0 if found is None else len(found.modes)
    carried = shape.carried(np.array([*fields, *(found.modes if found is not None else ())]))
    start, ways = carried[0], carried[1]
    normals = shape.normals(shape.mean.vertices.astype(np.float32) + start + np.float32(share) * ways)
    nearest = KDTree(shape.model.mean).query(shape.mean.vertices)[1]
    outward = np.einsum("...vi,vi->...v", carried[1:], normals)
    difference = GroupMap(ways, outward[0], pair.local.p_family[nearest] <= LEVEL)
    discriminant = places = None
    if found is not None and modes:
        low, high = found.bounds(outward[1:])
        along = np.tensordot(found.weights.astype(np.float32), carried[2:], axes=1)
        discriminant = GroupMap(along, found.weights.astype(np.float32) @ outward[1:], (low > 0) | (high < 0))
        places = found.scores / np.sqrt(len(pair.mean))
    maps = [one.outward for one in (difference, discriminant) if one is not None]
    return GroupAnswer(
        shape, study, pair, first, second, start, difference, discriminant, places,
        max(common_limit([np.asarray(one, np.float64)]) for one in maps),
    )  # fmt: skip
