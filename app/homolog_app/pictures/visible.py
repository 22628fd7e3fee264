"""From where a part of a surface is seen."""

from itertools import product

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.scene import Scene, Surface
from homolog_app.rendering.software import Software
from homolog_app.rendering.views import View, frame_around

__all__ = ["view_of_region"]

_GLANCE = 72
"""Pixels of a picture in which a region's visible part is counted."""


def view_of_region(mesh: TriangleMesh, vertices: IntArray, centre: int) -> View:
    """Return the direction from which most of a region is seen, as other walls may hide it.

    Parameters
    ----------
    mesh : TriangleMesh
    vertices : (n,) int array
        Of the region.
    centre : int
        Its middle vertex, whose normal is tried first.
    """
    marked = np.zeros(mesh.vertices.shape, np.uint8)
    marked[vertices] = 255
    scene, software = Scene((Surface(mesh.vertices, mesh.vertex_normals, mesh.faces, marked),)), Software()
    ways = [np.array(way, dtype=np.float64) for way in product((-1, 0, 1), repeat=3) if any(way)]
    views = [_view(way) for way in [mesh.vertex_normals[centre], *ways]]
    width = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))  # one scale for all
    seen = [
        float(image[..., :3].sum())
        for image in (
            software.draw(scene, frame_around([mesh.vertices], view, width=width), _GLANCE) for view in views
        )
    ]
    return views[int(np.argmax(seen))]


def _view(toward: FloatArray) -> View:
    x, y, z = (toward / np.linalg.norm(toward)).tolist()
    return View((x, y, z), (0.0, 0.0, 1.0) if abs(z) < 0.9 else (0.0, -1.0, 0.0))
