"""How open a surface is at its points, and how far it is from itself: ray casting with Warp on the CPU."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.surfaces.kernels import openness as kernels
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import cores

__all__ = ["faces_itself", "openness", "warp_vectors"]

_DEVICE = "cpu"
_RAYS = 96
_SETS = 48
_SMOOTHING_ROUNDS = 4


def openness(mesh: TriangleMesh, reach: float) -> tuple[FloatArray, FloatArray]:
    """Return the share of unoccluded directions within a distance of each vertex, and the vertices' normals.

    A vertex casts two rays. Averages over its neighbours, which cast others, remove the noise.

    Parameters
    ----------
    mesh : TriangleMesh
    reach : float
        Distance [mm] within which the surface occludes.

    Returns
    -------
    (V,) and (V, 3) arrays
    """
    index = (np.arange(_RAYS) + 0.5) / _RAYS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_RAYS)
    radius = np.sqrt(index)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - index)], axis=1)
    count = len(mesh.vertices)
    cast_on = _warp_mesh(mesh.vertices, mesh.faces)
    points, faces = cast_on.points, cast_on.indices.reshape((-1, 3))
    free, around, total = (wp.empty(count, dtype=float, device=_DEVICE) for _ in range(3))
    normals = wp.empty(count, dtype=wp.vec3, device=_DEVICE)
    wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it
    wp.launch(kernels.find_normals, 1, inputs=[points, faces, normals], device=_DEVICE)
    vectors = [points, normals, warp_vectors(directions)]
    cuts = np.linspace(0, count, cores() + 1).astype(int).tolist()

    def cast(first: int, end: int) -> None:
        inputs = [cast_on.id, *vectors, reach, first, _SETS, free]
        wp.launch(kernels.occlude, end - first, inputs=inputs, device=_DEVICE)

    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(cast, cuts[:-1], cuts[1:]))
    rounds = _SMOOTHING_ROUNDS
    wp.launch(kernels.smooth, 1, inputs=[faces, rounds, around, total, free], device=_DEVICE)
    return free.numpy().astype(np.float64), normals.numpy().astype(np.float64)


def faces_itself(mesh: TriangleMesh) -> tuple[FloatArray, FloatArray]:
    """Return the distances of the surface from each vertex along its normal, and against it, (V,) each [mm].

    Distances are infinite without a hit.
    """
    cast_on, count = _warp_mesh(mesh.vertices, mesh.faces), len(mesh.vertices)
    vectors = [warp_vectors(item) for item in (mesh.vertices, mesh.vertex_normals)]
    ways = [wp.empty(count, dtype=float, device=_DEVICE) for _ in range(2)]
    start = 0.05 * mesh.mean_edge
    wp.launch(kernels.find_opposite, count, inputs=[cast_on.id, *vectors, start, *ways], device=_DEVICE)
    ahead, behind = (way.numpy().astype(np.float64) for way in ways)
    return ahead, behind


def _warp_mesh(vertices: FloatArray, faces: IntArray) -> "wp.Mesh":
    """Return triangles for ray casting, on the CPU."""
    indices = wp.array(faces.astype(np.int32).ravel(), dtype=int, device=_DEVICE)
    return wp.Mesh(warp_vectors(vertices), indices)


def warp_vectors(values: FloatArray) -> "wp.array":
    """Return (n, 3) values as an array of vectors on the CPU."""
    return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=wp.vec3, device=_DEVICE)
