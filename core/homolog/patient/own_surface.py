"""A patient's own surface, and the mapping of values from the reference's vertices."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from homolog.arrays import BoolArray, FloatArray
from homolog.patient.target import NORMAL_WEIGHT, Target
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints

__all__ = ["OwnSurface", "own_surface"]

_NEIGHBOURS = 8
"""Number of the reference's vertices whose values are averaged at a vertex of the patient."""


@dataclass(frozen=True, slots=True, eq=False)
class OwnSurface:
    """A patient's own surface, on which maps are drawn.

    Attributes
    ----------
    mesh : TriangleMesh
        P vertices in the file's frame [mm]: the groomed surface, then the expected surface of the part cut
        off by the border of the image.
    weights : (P, V) sparse array
        Weights of the values at the reference's vertices; rows sum to 1.
    """

    mesh: TriangleMesh
    weights: csr_array

    def carried(self, values: FloatArray) -> FloatArray:
        """Return values (V, …) of the reference's vertices on the patient's surface (P, …)."""
        return np.asarray(self.weights @ values, np.float64)

    def marked(self, marks: BoolArray) -> BoolArray:
        """Return marks (V,) of the reference's vertices on the patient's surface (P,)."""
        return self.carried(marks.astype(np.float64)) > 0.5


def own_surface(
    mesh: TriangleMesh, expected: TriangleMesh, residual: FloatArray, met: BoolArray, missing: BoolArray
) -> OwnSurface:
    """Map the reference's vertices to a patient's surface, by closest points in position and normal.

    The reference's triangles are not used: in thin or folded parts its vertices do not lie on the
    patient in the order of the mean. Normals keep the values of opposite walls apart.

    Parameters
    ----------
    mesh : TriangleMesh
        The groomed surface in the file's frame [mm].
    expected : TriangleMesh
        Expected surface with the reference's V vertices, in the same frame.
    residual : (V,) array
        Distance of the patient's surface from them along their normals [mm], outward positive.
    met : (V,) bool array
        Whether the normal meets the surface. Otherwise the residual is the distance to its nearest point.
    missing : (V,) bool array
        Vertices cut off by the border of the image.

    Returns
    -------
    OwnSurface
    """
    target, normals = Target(mesh), expected.vertex_normals
    places = expected.vertices + residual[:, None] * normals
    away = ~met & ~missing
    nearest = target.nearest(places, normals)[1]
    if away.any():
        nearest[away] = NearestPoints.of(mesh).nearest(expected.vertices[away])[1]
        places[away] = mesh.vertices[nearest[away]]
    directions = np.where(missing[:, None], normals, target.normals[nearest])
    whole, cut = _joined(mesh, expected, missing)
    vertices = NearestPoints(places, directions, NORMAL_WEIGHT * target.size)
    goals = np.concatenate([target.normals, normals[cut]])
    gaps, near = vertices.nearest(whole.vertices, goals, count=_NEIGHBOURS + 1)
    weights = np.square(1.0 - gaps[:, :-1] / np.maximum(gaps[:, -1:], 1e-9)) + 1e-9
    rows = np.repeat(np.arange(len(near)), _NEIGHBOURS)
    shares = weights / weights.sum(axis=1, keepdims=True)
    matrix = csr_array((shares.ravel(), (rows, near[:, :-1].ravel())), shape=(len(near), len(places)))
    return OwnSurface(whole, matrix)


def _joined(mesh: TriangleMesh, expected: TriangleMesh, missing: BoolArray) -> tuple[TriangleMesh, BoolArray]:
    """Return a surface together with the missing faces, and which vertices (V,) these use."""
    faces = expected.faces[missing[expected.faces].all(axis=1)]
    used = np.zeros(len(missing), np.bool_)
    used[faces] = True
    numbers = len(mesh.vertices) + np.cumsum(used) - 1
    vertices = np.concatenate([mesh.vertices, expected.vertices[used]])
    return TriangleMesh(vertices, np.concatenate([mesh.faces, numbers[faces].astype(mesh.faces.dtype)])), used
