"""What is drawn: coloured triangles of surfaces and balls."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures import kernels

__all__ = ["Solid", "balls", "hollows", "surface", "warp_mesh", "warp_vectors"]

_DEVICE = "cpu"
_OCCLUSION_RAYS = 48
_OCCLUSION_SETS = 4
_SMOOTHING_ROUNDS = 2
_SMALL_BALL_PIXELS = 8.0
_OCCLUSION_DEPTH = 0.45
_OCCLUSION_REACH = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Coloured triangles ready to be drawn.

    Attributes
    ----------
    vertices, normals : (V, 3) array
        Positions [mm] and unit outward normals.
    faces : (F, 3) int array
        Vertex indices.
    colours : (V, 3) array
        Red, green, blue in [0, 1].
    """

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray
    colours: FloatArray


def surface(mesh: TriangleMesh, colours: FloatArray, shadow: FloatArray | None = None) -> Solid:
    """Return a mesh as a solid whose hollows are darker.

    Parameters
    ----------
    mesh : TriangleMesh
        The surface.
    colours : (3,) or (V, 3) array
        Red, green, blue in [0, 1].
    shadow : (V,) array, optional
        Share of light that the hollows leave, if it is known: see `hollows`.
    """
    shadow = hollows(mesh) if shadow is None else shadow
    shaded = np.broadcast_to(colours, mesh.vertices.shape) * shadow[:, None]
    return Solid(mesh.vertices, mesh.vertex_normals, mesh.faces, shaded)


def balls(centres: FloatArray, radius: float, colours: FloatArray, *, pixels: float = np.inf) -> Solid:
    """Return balls as a solid.

    Parameters
    ----------
    centres : (n, 3) array
        Midpoints [mm].
    radius : float
        Their common radius [mm].
    colours : (3,) or (n, 3) array
        Red, green, blue in [0, 1].
    pixels : float
        Radius in the picture: small balls have fewer faces.
    """
    unit, faces = _unit_ball(2 if pixels > _SMALL_BALL_PIXELS else 1)
    count, size = len(centres), len(unit)
    colours = np.broadcast_to(colours, (count, 3))
    return Solid(
        vertices=(centres[:, None] + radius * unit).reshape(-1, 3),
        normals=np.tile(unit, (count, 1)),
        faces=(np.arange(count)[:, None, None] * size + faces).reshape(-1, 3),
        colours=np.repeat(colours, size, axis=0),
    )


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


@cache
def _unit_ball(rounds: int) -> tuple[FloatArray, IntArray]:
    """Split an octahedron's faces and blow it up: after two rounds 66 vertices and 128 faces."""
    points = [tuple(sign * axis) for axis in np.eye(3) for sign in (1.0, -1.0)]
    faces = [(x, y, z) if (x + y + z) % 2 == 0 else (x, z, y) for x in (0, 1) for y in (2, 3) for z in (4, 5)]
    for _ in range(rounds):
        middle: dict[frozenset[int], int] = {}
        split = []
        for face in faces:
            a, b, c = face
            ab, bc, ca = (
                middle.setdefault(frozenset(side), len(points) + len(middle))
                for side in ((a, b), (b, c), (c, a))
            )
            split += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        points += [tuple(np.mean([points[end] for end in side], axis=0)) for side in middle]
        faces = split
    unit = np.array(points)
    return unit / np.linalg.norm(unit, axis=1, keepdims=True), np.array(faces)
