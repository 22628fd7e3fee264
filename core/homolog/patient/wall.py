"""Maps of a fitted shape that are compared with controls: position and thickness of the wall."""

import numpy as np

from homolog.arrays import FloatArray
from homolog.geometry import inverse_matrices, transform_points
from homolog.patient.fit import SurfaceFit
from homolog.patient.mesh_graph import median_of_ring
from homolog.patient.surface_model import SurfaceModel
from homolog.patient.target import Target
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints
from homolog.surfaces.walls import wall_thickness

__all__ = ["local_maps"]

_MEDIANS = 2
"""Rounds of medians over neighbours: rays that pass a rim give spikes of one vertex or two."""


def local_maps(model: SurfaceModel, fit: SurfaceFit, mesh: TriangleMesh) -> FloatArray:
    """Return a subject's maps at the model's vertices (2, V).

    Parameters
    ----------
    model : SurfaceModel
    fit : SurfaceFit
        Fit of the model to the mesh.
    mesh : TriangleMesh
        The subject's surface.

    Returns
    -------
    (2, V) array
        Distance of the surface from the expected one along its normals [mm], and the logarithm of the
        thickness below it, relative to its median: healthy walls differ more as a whole than locally.
    """
    normals = model.surface(fit.expected).vertex_normals
    places = fit.expected[: model.vertices] + fit.residual[:, None] * normals
    local = transform_points(inverse_matrices(fit.pose), places)
    nearest = Target(mesh).nearest(local, normals @ fit.pose[:3, :3])[1]
    logs = _log_thickness(mesh)[nearest]
    for _ in range(_MEDIANS):
        logs = median_of_ring(logs, model.faces)
    return np.stack([fit.residual, logs - np.median(logs)])


def _log_thickness(mesh: TriangleMesh) -> FloatArray:
    """Return logarithms of the thickness at the vertices (n,); where none is measured, the nearest one."""
    thickness = wall_thickness(mesh)
    known = np.isfinite(thickness) & (thickness > 0.0)
    if not known.any():  # a sheet, which has no walls
        return np.zeros(len(thickness))
    nearest = NearestPoints(mesh.vertices[known], mesh.vertex_normals[known]).nearest(mesh.vertices)[1]
    source = np.flatnonzero(known)[nearest]
    result: FloatArray = np.log(thickness[source])
    return result
