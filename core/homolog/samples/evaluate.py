"""How far particles are from their true places, where the correspondence of surfaces is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.surfaces.closest import closest_faces
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["PlaceErrors", "place_errors"]


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
    placed = [closest_faces(mesh, points) for mesh, points in zip(meshes, particles, strict=True)]
    for subject, (on, weights) in enumerate(placed):
        true = np.einsum("nc,mncx->mnx", weights, vertices[:, faces[on]])
        distances.append(np.delete(np.linalg.norm(true - particles, axis=2), subject, axis=0))
        for other, (there, _) in enumerate(placed[:subject]):
            cosines = np.einsum("nx,nx->n", normals[other, on], normals[other, there])
            opposed.append(float((cosines < 0.0).mean()))
    return PlaceErrors(np.stack(distances), float(np.mean(opposed)))
