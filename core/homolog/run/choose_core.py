"""Selection of a core set: subjects that span the shapes of a cohort."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import farthest_point_sampling
from homolog.grooming import GroomedSubject
from homolog.surfaces.closest import signed_distances_to
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified

__all__ = ["choose_core", "outline"]

_OUTLINE_VERTICES = 400
_DESCRIPTOR_POINTS = 200
_MOST_PROBED = 20
"""Largest number of subjects on whose surfaces distances to all surfaces are measured."""


def outline(groomed: GroomedSubject) -> GroomedSubject:
    """Return a subject with few vertices and without distance field, for alignment and selection."""
    mesh = simplified(groomed.coarse_mesh, _OUTLINE_VERTICES)
    nothing = DistanceField(np.ones((2, 2, 2), np.float32), np.eye(4))
    return replace(groomed, field=nothing, mesh=mesh, coarse_mesh=mesh)


def choose_core(
    outlines: Sequence[GroomedSubject], alignments: FloatArray, groups: Sequence[str | None], size: int
) -> IntArray:
    """Return the indices of a core set of subjects with different coarse shapes, in ascending order.

    Each group contributes in proportion, with at least two subjects. The features of a subject are the signed
    distances to its surface from points of several subjects, after alignment and scaling to one size. Size is
    a further coordinate.

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
    """Return the features of the subjects, one row each.

    Distances to the surface, rather than to its nearest vertex, because vertices are further apart than most
    shapes differ: their places would decide the choice.
    """
    meshes, sizes = [], []
    for item, alignment in zip(outlines, alignments, strict=True):
        placed = item.coarse_mesh.placed(alignment)
        points = placed.vertices - placed.vertices.mean(axis=0)
        sizes.append(float(np.sqrt(np.square(points).sum(axis=1).mean())))
        meshes.append(TriangleMesh(points / sizes[-1], placed.faces))
    some = np.concatenate([mesh.vertices for mesh in meshes[:: -(-len(meshes) // _MOST_PROBED)]])
    places = some[farthest_point_sampling(some, min(_DESCRIPTOR_POINTS, len(some)))]
    distances = np.array([signed_distances_to(mesh, places) for mesh in meshes])
    of_size = np.sqrt(len(places)) * np.log(sizes)
    return np.column_stack([distances, of_size])


def _shares(counts: Sequence[int], size: int) -> list[int]:
    """Return the number of subjects per group: proportional, at least two, `size` in total."""
    exact = np.array(counts) * size / sum(counts)
    shares = np.minimum(np.maximum(np.floor(exact).astype(int), 2), counts)
    while shares.sum() != size:
        room = shares < counts if shares.sum() < size else shares > 1
        gap = np.where(room, exact - shares, -np.inf if shares.sum() < size else np.inf)
        shares[int(gap.argmax() if shares.sum() < size else gap.argmin())] += np.sign(size - shares.sum())
    return [int(share) for share in shares]
