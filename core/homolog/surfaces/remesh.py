"""Isotropic remeshing: repeatedly split, collapse and flip edges, and relax vertices along the surface.

After Botsch and Kobbelt, A Remeshing Approach to Multiresolution Modeling (SGP 2004). Topology does not
change.
"""

from collections.abc import Callable

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.half_edges import HalfEdges, ascending
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Sizes", "curvature_sizes", "remeshed"]

Sizes = Callable[[FloatArray], FloatArray]
"""Target edge length [mm] at points (N, 3), shape (N,)."""

_LONG, _SHORT = 4.0 / 3.0, 3.0 / 4.0
"""Relative to the target edge length: a longer edge is nearer to it once halved (Botsch and Kobbelt 2004),
a shorter one is the inverse."""
_SWEEPS = 5
_SPLITS, _COLLAPSES, _FLIPS = 20, 8, 3  # largest number of rounds per sweep
_FEW = 0.003  # fraction of the vertices; a round that would change fewer is omitted
_SLIDE = 0.6


def remeshed(mesh: TriangleMesh, field: DistanceField, sizes: float | Sizes) -> TriangleMesh:
    """Return a mesh of a field's zero level with edges of about the target length.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold near the zero level.
    field : DistanceField
        Distance field to whose zero level the vertices are projected.
    sizes : float or callable
        Target edge length [mm], constant or by position.

    Returns
    -------
    TriangleMesh

    Raises
    ------
    NumericalError
        If the mesh is not closed.
    """
    edges = HalfEdges(mesh.vertices, mesh.faces, np.empty(len(mesh.vertices)))
    for _ in range(_SWEEPS):
        n = len(edges.vertices)
        edges.longest = _LONG * (sizes(edges.vertices) if callable(sizes) else np.full(n, sizes))
        _split(edges)
        _collapse(edges)
        _flip(edges)
        _slide(edges, field)
    return edges.mesh


def _split(edges: HalfEdges) -> None:
    """Split long edges until few remain."""
    for _ in range(_SPLITS):
        sides, lengths = edges.lengths()
        if edges.split(_sorted(sides, -lengths, lengths > 1.0)) <= _FEW * len(edges.vertices):
            return


def _collapse(edges: HalfEdges) -> None:
    """Collapse short edges, where topology and shape permit."""
    few = _FEW * len(edges.vertices)
    for _ in range(_COLLAPSES):
        sides, lengths = edges.lengths()
        if edges.merge(_sorted(sides, lengths, lengths < _SHORT / _LONG)) <= few:
            break
    edges.compact()


def _flip(edges: HalfEdges) -> None:
    """Flip edges whose opposite angles sum to more than 180° (Delaunay)."""
    for _ in range(_FLIPS):
        sides, turns = edges.turns()
        if edges.flip(_sorted(sides, -turns, turns > 0.0)) <= _FEW * len(edges.vertices):
            break


def _sorted(sides: IntArray, order: FloatArray, chosen: BoolArray) -> IntArray:
    """Return the chosen sides in ascending order of `order`."""
    return sides[chosen][ascending(order[chosen])]


def _slide(edges: HalfEdges, field: DistanceField) -> None:
    """Move each vertex towards the mean of its neighbours, and project it to the zero level."""
    step = edges.around() - edges.vertices
    normals = field.gradients(edges.vertices)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    step -= (step * normals).sum(axis=1, keepdims=True) * normals
    edges.vertices = field.projected(edges.vertices + _SLIDE * step)


def curvature_sizes(curvature: FloatArray, edge: float) -> FloatArray:
    """Return edge lengths [mm] that are short where the curvature is large; `edge` is the typical one."""
    return np.asarray(edge * np.clip(curvature / np.median(curvature), 0.4, 6.0) ** -0.5)
