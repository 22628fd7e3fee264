"""Meshes with faces far smaller than what is measured on them, without the noise of their vertices."""

import numpy as np
from scipy.sparse import coo_array

from homolog.surfaces.mesh import TriangleMesh

__all__ = ["without_noise"]

_FINE = 1.5
"""Least ratio of the length to the edges; with coarser faces nothing is averaged."""
_MOST_ROUNDS = 12


def without_noise(mesh: TriangleMesh, length: float) -> TriangleMesh:
    """Return a mesh whose vertices are averaged over a length, if its faces are smaller.

    A scan of millions of faces has noise of a fraction of an edge: normals of single faces tell nothing,
    and neighbouring faces may cross. Averaged over a length below the grid, the surface remains in place.

    Parameters
    ----------
    mesh : TriangleMesh
    length : float
        Standard deviation of the average [mm].

    Returns
    -------
    TriangleMesh
        With the same faces; the mesh itself if its faces are not smaller than the length.
    """
    ratio = length / max(mesh.mean_edge, 1e-300)
    if ratio < _FINE:
        return mesh
    corners, count = mesh.faces.ravel(), len(mesh.faces)
    shape = (len(mesh.vertices), count)
    owners = np.repeat(np.arange(count), 3)
    around = coo_array((np.ones(3 * count, np.float32), (corners, owners)), shape).tocsr()
    degrees = np.maximum(np.bincount(corners, minlength=shape[0]), 1)[:, None]
    centre = mesh.vertices.mean(axis=0)
    vertices = (mesh.vertices - centre).astype(np.float32)
    for _ in range(min(int(np.ceil(ratio**2)), _MOST_ROUNDS)):
        middles = (vertices[mesh.faces[:, 0]] + vertices[mesh.faces[:, 1]] + vertices[mesh.faces[:, 2]]) / 3.0
        vertices = ((around @ middles) / degrees).astype(np.float32)
    return TriangleMesh(vertices.astype(np.float64) + centre, mesh.faces)
