"""Shaded, antialiased images of solids, computed with Warp on the processor."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp
from numpy.typing import NDArray

from homolog.arrays import FloatArray
from homolog.device import cores
from homolog_app.clipping import Cut
from homolog_app.pictures import kernels
from homolog_app.pictures.solids import Solid, warp_mesh, warp_vectors
from homolog_app.pictures.views import Frame

__all__ = ["Renderer", "render"]

_DEVICE = "cpu"
_BANDS = 4  # of rows, for each core: a shape fills some more than others


class Renderer:
    """Solids that are drawn again and again, moved, recoloured or seen from elsewhere.

    Moving refits the tree that rays are searched in, which takes a fraction of building it.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
        faces = np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)])
        self._vertices = np.concatenate([solid.vertices for solid in solids])
        self._mesh = warp_mesh(self._vertices, faces)
        self._scene = kernels.Scene()
        self._scene.mesh = self._mesh.id
        self._scene.faces = wp.array(faces.astype(np.int32), dtype=wp.vec3i, device=_DEVICE)
        self._scene.normals = warp_vectors(np.concatenate([solid.normals for solid in solids]))
        self._scene.colours = warp_vectors(np.concatenate([solid.colours for solid in solids]))
        self._buffers = _buffers(0, 0)  # kept: fresh memory costs as much as drawing in it
        wp.load_module(kernels, device=_DEVICE)  # once, before threads launch on it

    def move(self, vertices: FloatArray, normals: FloatArray, colours: FloatArray) -> None:
        """Give all vertices new positions [mm], unit normals and colours, (V, 3) each."""
        self._vertices = vertices
        self._mesh.points.assign(vertices.astype(np.float32))
        self._mesh.refit()
        self._scene.normals.assign(normals.astype(np.float32))
        self._scene.colours.assign(colours.astype(np.float32))

    def draw(
        self, frame: Frame, width: int, cut: Cut | None = None, cap: Sequence[float] = (0.7, 0.4, 0.35)
    ) -> NDArray[np.float32]:
        """Draw the solids in parallel projection.

        Parameters
        ----------
        frame : Frame
            The part of the world to show.
        width : int
            Pixels along the frame's width; pixels are square.
        cut : (normal, origin), optional
            A plane: draw only what its normal (3,) points to. The origin (3,) is one of its points [mm].
        cap : sequence of 3 float
            Colour of the cut surface.

        Returns
        -------
        image : (height, width, 4) float32 array
            Red, green, blue and opacity in [0, 1], the first row on top; empty pixels are transparent.
        """
        right, up, back = frame.view.axes
        step = frame.width / width
        height = max(round(frame.height / step), 1)
        middle = np.array(frame.centre) + back * frame.depth
        corner = middle - right * frame.width / 2.0 + up * height * step / 2.0
        scene = self._scene
        scene.corner, scene.right, scene.up = (wp.vec3(*map(float, item)) for item in (corner, right, up))
        scene.step = step
        scene.cut = 0 if cut is None else 1
        if cut is not None:
            scene.plane, scene.offset = wp.vec3(*map(float, cut[0])), float(cut[0] @ cut[1])
            scene.cap = wp.vec3(*map(float, cap))
        if self._buffers[0].shape != (height, width):
            self._buffers = _buffers(height, width)
        nearest, relief, image = self._buffers
        way = self._vertices - corner
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
        return np.array(image.numpy())


def _buffers(height: int, width: int) -> tuple["wp.array", "wp.array", "wp.array"]:
    """Return room for each pixel's nearest face, its normal and depth, and its colour."""
    kinds = (int, wp.vec4, wp.vec4)
    nearest, relief, image = (wp.empty((height, width), dtype=kind, device=_DEVICE) for kind in kinds)
    return nearest, relief, image


def render(solids: Sequence[Solid], frame: Frame, width: int) -> NDArray[np.float32]:
    """Draw solids once: see `Renderer.draw`."""
    return Renderer(solids).draw(frame, width)
