"""Vertices spread over a surface, on which the first particles are placed."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from homolog.arrays import IntArray
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import edges

__all__ = ["spread_vertices"]


def spread_vertices(mesh: TriangleMesh, count: int, begin: IntArray) -> IntArray:
    """Return vertices far from each other along the surface, so that both sides of a wall are covered.

    Parameters
    ----------
    mesh : TriangleMesh
    count : int
        Number of vertices.
    begin : (k,) int array
        The first vertices.

    Returns
    -------
    (count,) int array
        Vertices in the order of selection: each is the farthest from all before, along edges (Gonzalez 1985).
    """
    pairs = edges(mesh.faces)
    lengths = np.linalg.norm(np.diff(mesh.vertices[pairs], axis=1)[:, 0], axis=1)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.tile(lengths, 2), (rows, columns)), shape=(len(mesh.vertices),) * 2).tocsr()
    chosen = [int(vertex) for vertex in begin]
    gap = dijkstra(graph, indices=chosen, min_only=True)
    while len(chosen) < count:
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, dijkstra(graph, indices=[chosen[-1]], min_only=True, limit=float(gap.max())))
    return np.array(chosen)
