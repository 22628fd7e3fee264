"""Coarser meshes of the same surface."""

from collections.abc import Sequence

import numpy as np

from homolog.errors import NumericalError
from homolog.surfaces.half_edges import HalfEdges
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["levels_of_detail", "simplified"]

_SHARE = 1.0 / 3.0  # of the edges, the cheapest, that are merged in one round
_ROUNDS = 60  # at most: where topology leaves little to merge, rounds merge hardly any


def simplified(mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the same surface and topology with fewer vertices, by quadric edge collapse.

    After Garland and Heckbert, Surface Simplification Using Quadric Error Metrics (SIGGRAPH 1997). Edges are
    merged only where that keeps the topology and turns no face over.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold; any other is returned as it is.
    n_vertices : int
        Wanted number of vertices; a mesh that has no more is returned as it is.

    Returns
    -------
    TriangleMesh
        As few vertices as wanted, or as the topology allows.
    """
    if len(mesh.vertices) <= n_vertices:
        return mesh
    return levels_of_detail(mesh, [n_vertices])[0]


def levels_of_detail(mesh: TriangleMesh, counts: Sequence[int]) -> list[TriangleMesh]:
    """Return meshes as `simplified` makes them, each from the one before it.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold; any other is returned as it is.
    counts : sequence of int
        Wanted numbers of vertices, the largest first.

    Returns
    -------
    list of TriangleMesh
    """
    centre = mesh.vertices.mean(axis=0)  # keep the numbers small
    try:
        edges = HalfEdges(mesh.vertices - centre, mesh.faces)
    except NumericalError:
        return [mesh] * len(counts)
    number, levels = len(mesh.vertices), []
    for count in counts:
        number -= _merge(edges, number - count)
        edges.compact()
        levels.append(TriangleMesh(edges.vertices + centre, edges.faces))
    return levels


def _merge(edges: HalfEdges, most: int) -> int:
    """Merge at most `most` of the cheapest edges, as far as the topology allows, and return how many."""
    left, share = most, _SHARE
    for _ in range(_ROUNDS):
        if left <= 0:
            break
        sides, costs = edges.costs()
        cheap = np.flatnonzero(costs <= np.quantile(costs, share))
        done = edges.merge(sides[cheap[np.argsort(costs[cheap], kind="stable")]], left)
        if not done and share == 1.0:
            break
        share = _SHARE if done else 1.0
        left -= done
    return most - left
