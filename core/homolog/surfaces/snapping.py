"""Projection of points onto a surface."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["snapping"]

_SAMPLES = 12  # on each face


def snapping(mesh: TriangleMesh) -> Callable[[FloatArray], FloatArray]:
    """Return a function that moves points (n, 3) to a surface, within a fraction of its edges."""
    weights = np.random.default_rng(0).dirichlet(np.ones(3), _SAMPLES)
    points = np.einsum("sk,fkd->fsd", weights, mesh.vertices[mesh.faces]).reshape(-1, 3)
    tree = KDTree(points)
    return lambda goals: points[np.asarray(tree.query(goals)[1])]
