"""Closest points of meshes, distances to them, and thickness."""

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.device import choose_device
from homolog.surfaces.kernels import distances as kernels
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["closest_faces", "closest_points", "distances_to", "on_device", "signed_distances_to", "thickness"]


def closest_points(mesh: TriangleMesh, points: FloatArray, *, device: str = "cpu") -> FloatArray:
    """Return the points (N, 3) of a mesh that are closest to others (N, 3) [mm]."""
    with wp.ScopedDevice(choose_device(device)):
        surface, centre = on_device(mesh)
        queries = wp.array((points - centre).astype(np.float32), dtype=wp.vec3)
        closest = wp.empty(len(points), dtype=wp.vec3)
        wp.launch(kernels.closest_points, len(points), [surface.id, queries, closest])
        return np.asarray(closest.numpy() + centre, dtype=np.float64)


def closest_faces(mesh: TriangleMesh, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return where the points of a mesh lie that are closest to some points.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangles.
    points : (N, 3) array
        Positions [mm].

    Returns
    -------
    (N,) int array
        The face of each.
    (N, 3) float64 array
        Barycentric weights of its corners.
    """
    with wp.ScopedDevice("cpu"):
        surface, centre = on_device(mesh)
        queries = wp.array((points - centre).astype(np.float32), dtype=wp.vec3)
        faces, weights = wp.empty(len(points), dtype=wp.int32), wp.empty(len(points), dtype=wp.vec3)
        wp.launch(kernels.find_closest, len(points), [surface.id, queries, faces, weights])
    return faces.numpy().astype(np.int64), weights.numpy().astype(np.float64)


def distances_to(mesh: TriangleMesh, points: FloatArray, *, device: str = "cpu") -> FloatArray:
    """Return unsigned distances of points from a mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangles.
    points : (N, 3) array
        Positions [mm].
    device : str
        ``"cpu"`` or a CUDA device.

    Returns
    -------
    (N,) float64 array
        Distances [mm].
    """
    return np.asarray(np.linalg.norm(points - closest_points(mesh, points, device=device), axis=1))


def signed_distances_to(mesh: TriangleMesh, points: FloatArray, *, device: str = "cpu") -> FloatArray:
    """Return signed distances of points from a closed surface.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces counter-clockwise seen from outside.
    points : (N, 3) array
        Positions [mm].
    device : str
        ``"cpu"`` or a CUDA device.

    Returns
    -------
    (N,) float64 array
        Distances to the nearest point of the surface [mm], negative inside.
    """
    with wp.ScopedDevice(choose_device(device)):
        surface, centre = on_device(mesh)
        queries = wp.array((points - centre).astype(np.float32), dtype=wp.vec3)
        distances = wp.empty(len(points), dtype=wp.float32)
        wp.launch(kernels.signed_distances_of_points, len(points), [surface.id, queries, distances])
        return np.asarray(distances.numpy(), dtype=np.float64)


def thickness(mesh: TriangleMesh, every: int = 1, *, device: str = "cpu") -> FloatArray:
    """Return the thickness of the solid below faces: from the centroid inward to the next face.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces counter-clockwise seen from outside.
    every : int
        Only each such face is measured, beginning with the first.
    device : str
        ``"cpu"`` or a CUDA device.

    Returns
    -------
    (N,) float64 array
        Thickness [mm]; infinite without an opposite face.
    """
    count = len(mesh.faces[::every])
    with wp.ScopedDevice(choose_device(device)):
        surface, _ = on_device(mesh)
        thickness = wp.empty(count, dtype=wp.float32)
        wp.launch(kernels.thickness_of_faces, count, [surface.id, every, thickness])
        return np.asarray(thickness.numpy(), dtype=np.float64)


def on_device(mesh: TriangleMesh) -> tuple[wp.Mesh, FloatArray]:
    """Return the mesh on the current device, and the origin of its coordinates there."""
    centre: FloatArray = mesh.vertices.mean(axis=0)  # small numbers for single precision
    surface = wp.Mesh(
        points=wp.array((mesh.vertices - centre).astype(np.float32), dtype=wp.vec3),
        indices=wp.array(mesh.faces.ravel(), dtype=wp.int32),
    )
    return surface, centre
