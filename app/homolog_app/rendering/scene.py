"""Scenes: coloured surfaces, balls, arrows, lines, a cut, lights. Arrays only, for any process."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray, frozen
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.camera import Box, Cut

__all__ = [
    "AMBIENT", "CAP", "DIFFUSE", "LIGHTS", "Arrows", "Balls", "Colour", "Scene", "Surface", "bytes_of",
    "surface",
]  # fmt: skip

Colour = tuple[int, int, int]
"""Red, green, blue in 0 ... 255."""

LIGHTS = (((-0.3, 0.5, 1.0), 0.9), ((0.8, -0.9, 0.5), 0.35))
"""Direction (right, up, towards the viewer) and strength of each light. The second one lights dark places."""

AMBIENT, DIFFUSE = 0.4, 0.6
"""Parts of the light. Colours that mean numbers shall neither drown in shade nor in shine."""

CAP: Colour = (181, 106, 92)
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
    opacity : float
        In [0, 1]; software draws every surface as opaque.
    """

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray
    colours: Array
    opacity: float = 1.0


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
class Arrows:
    """Arrows, in the coordinates that are shown.

    Attributes
    ----------
    points, vectors : (A, 3) arrays
        Where each begins, and its way to the tip [mm].
    """

    points: FloatArray
    vectors: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything in a picture except texts. The software renderer draws only surfaces and balls.

    Attributes
    ----------
    surfaces : tuple of Surface or None
        None holds the place of one that is hidden for now.
    balls : Balls or None
    arrows : Arrows or None
    lines : (S, 2, 3) array or None
        Line segments [mm], such as the border of a region.
    marks : tuple of 3 int
        Colour of arrows and lines.
    through : bool
        Whether arrows and lines that lie behind a surface are seen faintly through it.
    cut : (normal, origin) or None
        A plane: only what its unit normal (3,) points to is drawn. The origin (3,) is one of its points [mm].
    cap : tuple of 3 int
        Colour of the surfaces of the cut.
    """

    surfaces: tuple[Surface | None, ...]
    balls: Balls | None = None
    arrows: Arrows | None = None
    lines: FloatArray | None = None
    marks: Colour = (0, 0, 0)
    through: bool = False
    cut: Cut | None = None
    cap: Colour = CAP

    @property
    def balls_left(self) -> Balls | None:
        """The balls that the cut leaves; no ball is cut in two."""
        if self.balls is None or self.cut is None:
            return self.balls
        normal, origin = self.cut
        centres, colours = self.balls.centres, self.balls.colours
        left = (centres - origin) @ normal > -self.balls.radius
        return Balls(centres[left], self.balls.radius, colours[left] if colours.ndim > 1 else colours)


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


def ball_radius(extent: Box, count: int) -> float:
    """Return the radius [mm] of balls for a number of particles, which leave half of the surface free.

    Parameters
    ----------
    extent : tuple of 6 float
        Of all the shapes that are seen [mm].
    count : int
        Number of particles of a shape; at least 1.
    """
    low, high = np.reshape(extent, (3, 2)).T
    size = float((high - low).mean())
    return float(np.clip(0.42 * size / np.sqrt(count), 0.006 * size, 0.035 * size))


def bytes_of(colours: FloatArray) -> Array:
    """Return colours in [0, 1] as uint8."""
    return frozen(np.rint(255.0 * np.clip(colours, 0.0, 1.0)), np.uint8)
