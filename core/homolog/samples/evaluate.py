"""How far particles are from their true places, where the correspondence of surfaces is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["PlaceErrors", "place_errors", "places_on"]

_CANDIDATES = 32
"""Faces by their centres, of which the nearest is that of a point."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaceErrors:
    """Errors of corresponding particles. Arrays are read-only.

    Attributes
    ----------
    distances : (M, M - 1, N) array
        Distance of a particle on every other subject from where the truth carries it [mm].
    opposed : float
        Share of pairs of corresponding particles whose surface normals, carried by the truth to one subject,
        are more than 90° apart.
    """

    distances: FloatArray
    opposed: float

    def __post_init__(self) -> None:
        """Freeze the array."""
        object.__setattr__(self, "distances", frozen(self.distances))


def place_errors(meshes: Sequence[TriangleMesh], particles: FloatArray) -> PlaceErrors:
    """Return the errors of particles (M, N, 3) [mm] on M meshes of which equal faces correspond."""
    vertices, faces = np.stack([mesh.vertices for mesh in meshes]), meshes[0].faces
    normals = vertices[:, faces]
    normals = np.cross(normals[:, :, 1] - normals[:, :, 0], normals[:, :, 2] - normals[:, :, 0])
    distances, opposed = [], []
    placed = [places_on(own, faces, points) for own, points in zip(vertices, particles, strict=True)]
    for subject, (on, weights) in enumerate(placed):
        true = np.einsum("nc,mncx->mnx", weights, vertices[:, faces[on]])
        distances.append(np.delete(np.linalg.norm(true - particles, axis=2), subject, axis=0))
        for other, (there, _) in enumerate(placed[:subject]):
            cosines = np.einsum("nx,nx->n", normals[other, on], normals[other, there])
            opposed.append(float((cosines < 0.0).mean()))
    return PlaceErrors(np.stack(distances), float(np.mean(opposed)))


def places_on(vertices: FloatArray, faces: IntArray, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the faces (n,) of a surface on which points (n, 3) lie, and barycentric coordinates (n, 3)."""
    corners = vertices[faces]
    near = np.asarray(KDTree(corners.mean(axis=1)).query(points, k=min(_CANDIDATES, len(faces)))[1])
    first, *others = corners[near].transpose(2, 0, 1, 3)
    sides = np.stack([other - first for other in others], axis=-1)
    inner = (np.linalg.pinv(sides) @ (points[:, None] - first)[..., None])[..., 0]
    weights = np.maximum(np.concatenate([1.0 - inner.sum(axis=-1, keepdims=True), inner], axis=-1), 0.0)
    weights /= weights.sum(axis=-1, keepdims=True)
    candidates = np.einsum("nkc,nkcx->nkx", weights, corners[near])
    best = np.linalg.norm(candidates - points[:, None], axis=-1).argmin(axis=1)
    rows = np.arange(len(points))
    return near[rows, best], weights[rows, best]
