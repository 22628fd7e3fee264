"""Coarser meshes of the same surface."""

import numpy as np

from homolog.errors import NumericalError
from homolog.surfaces.half_edges import HalfEdges, ascending
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["simplified"]

_SHARE = 1.0 / 3.0  # fraction of the edges, the cheapest, that are collapsed in one round
_ROUNDS = 60  # at most: if the topology permits few collapses, rounds make little progress


def simplified(mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the same surface and topology with fewer vertices, by quadric edge collapse.

    After Garland and Heckbert, Surface Simplification Using Quadric Error Metrics (SIGGRAPH 1997). Edges are
    collapsed only if this preserves the topology and flips no face over.

    Parameters
    ----------
    mesh : TriangleMesh
        An oriented manifold, whose rims are kept in place; other meshes are returned unchanged.
    n_vertices : int
        Target number of vertices; a mesh with no more is returned unchanged.

    Returns
    -------
    TriangleMesh
        Mesh with the target number of vertices, or as few as the topology permits.
    """
    if len(mesh.vertices) <= n_vertices:
        return mesh
    centre = mesh.vertices.mean(axis=0)  # small numbers are more precise
    try:
        edges = HalfEdges(mesh.vertices - centre, mesh.faces)
    except NumericalError:
        return mesh
    _merge(edges, len(mesh.vertices) - n_vertices)
    edges.compact()
    return TriangleMesh(edges.mesh.vertices + centre, edges.mesh.faces)


def _merge(edges: HalfEdges, most: int) -> None:
    """Collapse at most `most` of the cheapest edges, if the topology permits."""
    left, share = most, _SHARE
    for _ in range(_ROUNDS):
        if left <= 0:
            return
        sides, costs = edges.costs()
        cheapest = ascending(costs)[: int(np.ceil(share * len(costs)))]
        done = edges.merge(sides[cheapest], left)
        if not done and share == 1.0:
            return
        share = _SHARE if done else 1.0
        left -= done
