"""Shaded, antialiased images of surfaces and balls, computed with Warp on the processor."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.pictures import kernels
from homolog_app.pictures.kernels import cast, occlude
from homolog_app.pictures.views import Frame

__all__ = ["Solid", "balls", "render", "surface", "vertex_normals"]

_DEVICE = "cpu"
_OCCLUSION_RAYS = 48
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


def vertex_normals(mesh: TriangleMesh) -> FloatArray:
    """Return unit outward normals at the vertices, weighted by area, shape (V, 3)."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(total, mesh.faces[:, corner], across)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30))


def surface(mesh: TriangleMesh, colours: FloatArray) -> Solid:
    """Return a mesh as a solid whose hollows are darker.

    Parameters
    ----------
    mesh : TriangleMesh
        The surface.
    colours : (3,) or (V, 3) array
        Red, green, blue in [0, 1].
    """
    normals = vertex_normals(mesh)
    openness = 1.0 - _OCCLUSION_DEPTH * (1.0 - _openness(mesh, normals))
    shaded = np.broadcast_to(colours, mesh.vertices.shape) * openness[:, None]
    return Solid(mesh.vertices, normals, mesh.faces, shaded)


def balls(centres: FloatArray, radius: float, colours: FloatArray) -> Solid:
    """Return balls as a solid.

    Parameters
    ----------
    centres : (n, 3) array
        Midpoints [mm].
    radius : float
        Their common radius [mm].
    colours : (3,) or (n, 3) array
        Red, green, blue in [0, 1].
    """
    unit, faces = _unit_ball()
    count, size = len(centres), len(unit)
    colours = np.broadcast_to(colours, (count, 3))
    return Solid(
        vertices=(centres[:, None] + radius * unit).reshape(-1, 3),
        normals=np.tile(unit, (count, 1)),
        faces=(np.arange(count)[:, None, None] * size + faces).reshape(-1, 3),
        colours=np.repeat(colours, size, axis=0),
    )


def render(solids: Sequence[Solid], frame: Frame, width: int) -> NDArray[np.float32]:
    """Draw solids in parallel projection.

    Parameters
    ----------
    solids : sequence of Solid
        What to draw.
    frame : Frame
        The part of the world to show.
    width : int
        Pixels along the frame's width; pixels are square.

    Returns
    -------
    image : (height, width, 4) float32 array
        Red, green, blue and opacity in [0, 1], the first row on top; empty pixels are transparent.
    """
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    faces = np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)])
    mesh = _warp_mesh(np.concatenate([solid.vertices for solid in solids]), faces)
    right, up, back = frame.view.axes
    step = frame.width / width
    height = max(round(frame.height / step), 1)
    corner = (
        np.array(frame.centre) - right * frame.width / 2.0 + up * height * step / 2.0 + back * frame.depth
    )
    image = wp.empty((height, width), dtype=wp.vec4, device=_DEVICE)
    inputs = [
        mesh.id,
        wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=_DEVICE),
        _vectors(np.concatenate([solid.normals for solid in solids])),
        _vectors(np.concatenate([solid.colours for solid in solids])),
        *(wp.vec3(*map(float, vector)) for vector in (corner, right, up)),
        step,
    ]
    threads = min(cores(), height)

    def draw_rows(first: int) -> None:
        count = len(range(first, height, threads))
        wp.launch(cast, (count, width), inputs=[*inputs, first, threads, image], device=_DEVICE)

    wp.load_module(kernels, device=_DEVICE)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(draw_rows, range(threads)))
    pixels = np.array(image.numpy())
    pixels[..., :3] /= np.maximum(pixels[..., 3:], 1e-6)
    return pixels


def _openness(mesh: TriangleMesh, normals: FloatArray) -> FloatArray:
    """Share of the sky that each vertex sees, weighted by cosine, up to a reach relative to the shape."""
    index = (np.arange(_OCCLUSION_RAYS) + 0.5) / _OCCLUSION_RAYS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_OCCLUSION_RAYS)
    radius = np.sqrt(index)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - index)], axis=1)
    openness = wp.empty(len(mesh.vertices), dtype=float, device=_DEVICE)
    cast_on = _warp_mesh(mesh.vertices, mesh.faces)
    wp.launch(
        occlude,
        len(mesh.vertices),
        inputs=[
            cast_on.id,
            _vectors(mesh.vertices),
            _vectors(normals),
            _vectors(directions),
            float(_OCCLUSION_REACH * np.ptp(mesh.vertices, axis=0).max()),
            openness,
        ],
        device=_DEVICE,
    )
    return np.asarray(openness.numpy(), dtype=np.float64)


def _warp_mesh(vertices: FloatArray, faces: IntArray) -> "wp.Mesh":
    indices = wp.array(faces.astype(np.int32).ravel(), dtype=int, device=_DEVICE)
    return wp.Mesh(_vectors(vertices), indices)


def _vectors(values: FloatArray) -> "wp.array":
    return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=wp.vec3, device=_DEVICE)


def _unit_ball() -> tuple[FloatArray, IntArray]:
    """Split an octahedron's faces twice and blow it up: 66 vertices, 128 faces."""
    points = [tuple(sign * axis) for axis in np.eye(3) for sign in (1.0, -1.0)]
    faces = [(x, y, z) if (x + y + z) % 2 == 0 else (x, z, y) for x in (0, 1) for y in (2, 3) for z in (4, 5)]
    for _ in range(2):
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
