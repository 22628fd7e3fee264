"""A closed mesh as a level function on a grid."""

import numpy as np
import warp as wp
from scipy import ndimage

from homolog.arrays import Float32Array, FloatArray
from homolog.device import choose_device
from homolog.surfaces import kernels
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["REACH", "mesh_level"]

REACH = 2.5
"""Nodes: how far from the mesh its distance is computed."""


def mesh_level(
    mesh: TriangleMesh, start: FloatArray, spacing: float, shape: tuple[int, ...], *, device: str = "cpu"
) -> Float32Array:
    """Return the signed distance to a closed mesh on an axis-aligned grid, near the mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed, faces counter-clockwise seen from outside; parts may overlap.
    start : (3,) array
        Place of the first node [mm, LPS].
    spacing : float
        Distance between nodes [mm].
    shape : tuple of int
        Number of nodes along each axis; the border is outside.
    device : str
        ``"cpu"`` or a CUDA device.

    Returns
    -------
    (I, J, K) float32 array
        Exact distance, negative inside, up to `REACH`; that value beyond [nodes].
    """
    # Single precision: count from the grid's first node, in nodes.
    points = ((mesh.vertices - start) / spacing).astype(np.float32)
    with wp.ScopedDevice(choose_device(device)):
        surface = wp.Mesh(
            points=wp.array(points, dtype=wp.vec3),
            indices=wp.array(mesh.faces.ravel(), dtype=wp.int32),
            support_winding_number=True,
        )
        level = wp.full(shape, REACH, dtype=wp.float32)
        wp.launch(kernels.distance_to_mesh, shape, [surface.id, REACH, level])
        values: Float32Array = np.array(level.numpy())
    inside = ndimage.binary_fill_holes(values < 0.0)
    values[inside & (values == REACH)] = -REACH
    return values
