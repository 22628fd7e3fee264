"""What is drawn: coloured surfaces, balls, a cut and the light. Arrays only, which any process can draw."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray, frozen
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.clipping import Cut

__all__ = ["AMBIENT", "CAP", "DIFFUSE", "LIGHTS", "Balls", "Scene", "Surface", "bytes_of", "surface"]

LIGHTS = (((-0.3, 0.5, 1.0), 0.9), ((0.8, -0.9, 0.5), 0.35))
"""Direction (right, up, towards the viewer) and strength of each light. The second one lights dark places."""

AMBIENT, DIFFUSE = 0.4, 0.6
"""Parts of the light. Colours that mean numbers shall neither drown in shade nor in shine."""

CAP = (181, 106, 92)
"""Colour of cut surfaces."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles.

    Attributes
    ----------
    vertices, normals : (V, 3) array
        Positions [mm] and unit outward normals.
    faces : (F, 3) int array
        Vertex indices.
    colours : (3,) or (V, 3) uint8 array
        Red, green, blue.
    """

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray
    colours: Array


@dataclass(frozen=True, slots=True, eq=False)
class Balls:
    """Balls of one size, such as particles.

    Attributes
    ----------
    centres : (n, 3) array
        Midpoints [mm].
    radius : float
        [mm].
    colours : (3,) or (n, 3) uint8 array
        Red, green, blue.
    """

    centres: FloatArray
    radius: float
    colours: Array


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything in a picture.

    Attributes
    ----------
    surfaces : tuple of Surface
    balls : Balls or None
    cut : (normal, origin) or None
        A plane: only what its unit normal (3,) points to is drawn. The origin (3,) is one of its points [mm].
    cap : tuple of 3 int
        Colour of the surfaces of the cut, 0 ... 255.
    """

    surfaces: tuple[Surface, ...]
    balls: Balls | None = None
    cut: Cut | None = None
    cap: tuple[int, int, int] = CAP


def surface(mesh: TriangleMesh, colours: FloatArray, light: FloatArray | None = None) -> Surface:
    """Return a mesh as a surface.

    Parameters
    ----------
    mesh : TriangleMesh
    colours : (3,) or (V, 3) array
        Red, green, blue in [0, 1].
    light : (V,) array, optional
        Share of the light that reaches each vertex, such as `hollows` gives it.
    """
    shaded = colours if light is None else np.broadcast_to(colours, mesh.vertices.shape) * light[:, None]
    return Surface(mesh.vertices, mesh.vertex_normals, mesh.faces, bytes_of(shaded))


def bytes_of(colours: FloatArray) -> Array:
    """Return colours in [0, 1] as uint8."""
    return frozen(np.rint(255.0 * np.clip(colours, 0.0, 1.0)), np.uint8)
