"""The two entropies across shapes, H(Z) and H(V), in their M x M dual.

With the centred positions Y (M rows of 3N numbers) and C = Y Y' / (N (M - 1)), the regularized entropy
per particle is (M - 1) / 2M log det(I + C/a); its gradient by Y is (C + aI)^-1 Y up to the factor that the
weights absorb (docs/method.md). Everything is per particle, so that weights and regularization mean the
same for any number of particles.
"""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import Float32Array, FloatArray
from homolog.registration.entropy import covariance, inverse_dual

__all__ = ["Duals", "ensemble_entropy", "entropy", "solve_duals"]


@dataclass(frozen=True, slots=True, eq=False)
class Duals:
    """Small matrices across the shapes, (M, M) float32, and the entropies that they come from.

    Attributes
    ----------
    gradient : array
        Times Y it is the gradient of H(Z).
    damping : array
        (I + p gradient)^-1, the implicit part of the step.
    normals : array
        Times the Logs it is the gradient of H(V).
    entropies : (2,) float64 array
        H(Z) and H(V) per particle and shape.
    """

    gradient: Float32Array
    damping: Float32Array
    normals: Float32Array
    entropies: FloatArray


def entropy(matrix: FloatArray, regularization: float) -> float:
    """Return (M - 1) / 2M log det(I + C/a), the entropy per particle and shape (the paper's H(Z), H(V)).

    It is measured relative to identical shapes, for which it is 0 for any a.
    """
    shapes = len(matrix)
    _, logdet = np.linalg.slogdet(matrix / regularization + np.eye(shapes))
    return 0.5 * (shapes - 1) / shapes * float(logdet)


def ensemble_entropy(points: FloatArray, regularization: float) -> float:
    """Return H(Z) of aligned particles (M, n, 3) (see `entropy`)."""
    rows = points.reshape(len(points), -1)
    return entropy(covariance(rows - rows.mean(axis=0)), regularization)


def solve_duals(
    ensemble: FloatArray,
    normals: FloatArray,
    regularization: float,
    normals_regularization: float,
    step_weight: float,
) -> Duals:
    """Return the matrices of the step from the two covariances.

    Parameters
    ----------
    ensemble, normals : (M, M) arrays
        C of positions [squared optimizer lengths] and of normals [rad²].
    regularization, normals_regularization : float
        a and b, in the same units.
    step_weight : float
        p, the step's tau times the ensemble's weight.

    Notes
    -----
    (I + p (C + aI)^-1)^-1 = I - p (C + (a + p) I)^-1.
    """
    gradient = inverse_dual(ensemble, regularization)
    damping = np.eye(len(ensemble)) - step_weight * inverse_dual(ensemble, regularization + step_weight)
    normals_inverse = inverse_dual(normals, normals_regularization)
    entropies = np.array([entropy(ensemble, regularization), entropy(normals, normals_regularization)])
    return Duals(
        gradient.astype(np.float32), damping.astype(np.float32), normals_inverse.astype(np.float32), entropies
    )
