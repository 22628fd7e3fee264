"""The shape model: principal components of corresponding particles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from homolog.analysis.checks import checked_particles
from homolog.analysis.procrustes import align, sizes
from homolog.arrays import FloatArray, frozen

__all__ = ["ShapeModel", "fit_shape_model", "principal_components"]

NEGLIGIBLE = 1e-9
"""Modes with less than this part of the first one's variance are rounding of the Gram matrix."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeModel:
    """Mean shape and orthonormal modes of variation, the largest first. All arrays are read-only.

    Attributes
    ----------
    mean : (N, 3) array
        Mean positions [mm].
    modes : (K, N, 3) array
        Unit vectors of shape space, K < M.
    variances : (K,) array
        Variance along each mode [mm²], with the divisor M - 1.
    scores : (M, K) array
        Coordinates of the M subjects in the modes [mm].
    sizes : (M,) array
        Root mean square distance of a subject's particles from their centroid [mm], before any scaling.
    """

    mean: FloatArray
    modes: FloatArray
    variances: FloatArray
    scores: FloatArray
    sizes: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation along each mode [mm], shape (K,)."""
        deviations: FloatArray = np.sqrt(self.variances)
        return deviations

    @property
    def explained(self) -> FloatArray:
        """Share of the total variance in each mode, shape (K,)."""
        shares: FloatArray = self.variances / self.variances.sum()
        return shares

    def shape(self, deviations: FloatArray) -> FloatArray:
        """Return the shape at given multiples of the modes' standard deviations.

        Parameters
        ----------
        deviations : (..., k) array_like
            Multiples for the first k modes, k <= K; the other modes are at their mean.

        Returns
        -------
        (..., N, 3) array
            Positions [mm].
        """
        deviations = np.asarray(deviations, dtype=np.float64)
        return self.reconstruct(deviations * self.standard_deviations[: deviations.shape[-1]])

    def reconstruct(self, scores: FloatArray) -> FloatArray:
        """Return the shape of given scores.

        Parameters
        ----------
        scores : (..., k) array_like
            Coordinates in the first k modes [mm].

        Returns
        -------
        (..., N, 3) array
            Positions [mm].
        """
        scores = np.asarray(scores, dtype=np.float64)
        shape: FloatArray = self.mean + np.tensordot(scores, self.modes[: scores.shape[-1]], axes=1)
        return shape

    def project(self, particles: FloatArray) -> FloatArray:
        """Return the scores [mm] of aligned particles, shape (..., K) for particles (..., N, 3)."""
        scores: FloatArray = np.einsum("...ni,kni->...k", particles - self.mean, self.modes)
        return scores


def fit_shape_model(
    particles: FloatArray, *, scaling: bool = False, names: Sequence[str] | None = None
) -> ShapeModel:
    """Fit mean and modes to the corresponding particles of a cohort.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        World positions [mm], already aligned.
    scaling : bool
        Take size out: all shapes are brought to the mean size and aligned again (generalized Procrustes).
    names : sequence of str, optional
        Subject names, for messages.

    Raises
    ------
    InputError
        If there are fewer than two subjects or positions are not finite.
    """
    positions = checked_particles(particles, names)
    shapes = align(positions, scaling=True) if scaling else positions
    mean = shapes.mean(axis=0)
    scores, modes, variances = principal_components((shapes - mean).reshape(len(shapes), -1))
    return ShapeModel(mean, modes.reshape(-1, *mean.shape), variances, scores, sizes(positions))


def principal_components(
    centred: FloatArray, *, divisor: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return scores, orthonormal modes and variances of a centred data matrix.

    The smaller of the two Gram matrices is decomposed, so no matrix is larger than subjects x subjects.

    Parameters
    ----------
    centred : (M, P) array
        One row for each subject.
    divisor : int, optional
        Degrees of freedom of the variances; M - 1 by default.

    Returns
    -------
    scores : (M, K) array
    modes : (K, P) array
        Unit rows; the entry of largest magnitude of each is positive.
    variances : (K,) array
        In descending order; negligible ones are left out.
    """
    count, width = centred.shape
    dual = count <= width
    gram = centred @ centred.T if dual else centred.T @ centred
    squares, vectors = linalg.eigh(gram)
    kept = squares > NEGLIGIBLE * max(squares[-1], np.finfo(float).tiny)
    squares, vectors = squares[kept][::-1], vectors[:, kept][:, ::-1]
    modes = (vectors / np.sqrt(squares)).T @ centred if dual else vectors.T
    largest = np.take_along_axis(modes, np.abs(modes).argmax(axis=1, keepdims=True), axis=1)
    modes = modes * np.sign(largest)
    return centred @ modes.T, modes, squares / (count - 1 if divisor is None else divisor)
