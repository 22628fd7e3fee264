"""The shape model: principal components of corresponding particles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from scipy import linalg
from scipy.sparse.linalg import eigsh

from homolog.arrays import ArrayLike, FloatArray, frozen
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.statistics.checks import checked_particles, finite_numbers
from homolog.statistics.procrustes import align, rms_radii

__all__ = ["ShapeModel", "leading_scores", "principal_components"]

NEGLIGIBLE = 1e-9
"""Modes with less than this fraction of the first one's variance are rounding errors of the Gram matrix."""
_FEW = 8
"""Number of rows per requested mode above which a Gram matrix is decomposed by Lanczos' method."""

_GIVE = "give a file that ShapeModel.save wrote"


@dataclass(frozen=True, slots=True, eq=False)
class ShapeModel:
    """Mean shape and orthogonal modes of variation of a cohort: a point distribution model.

    Made by `ShapeModel.fit` or `ShapeModel.load`. Names are those of scikit-learn's `PCA` for equal
    quantities; lengths are root mean squares over the particles. All arrays are read-only.

    Attributes
    ----------
    mean : (N, 3) array
        Mean positions of the particles [mm].
    components : (K, N, 3) array
        Modes of variation, the largest first, K < M: orthogonal, and each moves the particles by a root mean
        square of 1.
    explained_variance : (K,) array
        Variance of the scores in each mode [mm²], with the divisor M - 1. The eigenvalue of the covariance
        matrix of the 3N coordinates is N times as large.
    scores : (M, K) array
        Coordinates of the M subjects in the modes [mm]: root mean square displacements of the particles, as
        in the window, tables and reports.
    sizes : (M,) array
        Root mean square distance of a subject's particles from their centroid [mm], before any scaling.

    References
    ----------
    T. F. Cootes et al., "Active shape models - their training and application", Computer Vision and Image
    Understanding 61 (1995) 38-59.

    Examples
    --------
    Three spheres of 64 particles, which differ in size only:

    >>> import numpy as np
    >>> import homolog as hl
    >>> directions = np.random.default_rng(0).normal(size=(64, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> model = hl.ShapeModel.fit([9.0 * directions, 10.0 * directions, 11.0 * directions])
    >>> model.explained_variance_ratio.round(6)
    array([1.])
    >>> larger = model.instance([2.0])  # two standard deviations along the first mode
    >>> abs(np.linalg.norm(larger, axis=1) - 10.0).round(6).max()
    np.float64(2.0)
    """

    mean: FloatArray
    components: FloatArray
    explained_variance: FloatArray
    scores: FloatArray
    sizes: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    def __repr__(self) -> str:
        """Return a one-line summary."""
        subjects, modes = self.scores.shape
        return f"ShapeModel({len(self.mean)} particles of {subjects} subjects, {modes} modes)"

    @classmethod
    def fit(
        cls, particles: ArrayLike, *, scaling: bool = False, names: Sequence[str] | None = None
    ) -> ShapeModel:
        """Fit mean and modes to the corresponding particles of a cohort.

        Parameters
        ----------
        particles : (M, N, 3) array_like
            World positions [mm], already aligned, such as `Correspondence.aligned`.
        scaling : bool
            Whether to remove size: all shapes are scaled to the mean size and aligned again (generalized
            Procrustes analysis). By default size is part of the model.
        names : sequence of str, optional
            Subject names, for messages.

        Returns
        -------
        ShapeModel
            With at most M - 1 modes.

        Raises
        ------
        InputError
            If there are fewer than two subjects, positions are not finite, or the numbers of names and
            subjects differ.
        """
        positions = checked_particles(particles, names)
        shapes = align(positions, scaling=True) if scaling else positions
        mean = shapes.mean(axis=0)
        scores, modes, variances = principal_components((shapes - mean).reshape(len(shapes), -1))
        length, modes = np.sqrt(len(mean)), modes.reshape(-1, *mean.shape)
        return cls(mean, length * modes, variances / len(mean), scores / length, rms_radii(positions))

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of the scores in each mode [mm], shape (K,)."""
        deviations: FloatArray = np.sqrt(self.explained_variance)
        return deviations

    @property
    def explained_variance_ratio(self) -> FloatArray:
        """Share of the total variance in each mode, shape (K,)."""
        shares: FloatArray = self.explained_variance / self.explained_variance.sum()
        return shares

    def transform(self, particles: ArrayLike) -> FloatArray:
        """Return the scores of aligned particles.

        Parameters
        ----------
        particles : (..., N, 3) array_like
            Positions in the frame of the mean [mm].

        Returns
        -------
        (..., K) array
            Coordinates in the modes [mm], as in `scores`.

        Raises
        ------
        InputError
            If the number of particles is not that of the model, or positions are not finite.
        """
        positions = finite_numbers(particles, "particles")
        if positions.shape[-2:] != self.mean.shape:
            raise InputError(
                f"particles need the model's shape (..., {len(self.mean)}, 3), not {positions.shape}"
            )
        apart = positions - self.mean
        scores: FloatArray = np.einsum("...ni,kni->...k", apart, self.components) / len(self.mean)
        return scores

    def inverse_transform(self, scores: ArrayLike) -> FloatArray:
        """Return the shape of given scores.

        Parameters
        ----------
        scores : (..., k) array_like
            Coordinates in the first k modes [mm], k <= K; the others are 0.

        Returns
        -------
        (..., N, 3) array
            Positions [mm].

        Raises
        ------
        InputError
            If there are more scores than modes, or they are not finite numbers.
        """
        known = self._of_modes(scores, "scores")
        shape: FloatArray = self.mean + np.tensordot(known, self.components[: known.shape[-1]], axes=1)
        return shape

    def instance(self, deviations: ArrayLike) -> FloatArray:
        """Return the shape at given multiples of the modes' standard deviations.

        Parameters
        ----------
        deviations : (..., k) array_like
            Multiples for the first k modes, k <= K; the other modes are at their mean.

        Returns
        -------
        (..., N, 3) array
            Positions [mm].

        Raises
        ------
        InputError
            If there are more multiples than modes, or they are not finite numbers.
        """
        multiples = self._of_modes(deviations, "deviations")
        return self.inverse_transform(multiples * self.standard_deviations[: multiples.shape[-1]])

    def _of_modes(self, values: ArrayLike, what: str) -> FloatArray:
        """Return numbers for the first modes as an array (..., k)."""
        numbers = finite_numbers(values, what)
        if numbers.ndim == 0 or numbers.shape[-1] > len(self.components):
            raise InputError(
                f"{what} need the shape (..., k) with k at most {len(self.components)}, the number of modes, "
                f"not {numbers.shape}"
            )
        return numbers

    def sample(self, count: int, seed: int | None = None) -> FloatArray:
        """Draw shapes whose scores are independent and normally distributed.

        Parameters
        ----------
        count : int
            Number of shapes, 0 or more.
        seed : int, optional
            Same seed, same shapes; by default, they differ in each call.

        Returns
        -------
        (count, N, 3) array
            Positions [mm].

        Raises
        ------
        InputError
            If the number of shapes is negative or not a whole number.
        """
        if not isinstance(count, int | np.integer) or count < 0:
            raise InputError(f"count={count!r}: must be a whole number, 0 or more")
        normal = np.random.default_rng(seed).standard_normal((count, len(self.explained_variance)))
        return self.instance(normal)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model to a NumPy archive.

        Parameters
        ----------
        path : path
            A file that ends in ``.npz``. An existing file is replaced only after everything is written.

        Raises
        ------
        InputError
            If the name has another suffix, or the file can't be written.
        """
        if Path(path).suffix != ".npz":
            raise InputError(f"{path}: a shape model is written as .npz; choose such a name")
        write_arrays(Path(path), {name: getattr(self, name) for name in self.__dataclass_fields__})

    @classmethod
    def load(cls, path: str | PathLike[str]) -> ShapeModel:
        """Read a model that `save` wrote, also in version 0.2.

        Parameters
        ----------
        path : path
            File that `save` wrote.

        Returns
        -------
        ShapeModel

        Raises
        ------
        InputError
            If the file is missing, damaged, or contains no shape model.
        """
        stored = read_arrays(Path(path), _GIVE)
        try:
            model = cls(**stored)
        except (TypeError, ValueError) as error:
            raise InputError(f"{path}: contains no shape model; {_GIVE}") from error
        modes, *shape = model.components.shape if model.components.ndim == 3 else (0,)
        if (
            shape != list(model.mean.shape)
            or model.explained_variance.shape != (modes,)
            or model.scores.shape != (*model.sizes.shape, modes)
        ):
            raise InputError(f"{path}: contains no shape model: its arrays are inconsistent; save it again")
        return model._in_root_mean_squares()

    def _in_root_mean_squares(self) -> ShapeModel:
        """Return the model with modes of a root mean square of 1; version 0.2 had modes of length 1."""
        count = len(self.mean)
        if not np.allclose(np.square(self.components).sum(axis=(1, 2)), 1.0):
            return self
        return replace(
            self,
            components=np.sqrt(count) * self.components,
            explained_variance=self.explained_variance / count,
            scores=self.scores / np.sqrt(count),
        )


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
        In descending order; negligible ones are omitted.
    """
    count, width = centred.shape
    dual = count <= width
    gram = centred @ centred.T if dual else centred.T @ centred
    squares, vectors = linalg.eigh(gram, overwrite_a=True)
    kept = squares > NEGLIGIBLE * max(squares[-1], np.finfo(float).tiny)
    squares, vectors = squares[kept][::-1], vectors[:, kept][:, ::-1]
    modes = (vectors / np.sqrt(squares)).T @ centred if dual else vectors.T
    largest = np.take_along_axis(modes, np.abs(modes).argmax(axis=1, keepdims=True), axis=1)
    modes = modes * np.sign(largest)
    return centred @ modes.T, modes, squares / (count - 1 if divisor is None else divisor)


def leading_scores(rows: FloatArray, modes: int) -> tuple[FloatArray, FloatArray]:
    """Return the scores in the first modes only; fast also for many subjects.

    Parameters
    ----------
    rows : (M, P) array
        One row for each subject; the function does not centre them.
    modes : int
        Largest number of modes.

    Returns
    -------
    scores : (M, K) array
        Orthogonal columns, the longest first; signs are arbitrary.
    squares : (K,) array
        Their squared lengths.
    """
    count, width = rows.shape
    dual = count <= width
    gram = rows @ rows.T if dual else rows.T @ rows
    modes = min(modes, len(gram))
    if len(gram) > _FEW * modes:
        start = np.random.default_rng(0).standard_normal(len(gram))
        squares, vectors = eigsh(gram, modes, which="LA", v0=start)
        order = np.argsort(squares)[::-1]
    else:
        squares, vectors = linalg.eigh(gram, overwrite_a=True)
        order = np.arange(len(gram))[::-1][:modes]
    squares, vectors = np.clip(squares[order], 0.0, None), vectors[:, order]
    return (vectors * np.sqrt(squares) if dual else rows @ vectors), squares
