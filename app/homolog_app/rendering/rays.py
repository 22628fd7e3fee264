"""Scenes drawn by casting rays with Warp on the processor, for machines without OpenGL."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import warp as wp
from numpy.typing import NDArray

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog_app.rendering import kernels
from homolog_app.rendering.hollows import warp_mesh, warp_vectors
from homolog_app.rendering.scene import Balls, Scene, Surface
from homolog_app.rendering.views import Frame

__all__ = ["RayCaster"]

_DEVICE = "cpu"
_BANDS = 4  # of rows, for each core: a shape fills some more than others
_SMALL_BALL_PIXELS = 8.0


class RayCaster:
    """Draws one scene after another, smooth at edges.

    A scene with the faces of the one before refits the tree that rays are searched in, which takes a fraction
    of building it. Not for several threads at a time.
    """

    name = "rays on the processor"

    def __init__(self) -> None:
        self._scene = kernels.Scene()
        self._faces: IntArray = np.empty((0, 3), np.int32)
        self._mesh: wp.Mesh | None = None
        self._buffers = _buffers(0, 0)  # kept: fresh memory costs as much as drawing in it
        wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it

    def draw(self, shown: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
        """Draw a scene: see `homolog_app.rendering.draw.draw`."""
        right, up, back = frame.view.axes
        step = frame.width / width
        height = max(round(frame.height / step), 1)
        middle = np.array(frame.centre) + back * frame.depth
        corner = middle - right * frame.width / 2.0 + up * height * step / 2.0
        triangles = self._take(shown, step)
        scene = self._scene
        scene.corner, scene.right, scene.up = (wp.vec3(*map(float, item)) for item in (corner, right, up))
        scene.step = step
        scene.cut = 0 if shown.cut is None else 1
        if shown.cut is not None:
            normal, origin = shown.cut
            scene.plane, scene.offset = wp.vec3(*map(float, normal)), float(normal @ origin)
            scene.cap = wp.vec3(*(part / 255.0 for part in shown.cap))
        if self._buffers[0].shape != (height, width):
            self._buffers = _buffers(height, width)
        nearest, relief, image = self._buffers
        way = triangles.vertices - corner
        places = np.stack([way @ right / step, way @ -up / step, way @ -back], axis=1)
        on_page = warp_vectors(places)
        rows = -(-height // (_BANDS * cores()))
        left, top = np.clip(np.floor(places[:, :2].min(axis=0)) - 1, 0, (width, height)).astype(int)
        end, bottom = np.clip(np.ceil(places[:, :2].max(axis=0)) + 1, 0, (width, height)).astype(int)

        def fill_band(band: int) -> None:
            inputs = [scene, on_page, rows, band, nearest, relief, image]
            wp.launch(kernels.fill, 1, inputs=inputs, device=_DEVICE)

        def smooth_band(band: int) -> None:
            first, last = max(band * rows, top), min((band + 1) * rows, bottom)
            if first < last and left < end:  # elsewhere is nothing
                inputs = [scene, relief, int(first), int(left), image]
                wp.launch(kernels.smooth_edges, (last - first, end - left), inputs=inputs, device=_DEVICE)

        with ThreadPoolExecutor(cores()) as pool:
            for draw_band in (fill_band, smooth_band):
                list(pool.map(draw_band, range(-(-height // rows))))
        return np.asarray(np.rint(255.0 * image.numpy()), dtype=np.uint8)

    def _take(self, shown: Scene, step: float) -> Surface:
        """Hand a scene to Warp, as one surface; `step` is the size of a pixel [mm]."""
        balls = shown.balls_left
        solids = [surface for surface in shown.surfaces if surface is not None]
        solids += [_ball_surface(balls, step)] if balls is not None else []
        starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
        faces = np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)])
        colours = [np.broadcast_to(solid.colours, solid.vertices.shape) for solid in solids]
        joined = Surface(
            np.concatenate([solid.vertices for solid in solids]),
            np.concatenate([solid.normals for solid in solids]),
            faces,
            np.concatenate(colours),
        )
        if self._mesh is not None and np.array_equal(faces, self._faces):
            self._mesh.points.assign(joined.vertices.astype(np.float32))
            self._mesh.refit()
        else:
            self._mesh, self._faces = warp_mesh(joined.vertices, faces), faces
            self._scene.mesh = self._mesh.id
            self._scene.faces = wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=_DEVICE)
        self._scene.normals = warp_vectors(joined.normals)
        self._scene.colours = warp_vectors(joined.colours / 255.0)
        return joined


def _buffers(height: int, width: int) -> tuple["wp.array", "wp.array", "wp.array"]:
    """Return room for each pixel's nearest face, its normal and depth, and its colour."""
    kinds = (int, wp.vec4, wp.vec4)
    nearest, relief, image = (wp.empty((height, width), dtype=kind, device=_DEVICE) for kind in kinds)
    return nearest, relief, image


def _ball_surface(balls: Balls, step: float) -> Surface:
    """Return balls as triangles, few where they are small in the picture."""
    unit, faces = _unit_ball(2 if balls.radius > _SMALL_BALL_PIXELS * step else 1)
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
