"""Scenes: coloured surfaces, balls, arrows, lines, a cut, lights. They contain only arrays."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray, frozen
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.camera import Box, Cut

__all__ = [
    "AMBIENT",
    "CAP",
    "DIFFUSE",
    "LIGHTS",
    "Arrows",
    "Balls",
    "Colour",
    "Scene",
    "Surface",
    "bytes_of",
    "surface",
]

Colour = tuple[int, int, int]
"""Red, green, blue in 0 ... 255."""

LIGHTS = (((-0.3, 0.5, 1.0), 0.9), ((0.8, -0.9, 0.5), 0.35))
"""Direction (right, up, towards the viewer) and strength of each light. The second one brightens shadows."""

AMBIENT, DIFFUSE = 0.4, 0.6
"""Shares of the light. Shading and highlights are weak, because colours represent numbers."""

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
        Opacity in [0, 1]; the software renderer draws every surface as opaque.
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
        Centres [mm].
    radius : float
        Radius [mm].
    colours : (3,) or (n, 3) uint8 array
        Red, green, blue.
    """

    centres: FloatArray
    radius: float
    colours: Array


@dataclass(frozen=True, slots=True, eq=False)
class Arrows:
    """Arrows, in displayed coordinates.

    Attributes
    ----------
    points, vectors : (A, 3) arrays
        Start of each arrow, and vector to its tip [mm].
    """

    points: FloatArray
    vectors: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything in a picture except texts. The software renderer draws only surfaces and balls.

    Attributes
    ----------
    surfaces : tuple of Surface or None
        The surfaces; None is a placeholder for a hidden one.
    balls : Balls or None
    arrows : Arrows or None
    lines : (S, 2, 3) array or None
        Line segments [mm], such as the border of a region.
    marks : tuple of 3 int
        Colour of arrows and lines.
    through : bool
        Whether arrows and lines behind a surface are faintly visible through it.
    cut : (normal, origin) or None
        A cutting plane: only the side of its unit normal (3,) is drawn. The origin (3,) is a point on it
        [mm].
    cap : tuple of 3 int
        Colour of the cut surfaces.
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
        """The balls on the visible side of the cut; whole balls are kept or removed."""
        if self.balls is None or self.cut is None:
            return self.balls
        normal, origin = self.cut
        centres, colours = self.balls.centres, self.balls.colours
        left = (centres - origin) @ normal > -self.balls.radius
        return Balls(centres[left], self.balls.radius, colours[left] if colours.ndim > 1 else colours)


def surface(
    mesh: TriangleMesh,
    colours: FloatArray,
    light: FloatArray | None = None,
    normals: FloatArray | None = None,
) -> Surface:
    """Return a mesh as a surface.

    Parameters
    ----------
    mesh : TriangleMesh
    colours : (3,) or (V, 3) array
        Red, green, blue in [0, 1].
    light : (V,) array, optional
        Share of the light that reaches each vertex, such as from `hollows`.
    normals : (V, 3) array, optional
        The mesh's `vertex_normals`, where they are known.
    """
    shaded = colours if light is None else np.broadcast_to(colours, mesh.vertices.shape) * light[:, None]
    normals = mesh.vertex_normals if normals is None else normals
    return Surface(mesh.vertices, normals, mesh.faces, bytes_of(shaded))


def ball_radius(extent: Box, count: int) -> float:
    """Return the radius [mm] of balls for a number of particles, such that half of the surface is free.

    Parameters
    ----------
    extent : tuple of 6 float
        Extent of all visible shapes [mm].
    count : int
        Number of particles of a shape; at least 1.
    """
    low, high = np.reshape(extent, (3, 2)).T
    size = float((high - low).mean())
    return float(np.clip(0.42 * size / np.sqrt(count), 0.006 * size, 0.035 * size))


def bytes_of(colours: FloatArray) -> Array:
    """Return colours in [0, 1] as uint8."""
    return frozen(np.rint(255.0 * np.clip(colours, 0.0, 1.0)), np.uint8)
