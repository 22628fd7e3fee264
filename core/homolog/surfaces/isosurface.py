"""The zero level of a distance field as a mesh of even triangles."""

import numpy as np

from homolog.errors import NumericalError
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.remesh import remeshed
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import face_components

__all__ = ["coarse_isosurface", "isosurface"]

VERTICES = 6000
_EQUILATERAL = 2.0 / np.sqrt(3.0)  # edge² times vertices, over the area
_NEAREST = 0.01
"""Values closer to zero than this part of the spacing are moved away: vertices on nodes make needles."""


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
    NumericalError
        If the field has no zero level.
    """
    raw = _marching_cubes(field)
    edge = edge or _edge_for(raw.area, VERTICES)
    return remeshed(simplified(raw, round(_EQUILATERAL * raw.area / edge**2)), field, edge, adaptive)


def coarse_isosurface(field: DistanceField, mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the zero level with about `n_vertices` vertices, made from a finer one."""
    return remeshed(simplified(mesh, n_vertices), field, _edge_for(mesh.area, n_vertices))


def _edge_for(area: float, n_vertices: int) -> float:
    """Edge length of that many equilateral triangles' vertices on a closed surface."""
    return float(np.sqrt(_EQUILATERAL * area / n_vertices))


def _marching_cubes(field: DistanceField) -> TriangleMesh:
    from skimage.measure import marching_cubes

    values = np.array(field.values)
    least = _NEAREST * field.spacing
    values = np.where(np.abs(values) < least, np.where(values < 0.0, -least, least), values)
    if values.min() >= 0.0:
        raise NumericalError(
            "nothing is left of the shape after smoothing; use a finer grid or less smoothing"
        )
    nodes, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    faces = faces[face_components(faces) == 0]
    used, faces = np.unique(faces, return_inverse=True)
    vertices = nodes[used] @ field.index_to_world[:3, :3].T + field.index_to_world[:3, 3]
    return TriangleMesh(vertices, faces.reshape(-1, 3))
