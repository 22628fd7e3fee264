"""Ray casting with Warp on the CPU: ambient occlusion, and pictures without OpenGL."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import warp as wp
from numpy.typing import NDArray

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering import kernels
from homolog_app.rendering.camera import Frame
from homolog_app.rendering.scene import Balls, Scene, Surface, surface

__all__ = ["Software", "faces_itself", "hollows", "openness", "shaded", "warp_mesh", "warp_vectors"]


_DEVICE = "cpu"
_OCCLUSION_RAYS = 48
_OCCLUSION_SETS = 16
_SMOOTHING_ROUNDS = 3
_OCCLUSION_DEPTH = 0.45
_OCCLUSION_REACH = 0.25


def shaded(mesh: TriangleMesh, colours: FloatArray) -> Surface:
    """Return a mesh with colours, (3,) or (V, 3) in [0, 1], that are darkened by ambient occlusion."""
    return surface(mesh, colours, hollows(mesh))


def hollows(mesh: TriangleMesh) -> FloatArray:
    """Return the share of ambient light at each vertex, (V,), reduced where the surface occludes itself."""
    light = openness(mesh, float(_OCCLUSION_REACH * np.ptp(mesh.vertices, axis=0).max()))
    return np.asarray(1.0 - _OCCLUSION_DEPTH * (1.0 - light))


def openness(mesh: TriangleMesh, reach: float) -> FloatArray:
    """Return the share of unoccluded directions within a distance `reach` [mm] of each vertex, (V,).

    A vertex casts a sixteenth of the rays. Averages over its neighbours, which cast others, remove the noise.
    """
    index = (np.arange(_OCCLUSION_RAYS) + 0.5) / _OCCLUSION_RAYS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_OCCLUSION_RAYS)
    radius = np.sqrt(index)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - index)], axis=1)
    free = wp.empty(len(mesh.vertices), dtype=float, device=_DEVICE)
    cast_on = warp_mesh(mesh.vertices, mesh.faces)
    vectors = [warp_vectors(item) for item in (mesh.vertices, mesh.vertex_normals, directions)]
    wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it
    cuts = np.linspace(0, len(mesh.vertices), cores() + 1).astype(int).tolist()

    def cast(first: int, end: int) -> None:
        inputs = [cast_on.id, *vectors, reach, first, _OCCLUSION_SETS, free]
        wp.launch(kernels.occlude, end - first, inputs=inputs, device=_DEVICE)

    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(cast, cuts[:-1], cuts[1:]))
    light = free.numpy().astype(np.float64)
    for _ in range(_SMOOTHING_ROUNDS):
        light = _mean_around(light, mesh.faces)
    return np.asarray(light, np.float64)


def faces_itself(mesh: TriangleMesh) -> tuple[FloatArray, FloatArray]:
    """Return the distances of the surface from each vertex along its normal, and against it, (V,) each [mm].

    Distances are infinite without a hit.
    """
    cast_on, count = warp_mesh(mesh.vertices, mesh.faces), len(mesh.vertices)
    vectors = [warp_vectors(item) for item in (mesh.vertices, mesh.vertex_normals)]
    ways = [wp.empty(count, dtype=float, device=_DEVICE) for _ in range(2)]
    start = 0.05 * mesh.mean_edge
    wp.launch(kernels.find_opposite, count, inputs=[cast_on.id, *vectors, start, *ways], device=_DEVICE)
    ahead, behind = (way.numpy().astype(np.float64) for way in ways)
    return ahead, behind


def _mean_around(values: FloatArray, faces: IntArray) -> FloatArray:
    """Return the mean of the faces around each vertex, (V,)."""
    of_faces = np.repeat(values[faces].mean(axis=1), 3)
    around = np.bincount(faces.ravel(), minlength=len(values))
    total = np.bincount(faces.ravel(), weights=of_faces, minlength=len(values))
    return np.where(around > 0, total / np.maximum(around, 1), values)


def warp_mesh(vertices: FloatArray, faces: IntArray) -> "wp.Mesh":
    """Return triangles for ray casting, on the CPU."""
    indices = wp.array(faces.astype(np.int32).ravel(), dtype=int, device=_DEVICE)
    return wp.Mesh(warp_vectors(vertices), indices)


def warp_vectors(values: FloatArray) -> "wp.array":
    """Return (n, 3) values as an array of vectors on the CPU."""
    return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=wp.vec3, device=_DEVICE)


_BANDS = 4  # bands of rows per core, which balance the load
_SMALL_BALL_PIXELS = 8.0


class Software:
    """Draws scenes in software, with smooth edges."""

    name = "software"

    def draw(self, scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
        """Draw a scene: see `homolog_app.rendering.draw.draw`."""
        right, up, back = frame.view.axes
        pixel = frame.width / width
        height = max(round(frame.height / pixel), 1)
        step = pixel / kernels.SMOOTH
        middle = np.array(frame.centre) + back * frame.depth
        corner = middle - right * frame.width / 2.0 + up * height * pixel / 2.0
        shown = _joined(scene, pixel, back)
        triangles = kernels.Triangles()
        triangles.faces = wp.array(shown.faces.astype(np.int32), dtype=wp.vec3i, device=_DEVICE)
        triangles.normals, triangles.colours = warp_vectors(shown.normals), warp_vectors(shown.colours)
        triangles.corner, triangles.right, triangles.up = (
            wp.vec3(*map(float, item)) for item in (corner, right, up)
        )
        triangles.step = step
        triangles.cut = 0 if scene.cut is None else 1
        if scene.cut is not None:
            normal, origin = scene.cut
            triangles.plane, triangles.offset = wp.vec3(*map(float, normal)), float(normal @ origin)
            triangles.cap = wp.vec3(*map(float, scene.cap))
        way = shown.vertices - corner
        places = warp_vectors(np.stack([way @ right / step, way @ -up / step, way @ -back], axis=1))
        image = wp.empty((height, width), dtype=wp.vec4ub, device=_DEVICE)
        wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it
        rows = -(-height // (_BANDS * cores()))

        def fill_band(first: int) -> None:
            size = kernels.SMOOTH * min(rows, height - first), kernels.SMOOTH * width
            nearest, relief = (wp.empty(size, dtype=kind, device=_DEVICE) for kind in (int, wp.vec3))
            inputs = [triangles, places, first, nearest, relief, image]
            wp.launch(kernels.fill, 1, inputs=inputs, device=_DEVICE)

        with ThreadPoolExecutor(cores()) as pool:
            list(pool.map(fill_band, range(0, height, rows)))
        return np.array(image.numpy())


def _joined(scene: Scene, pixel: float, back: FloatArray) -> Surface:
    """Return a scene as one surface, for a pixel size [mm] and a direction to the viewer."""
    balls = scene.balls_left
    solids = [surface for surface in scene.surfaces if surface is not None]
    if balls is not None:
        solids.append(_ball_surface(balls, pixel, back if scene.cut is None else None))
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    return Surface(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.normals for solid in solids]),
        np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)]),
        np.concatenate([np.broadcast_to(solid.colours, solid.vertices.shape) for solid in solids]),
    )


def _ball_surface(balls: Balls, step: float, back: FloatArray | None) -> Surface:
    """Return balls as triangles: few if they are small in the picture, and only those facing the viewer."""
    unit, faces = _unit_ball(2 if balls.radius > _SMALL_BALL_PIXELS * step else 1)
    if back is not None:
        a, b, c = (unit[faces[:, corner]] for corner in range(3))
        faces = faces[np.cross(b - a, c - a) @ back > 0.0]
    count, size = len(balls.centres), len(unit)
    colours = np.broadcast_to(balls.colours, (count, 3))
    return Surface(
        vertices=(balls.centres[:, None] + balls.radius * unit).reshape(-1, 3),
        normals=np.tile(unit, (count, 1)),
        faces=(np.arange(count)[:, None, None] * size + faces).reshape(-1, 3),
        colours=np.repeat(colours, size, axis=0),
    )


@cache
def _unit_ball(rounds: int) -> tuple[FloatArray, IntArray]:
    """Subdivide an octahedron, projected to the unit sphere: two rounds give 66 vertices and 128 faces."""
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
