"""The zero level of a distance field as a mesh of even triangles."""

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import InputError, NumericalError
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.remesh import remeshed
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import face_components

__all__ = ["coarse_isosurface", "isosurface", "marching_cubes"]

VERTICES = 6000
MOST_VERTICES = 250_000
_EQUILATERAL = 2.0 / np.sqrt(3.0)  # edge² times vertices, over the area
_SLIVER = 0.05  # of the volume of the nodes inside
_NEAREST = 1e-3
"""Values closer to zero than this part of the largest are moved away: vertices on nodes make needles."""


def isosurface(field: DistanceField, edge: float | None = None, adaptive: bool = False) -> TriangleMesh:
    """Return the zero level of a distance field.

    Parameters
    ----------
    field : DistanceField
        Its border is outside.
    edge : float or None
        Wished edge length [mm]; about 6000 vertices if None.
    adaptive : bool
        Smaller triangles where the surface is strongly curved, larger ones elsewhere.

    Returns
    -------
    TriangleMesh
        Closed, manifold, one component, outward.

    Raises
    ------
    InputError
        If the edges are too short for this surface, or hardly anything is inside: threads of voxels.
    NumericalError
        If the field has no zero level.
    """
    if field.values.min() >= 0.0:
        raise NumericalError(
            "nothing is left of the shape after smoothing; use a finer grid or less smoothing"
        )
    nodes, faces = marching_cubes(field.values)
    raw = TriangleMesh(nodes @ field.index_to_world[:3, :3].T + field.index_to_world[:3, 3], faces)
    inside = np.count_nonzero(field.values < 0.0) * abs(np.linalg.det(field.index_to_world[:3, :3]))
    if raw.volume < _SLIVER * inside:
        raise InputError("is too thin for its grid; use a finer grid spacing, or leave it out")
    edge = edge or _edge_for(raw.area, VERTICES)
    count = round(_EQUILATERAL * raw.area / edge**2)
    if count > MOST_VERTICES:
        least = _edge_for(raw.area, MOST_VERTICES)
        raise InputError(
            f"mesh edges of {edge:g} mm would make {count} vertices; choose {least:.2g} mm or more"
        )
    return remeshed(simplified(raw, count), field, edge, adaptive)


def coarse_isosurface(field: DistanceField, mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the zero level with about `n_vertices` vertices, made from a finer one."""
    return remeshed(simplified(mesh, n_vertices), field, _edge_for(mesh.area, n_vertices))


def _edge_for(area: float, n_vertices: int) -> float:
    """Edge length of that many equilateral triangles' vertices on a closed surface."""
    return float(np.sqrt(_EQUILATERAL * area / n_vertices))


def marching_cubes(values: Array) -> tuple[FloatArray, IntArray]:
    """Return the largest component of the zero level of values on a grid.

    Parameters
    ----------
    values : (I, J, K) array
        Negative inside, positive at the border.

    Returns
    -------
    (V, 3) float64 array
        Vertices, in grid indices.
    (F, 3) int array
        Faces, counter-clockwise seen from outside.
    """
    from skimage import measure

    least = _NEAREST * float(np.abs(values).max())
    values = np.where(np.abs(values) < least, np.where(values < 0.0, -least, least), values)
    vertices, faces, _, _ = measure.marching_cubes(values, 0.0, gradient_direction="descent")
    faces = faces[face_components(faces) == 0]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used].astype(np.float64), faces.reshape(-1, 3)
