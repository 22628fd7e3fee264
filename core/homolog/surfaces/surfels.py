"""Surfaces shown by particles alone: a small disc at each particle, facing outward.

Discs show only the known positions and orientations of the surface, and nothing between particles.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["outward_directions", "surfels"]

_NEIGHBOURS = 8
_CORNERS = 8
_RADIUS = 0.5  # relative to the distance to the nearest neighbours


def outward_directions(points: FloatArray) -> FloatArray:
    """Return unit normals of a closed surface at scattered points on it.

    Planes are fitted to neighbours and oriented consistently along the tree that connects the most nearly
    parallel ones (Hoppe et al., SIGGRAPH 1992), starting outward at the highest point.

    Parameters
    ----------
    points : (N, 3) array
        At least four points.
    """
    near = np.asarray(KDTree(points).query(points, k=min(_NEIGHBOURS + 1, len(points)))[1])[:, 1:]
    offsets = points[near] - points[near].mean(axis=1, keepdims=True)
    normals: FloatArray = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))[1][:, :, 0]
    rows = np.repeat(np.arange(len(points)), near.shape[1])
    along = np.einsum("ni,nki->nk", normals, normals[near]).ravel()
    costs = 1.0 + 1e-6 - np.abs(along)
    graph = coo_array((costs, (rows, near.ravel())), shape=(len(points), len(points))).tocsr()
    top = int(points[:, 2].argmax())
    if normals[top, 2] < 0.0:
        normals[top] *= -1.0
    tree = minimum_spanning_tree(graph.maximum(graph.T))
    order, parents = breadth_first_order(tree, top, directed=False)
    for item in order[1:]:
        if normals[item] @ normals[parents[item]] < 0.0:
            normals[item] *= -1.0
    away = points - points.mean(axis=0)
    for entry in np.setdiff1d(np.arange(len(points)), order):  # separate components: away from the centre
        if normals[entry] @ away[entry] < 0.0:
            normals[entry] *= -1.0
    return normals


def surfels(points: FloatArray) -> TriangleMesh:
    """Return a disc at each point, facing outward.

    Parameters
    ----------
    points : (N, 3) array
        Particles of a closed surface [mm], at least four.
    """
    normals = outward_directions(points)
    distances = np.asarray(KDTree(points).query(points, k=min(4, len(points)))[0])[:, 1:]
    radius = _RADIUS * distances.mean(axis=1)
    helper = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angles = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    around = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
    rim = points[:, None] + radius[:, None, None] * around
    vertices = np.concatenate([points[:, None], rim], axis=1).reshape(-1, 3)
    corner = 1 + np.arange(_CORNERS)
    fan = np.stack([np.zeros(_CORNERS, np.int64), corner, 1 + corner % _CORNERS], axis=1)
    faces = (fan + (_CORNERS + 1) * np.arange(len(points))[:, None, None]).reshape(-1, 3)
    return TriangleMesh(vertices, faces)
