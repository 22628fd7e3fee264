"""Coarser meshes of the same surface."""

import numpy as np

from homolog.errors import NumericalError
from homolog.surfaces.collapses import MergedMesh
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["simplified"]

_SHARE = 1.0 / 3.0  # of the edges, the cheapest, that are merged in one round


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
    centre = mesh.vertices.mean(axis=0)  # keep the numbers small
    try:
        merged = MergedMesh.of(mesh.vertices - centre, mesh.faces)
    except NumericalError:
        return mesh
    left, share = len(mesh.vertices) - n_vertices, _SHARE
    while left > 0:
        sides, costs = merged.costs()
        cheap = np.flatnonzero(costs <= np.quantile(costs, share))
        done = merged.merge(sides[cheap[np.argsort(costs[cheap], kind="stable")]], left)
        if not done and share == 1.0:
            break
        share = _SHARE if done else 1.0
        left -= done
    vertices, faces, _ = merged.compact()
    return TriangleMesh(vertices + centre, faces)
