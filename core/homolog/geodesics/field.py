"""Geodesic distances from a few sources to the whole surface."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from scipy.spatial import KDTree

import homolog.device  # noqa: F401 - starts Warp
from homolog.arrays import Float32Array
from homolog.errors import InputError
from homolog.geodesics.cuda.front import advance, clear, make_front
from homolog.geodesics.cuda.kernels import block as block_kernels
from homolog.geodesics.kernels import local_solver
from homolog.geodesics.mesh.fans import build_fans
from homolog.geodesics.mesh.intrinsic import triangulate
from homolog.geodesics.plan import Task
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh

__all__ = ["distances_from"]


def distances_from(
    mesh: TriangleMesh,
    sources: Sequence[int],
    start: Sequence[float] | None = None,
    *,
    name: str = "mesh",
    tick: Tick = no_tick,
) -> Float32Array:
    """Return the geodesic distance of every vertex from its nearest source.

    Parameters
    ----------
    mesh : TriangleMesh
        A surface, closed or with rims (see `check_mesh`).
    sources : sequence of int
        Indices of the vertices from which distances are measured.
    start : sequence of float, optional
        Distance [mm] at each source; 0 if not given. For distances from a point inside a face, give the three
        corners of the face as sources and their distances from the point.
    name : str
        Name of the subject, for messages.
    tick : Tick
        Cancelling.

    Returns
    -------
    (V,) float32 array
        Distances [mm].

    Raises
    ------
    InputError
        If `check_mesh` refuses the mesh, or a source is not one of its vertices.
    """
    check_mesh(mesh, name, may_open=True)
    n = len(mesh.vertices)
    indices = np.asarray(sources, int)
    if len(indices) == 0 or indices.min() < 0 or indices.max() >= n:
        raise InputError(f"{name}: sources have to be vertices of the mesh, 0 … {n - 1}")
    limits = Task(name, mesh, np.inf, 1.0, mesh.mean_edge, mesh.area).kernel_limits()
    limits.max_encoded = limits.propagation_limit = float(local_solver.UNREACHED)
    fans = build_fans([mesh], triangulate([mesh]), "cpu")
    with wp.ScopedDevice("cpu"):
        front = make_front(1, n, lanes=1)
        clear(front)
        values = front.u.numpy()[0, :, 0]
        np.minimum.at(values, indices, 0.0 if start is None else np.asarray(start, np.float32))
        nearest, _ = KDTree(mesh.vertices[indices]).query(mesh.vertices)
        front.patch.numpy()[0] = np.argsort(nearest)
        front.size.fill_(n)
        front.active.numpy()[0, mesh.faces[np.isin(mesh.faces, indices).any(axis=1)]] = 1
        clusters = block_kernels.Sources()
        clusters.shape = wp.zeros(1, dtype=wp.int32)
        clusters.first = wp.zeros(1, dtype=wp.int32)
        clusters.limits = wp.array([limits], dtype=local_solver.DistanceLimits)
        clusters.fans = fans
        tick(0.0, f"geodesic distances of {name}")
        advance(front, clusters, range(1))
    distances: Float32Array = values.copy()
    return distances
