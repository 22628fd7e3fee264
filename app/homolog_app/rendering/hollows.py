"""How much light reaches the places of a surface: hollows are darker."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering import kernels
from homolog_app.rendering.scene import Surface, surface

__all__ = ["hollows", "shaded", "warp_mesh", "warp_vectors"]

_DEVICE = "cpu"
_OCCLUSION_RAYS = 48
_OCCLUSION_SETS = 4
_SMOOTHING_ROUNDS = 2
_OCCLUSION_DEPTH = 0.45
_OCCLUSION_REACH = 0.25


def shaded(mesh: TriangleMesh, colours: FloatArray) -> Surface:
    """Return a mesh whose colours, (3,) or (V, 3) in [0, 1], are darker in its hollows."""
    return surface(mesh, colours, hollows(mesh))


def hollows(mesh: TriangleMesh) -> FloatArray:
    """Return the share of light that reaches each vertex, (V,): less where the surface sees itself nearby.

    A vertex casts a quarter of the rays; averaging over its neighbours, which cast others, removes the noise.
    """
    index = (np.arange(_OCCLUSION_RAYS) + 0.5) / _OCCLUSION_RAYS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_OCCLUSION_RAYS)
    radius = np.sqrt(index)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - index)], axis=1)
    openness = wp.empty(len(mesh.vertices), dtype=float, device=_DEVICE)
    cast_on = warp_mesh(mesh.vertices, mesh.faces)
    vectors = [warp_vectors(item) for item in (mesh.vertices, mesh.vertex_normals, directions)]
    reach = float(_OCCLUSION_REACH * np.ptp(mesh.vertices, axis=0).max())
    wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it
    cuts = np.linspace(0, len(mesh.vertices), cores() + 1).astype(int).tolist()

    def cast(first: int, end: int) -> None:
        inputs = [cast_on.id, *vectors, reach, first, _OCCLUSION_SETS, openness]
        wp.launch(kernels.occlude, end - first, inputs=inputs, device=_DEVICE)

    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(cast, cuts[:-1], cuts[1:]))
    light = openness.numpy().astype(np.float64)
    for _ in range(_SMOOTHING_ROUNDS):
        light = _mean_around(light, mesh.faces)
    return np.asarray(1.0 - _OCCLUSION_DEPTH * (1.0 - light))


def _mean_around(values: FloatArray, faces: IntArray) -> FloatArray:
    """Return the mean of the faces around each vertex, (V,)."""
    of_faces = np.repeat(values[faces].mean(axis=1), 3)
    around = np.bincount(faces.ravel(), minlength=len(values))
    total = np.bincount(faces.ravel(), weights=of_faces, minlength=len(values))
    return np.where(around > 0, total / np.maximum(around, 1), values)


def warp_mesh(vertices: FloatArray, faces: IntArray) -> "wp.Mesh":
    """Return triangles that rays can be cast at, on the processor."""
    indices = wp.array(faces.astype(np.int32).ravel(), dtype=int, device=_DEVICE)
    return wp.Mesh(warp_vectors(vertices), indices)


def warp_vectors(values: FloatArray) -> "wp.array":
    """Return (n, 3) values as an array of vectors on the processor."""
    return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=wp.vec3, device=_DEVICE)
