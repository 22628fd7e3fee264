"""Pictures without OpenGL: ray casting with Warp on the CPU, and ambient light."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp
from numpy.typing import NDArray

from homolog.arrays import FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.openness import openness, warp_vectors
from homolog.threads import cores
from homolog_app.rendering import kernels
from homolog_app.rendering.camera import Frame
from homolog_app.rendering.scene import Scene, Surface, surface

__all__ = ["Software", "hollows", "shaded"]


_DEVICE = "cpu"
_OCCLUSION_DEPTH = 0.45
_OCCLUSION_REACH = 0.25


def shaded(mesh: TriangleMesh, colours: FloatArray) -> Surface:
    """Return a mesh with colours, (3,) or (V, 3) in [0, 1], that are darkened by ambient occlusion."""
    light, normals = openness(mesh, _reach(mesh))
    return surface(mesh, colours, _ambient(light), normals)


def hollows(mesh: TriangleMesh) -> FloatArray:
    """Return the share of ambient light at each vertex, (V,), reduced where the surface occludes itself."""
    return _ambient(openness(mesh, _reach(mesh))[0])


def _reach(mesh: TriangleMesh) -> float:
    return float(_OCCLUSION_REACH * np.ptp(mesh.vertices, axis=0).max())


def _ambient(light: FloatArray) -> FloatArray:
    return np.asarray(1.0 - _OCCLUSION_DEPTH * (1.0 - light))


_BANDS = 4  # largest number of bands of rows per core, which balance the load
_LEAST_ROWS = 100  # of a band


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
        axes = np.stack([right, -up, -back], axis=1)
        scale = np.array([step, step, 1.0])  # columns and rows in samples, depths in mm

        def placed(points: FloatArray) -> FloatArray:
            return np.asarray((points - corner) @ axes / scale, np.float32)

        shown, balls = _joined(scene), scene.balls_left
        places = placed(shown.vertices)
        faces, near = _nearest_first(places, shown.faces)
        solids = kernels.Solids()
        solids.faces = wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=_DEVICE)
        solids.places, solids.colours = warp_vectors(places), warp_vectors(shown.colours)
        solids.normals = warp_vectors(shown.normals @ np.stack([right, up, back], axis=1))
        if balls is not None:
            solids.centres, solids.radius = warp_vectors(placed(balls.centres)), balls.radius / step
            solids.ball_colours = warp_vectors(np.broadcast_to(balls.colours, balls.centres.shape))
        solids.corner, solids.right, solids.up = (wp.vec3(*map(float, item)) for item in (corner, right, up))
        solids.step = step
        solids.cut = 0 if scene.cut is None else 1
        if scene.cut is not None:
            normal, origin = scene.cut
            solids.plane, solids.offset = wp.vec3(*map(float, normal)), float(normal @ origin)
            solids.cap = wp.vec3(*map(float, scene.cap))
        image = wp.empty((height, width), dtype=wp.vec4ub, device=_DEVICE)
        wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it
        rows = -(-height // min(_BANDS * cores(), max(cores(), height // _LEAST_ROWS)))

        def fill_band(first: int) -> None:
            size = kernels.SMOOTH * min(rows, height - first), kernels.SMOOTH * width
            hits, depths = (wp.empty(size, dtype=kind, device=_DEVICE) for kind in (int, float))
            tiles = tuple(-(-side // kernels.TILE) for side in size)
            farthest = wp.empty(tiles, dtype=float, device=_DEVICE)
            inputs = [solids, first, near, hits, depths, farthest, image]
            wp.launch(kernels.fill, 1, inputs=inputs, device=_DEVICE)

        with ThreadPoolExecutor(cores()) as pool:
            list(pool.map(fill_band, range(0, height, rows)))
        return np.array(image.numpy())


def _nearest_first(places: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """Return faces in another order, and the number of those in front: outer sides in the nearer half.

    Most of the others are then found to be hidden without testing their samples.
    """
    a, b, c = (places[faces[:, corner]] for corner in range(3))
    outer = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    front = outer & (a[:, 2] < a[:, 2].sum() / max(len(faces), 1))
    return np.concatenate([faces[front], faces[~front]]), int(front.sum())


def _joined(scene: Scene) -> Surface:
    """Return the surfaces of a scene as one."""
    none = Surface(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty((0, 3)))
    solids = [surface for surface in scene.surfaces if surface is not None] or [none]
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    return Surface(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.normals for solid in solids]),
        np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)]),
        np.concatenate([np.broadcast_to(solid.colours, solid.vertices.shape) for solid in solids]),
    )
