"""A shape model of particles and of the dense surface that they deform, with effects of covariates."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.statistics.shape_model import principal_components
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["SurfaceModel"]

_LEAST_RESIDUAL = 0.02
"""Lower bound of a vertex's residual deviation, relative to the root mean square residual."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceModel:
    """Mean, modes and covariates' effects of P points: V vertices of the mean surface, then N particles.

    Modes are those of the particles; vertices follow by regression on the particles' scores. Arrays are
    read-only.

    Attributes
    ----------
    mean : (P, 3) array
        Mean positions at the mean of the covariates [mm].
    components : (K, P, 3) array
        Modes; their particles are orthonormal.
    variances : (K,) array
        Variances of the scores [mm²].
    effects : (c, P, 3) array
        Change per unit of each standardised covariate column [mm].
    residual : (V,) array
        Standard deviation along the normal outside the modes [mm].
    faces : (F, 3) int array
        Faces of the surface.
    """

    mean: FloatArray
    components: FloatArray
    variances: FloatArray
    effects: FloatArray
    residual: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("mean", "components", "variances", "effects", "residual"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        object.__setattr__(self, "faces", frozen(self.faces, np.int32))

    @classmethod
    def fit(cls, points: FloatArray, columns: FloatArray, modes: int, faces: IntArray) -> "SurfaceModel":
        """Fit a model to aligned points.

        Parameters
        ----------
        points : (M, P, 3) array
            Vertices, then particles, of each subject [mm].
        columns : (M, c) array
            Standardised covariates; the model's mean is the shape at 0.
        modes : int
            Largest number of modes.
        faces : (F, 3) int array
            Faces of the vertices, which come first.

        Returns
        -------
        SurfaceModel
        """
        count, width = len(points), points.shape[1]
        vertices = int(faces.max()) + 1
        design = np.column_stack([np.ones(count), columns])
        rows = points.reshape(count, -1)
        coefficients = np.linalg.lstsq(design, rows, rcond=None)[0]
        rest = rows - design @ coefficients
        dof = max(count - design.shape[1], 1)
        scores, _, variances = principal_components(rest[:, 3 * vertices :], divisor=dof)
        kept = min(modes, len(variances))
        scores, variances = scores[:, :kept], variances[:kept]
        components = (scores / np.maximum(np.square(scores).sum(axis=0), 1e-300)).T @ rest
        mean = coefficients[0].reshape(width, 3)
        normals = TriangleMesh(mean[:vertices], faces).vertex_normals
        outside = (rest - scores @ components).reshape(count, width, 3)[:, :vertices]
        along = np.einsum("mvi,vi->mv", outside, normals)
        residual = np.sqrt(np.square(along).sum(axis=0) / max(dof - kept, 1))
        residual = np.maximum(
            residual, _LEAST_RESIDUAL * max(float(np.sqrt(np.square(residual).mean())), 1e-9)
        )
        return cls(
            mean,
            np.asarray(components.reshape(kept, width, 3), np.float64),
            variances,
            np.asarray(coefficients[1:].reshape(-1, width, 3), np.float64),
            residual,
            faces,
        )

    @property
    def vertices(self) -> int:
        """Number of the surface's vertices; particles follow."""
        return len(self.residual)

    def expected(self, columns: FloatArray) -> FloatArray:
        """Return the mean points (P, 3) at covariates (c,) [mm]."""
        shape: FloatArray = self.mean + np.tensordot(columns, self.effects, axes=1)
        return shape

    def surface(self, points: FloatArray) -> TriangleMesh:
        """Return the surface of points (P, 3)."""
        return TriangleMesh(points[: self.vertices], self.faces)
