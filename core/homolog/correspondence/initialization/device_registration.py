"""Distances of shapes on a GPU, from which the reference is chosen.

Every point is compared with every vertex, because search trees are slower on a GPU.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, FloatArray, IntArray
from homolog.correspondence.kernels import registration as kernels
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["mean_distances"]


def mean_distances(
    meshes: Sequence[TriangleMesh], candidates: IntArray, samples: int, device: str
) -> FloatArray:
    """Return the mean distances between some shapes and all, both ways, (K, M).

    Parameters
    ----------
    meshes : sequence of TriangleMesh
    candidates : (K,) int array
        Which shapes are compared with all.
    samples : int
        Vertices of each shape that are compared.
    device : str
        Warp device.
    """
    starts, vertices = _joined([mesh.vertices for mesh in meshes], device)
    points = wp.empty((len(meshes), samples), dtype=wp.vec3d, device=device)
    gaps = wp.empty(vertices.size, dtype=wp.float64, device=device)
    wp.launch(kernels.choose_far_points, len(meshes), inputs=[starts, vertices, gaps, points], device=device)
    some, every = (wp.array(rows, dtype=int, device=device) for rows in (candidates, np.arange(len(meshes))))
    result = np.zeros((len(candidates), len(meshes)))
    for of, to in ((every, some), (some, every)):
        distances = wp.empty((of.size, to.size, samples), dtype=wp.float64, device=device)
        inputs = [of, to, points, starts, vertices, distances]
        wp.launch(kernels.nearest_distances, distances.shape, inputs=inputs, device=device)
        means = distances.numpy().mean(axis=2)
        result += means if of is some else means.T
    return result


def _joined(arrays: Sequence[FloatArray], device: str) -> tuple[DeviceArray, DeviceArray]:
    """Return where each of some (n, 3) arrays begins, and all of them one after another."""
    starts = np.concatenate([[0], np.cumsum([len(item) for item in arrays])])
    return (
        wp.array(starts, dtype=wp.int32, device=device),
        wp.array(np.concatenate(arrays), dtype=wp.vec3d, device=device),
    )
