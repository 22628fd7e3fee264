"""Selection of a core set: subjects that span the shapes of a cohort."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import farthest_point_sampling, transform_points
from homolog.grooming import GroomedSubject
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.simplify import simplified

__all__ = ["choose_core", "outline"]

_OUTLINE_VERTICES = 400
_DESCRIPTOR_POINTS = 100


def outline(groomed: GroomedSubject) -> GroomedSubject:
    """Return a subject with few vertices and without distance field, for alignment and selection."""
    mesh = simplified(groomed.coarse_mesh, _OUTLINE_VERTICES)
    nothing = DistanceField(np.ones((2, 2, 2), np.float32), np.eye(4))
    return replace(groomed, field=nothing, mesh=mesh, coarse_mesh=mesh)


def choose_core(
    outlines: Sequence[GroomedSubject], alignments: FloatArray, groups: Sequence[str | None], size: int
) -> IntArray:
    """Return the indices of a core set of subjects with different coarse shapes, in ascending order.

    Each group contributes in proportion, with at least two subjects. The features of a subject are the
    displacements from points of one subject to its nearest points, after alignment and scaling to one size.
    Size is a further coordinate.

    Parameters
    ----------
    outlines : sequence of M GroomedSubject
    alignments : (M, 4, 4) array
    groups : sequence of M str or None
    size : int
        Number of subjects, at most M.

    Returns
    -------
    (size,) int array
    """
    descriptors = _descriptors(outlines, alignments)
    members: dict[str, list[int]] = defaultdict(list)
    for index, group in enumerate(groups):
        members[group or ""].append(index)
    chosen: list[int] = []
    for own, wanted in zip(
        members.values(), _shares([len(own) for own in members.values()], size), strict=True
    ):
        points = descriptors[own]
        first = int(np.square(points - points.mean(axis=0)).sum(axis=1).argmin())
        chosen += [own[place] for place in farthest_point_sampling(points, wanted, [first])]
    return np.array(sorted(chosen))


def _descriptors(outlines: Sequence[GroomedSubject], alignments: FloatArray) -> FloatArray:
    clouds, sizes = [], []
    for item, alignment in zip(outlines, alignments, strict=True):
        points = transform_points(alignment, item.coarse_mesh.vertices)
        points = points - points.mean(axis=0)
        sizes.append(float(np.sqrt(np.square(points).sum(axis=1).mean())))
        clouds.append(points / sizes[-1])
    places = clouds[0][farthest_point_sampling(clouds[0], min(_DESCRIPTOR_POINTS, len(clouds[0])))]
    ways = [cloud[KDTree(cloud).query(places)[1]].ravel() for cloud in clouds]
    of_size = np.sqrt(len(places)) * np.log(sizes)
    return np.column_stack([np.array(ways), of_size])


def _shares(counts: Sequence[int], size: int) -> list[int]:
    """Return the number of subjects per group: proportional, at least two, `size` in total."""
    exact = np.array(counts) * size / sum(counts)
    shares = np.minimum(np.maximum(np.floor(exact).astype(int), 2), counts)
    while shares.sum() != size:
        room = shares < counts if shares.sum() < size else shares > 1
        gap = np.where(room, exact - shares, -np.inf if shares.sum() < size else np.inf)
        shares[int(gap.argmax() if shares.sum() < size else gap.argmin())] += np.sign(size - shares.sum())
    return [int(share) for share in shares]
