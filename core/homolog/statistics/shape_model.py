"""The shape model: principal components of corresponding particles."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any, Self

import numpy as np
from scipy import linalg
from scipy.sparse.linalg import eigsh

from homolog.arrays import ArrayLike, FloatArray, data_frame, frozen, html_of
from homolog.errors import InputError, path_of
from homolog.io.arrays import read_arrays, write_arrays
from homolog.statistics.checks import checked_particles, finite_numbers
from homolog.statistics.procrustes import align, rms_radii, superimposed

__all__ = ["ShapeModel", "leading_scores", "principal_components"]

NEGLIGIBLE = 1e-9
"""Modes with less than this fraction of the first one's variance are rounding errors of the Gram matrix."""
_FEW = 8
"""Number of rows per requested mode above which a Gram matrix is decomposed by Lanczos' method."""

_GIVE = "give a file that ShapeModel.save wrote"
_STORED = ("mean", "components", "explained_variance", "scores", "explained_variance_ratio", "size")


class ShapeModel:
    """Mean shape and orthogonal modes of variation of a cohort: a point distribution model.

    A transformer as in scikit-learn, for pipelines and cross-validation: `fit` takes particles (M, N, 3) or
    their flattened coordinates (M, 3N), and results have the shape of what was given. Names are those of
    scikit-learn's `PCA` for equal quantities; lengths are root mean squares over the particles. All arrays
    are read-only.

    It passes scikit-learn's `check_estimator` but for one thing: also values of a wrong type are an
    `InputError`, a `ValueError`, instead of a `TypeError`.

    Parameters
    ----------
    n_components : int or float, optional
        Number of modes. Below 1: the share of the variance that the modes explain at least. By default all.
    scaling : bool
        Whether to remove size: all shapes are scaled to the mean size and aligned again (generalized
        Procrustes analysis), also those of `transform`. By default size is part of the model.
    random_state : int or numpy.random.Generator, optional
        Seed of `sample`; by default, it draws other shapes in each call.

    Attributes
    ----------
    mean_ : (N, 3) array
        Mean positions of the particles [mm].
    components_ : (K, N, 3) array
        Modes of variation, the largest first, K < M: orthogonal, and each moves the particles by a root mean
        square of 1.
    explained_variance_ : (K,) array
        Variance of the scores in each mode [mm²], with the divisor M - 1. The eigenvalue of the covariance
        matrix of the 3N coordinates is N times as large.
    explained_variance_ratio_ : (K,) array
        Share of the total variance in each mode.
    scores_ : (M, K) array
        Coordinates of the M subjects in the modes [mm]: root mean square displacements of the particles, as
        in the window, tables and reports.
    n_components_ : int
        K.
    size_ : float
        With `scaling`: root mean square distance of the particles from their centroid, of all shapes [mm].

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
    >>> model = hl.ShapeModel().fit([9.0 * directions, 10.0 * directions, 11.0 * directions])
    >>> model.explained_variance_ratio_.round(6)
    array([1.])
    >>> larger = model.instance([2.0])  # two standard deviations along the first mode
    >>> abs(np.linalg.norm(larger, axis=1) - 10.0).round(6).max()
    np.float64(2.0)
    """

    mean_: FloatArray
    components_: FloatArray
    explained_variance_: FloatArray
    explained_variance_ratio_: FloatArray
    scores_: FloatArray
    n_components_: int
    n_features_in_: int
    size_: float

    def __init__(
        self,
        n_components: float | None = None,
        *,
        scaling: bool = False,
        random_state: int | np.random.Generator | None = None,
    ) -> None:
        self.n_components = n_components
        self.scaling = scaling
        self.random_state = random_state

    @classmethod
    def from_arrays(
        cls,
        mean: ArrayLike,
        components: ArrayLike,
        explained_variance: ArrayLike,
        scores: ArrayLike,
        explained_variance_ratio: ArrayLike | None = None,
        size: float | None = None,
    ) -> Self:
        """Return the model of known mean and modes.

        Parameters
        ----------
        mean, components, explained_variance, scores, explained_variance_ratio : array_like
            As the attributes with an underscore; the shares of the variance are those of all modes by
            default.
        size : float, optional
            For a model with `scaling`, the size of its shapes [mm].

        Returns
        -------
        ShapeModel

        Raises
        ------
        InputError
            If the arrays are of different models.
        """
        model = cls(scaling=size is not None)
        if size is not None:
            model.size_ = float(size)
        given = (mean, components, explained_variance, scores)
        for name, values in zip(_STORED, given, strict=False):
            setattr(model, f"{name}_", frozen(finite_numbers(values, name)))
        variances = model.explained_variance_
        shares = variances / variances.sum() if explained_variance_ratio is None else explained_variance_ratio
        model.explained_variance_ratio_ = frozen(finite_numbers(shares, "explained_variance_ratio"))
        modes = variances.shape
        if (
            model.components_.shape != (*modes, *model.mean_.shape)
            or model.scores_.shape[1:] != modes
            or model.explained_variance_ratio_.shape != modes
        ):
            raise InputError("the arrays are not of one model: their shapes differ")
        model.n_components_, model.n_features_in_ = len(model.components_), model.mean_.size
        return model

    def __repr__(self) -> str:
        """Return a one-line summary."""
        if not self.__sklearn_is_fitted__():
            given = {name: value for name, value in self.get_params().items() if value not in (None, False)}
            return f"ShapeModel({', '.join(f'{name}={value!r}' for name, value in given.items())})"
        return (
            f"ShapeModel({self.n_features_in_ // 3} particles of {len(self.scores_)} subjects, "
            f"{self.n_components_} modes)"
        )

    def fit(self, particles: ArrayLike, y: object = None, *, names: Sequence[str] | None = None) -> Self:
        """Fit mean and modes to the corresponding particles of a cohort.

        Parameters
        ----------
        particles : (M, N, 3) or (M, 3N) array_like
            World positions [mm], already aligned, such as `Correspondence.aligned`.
        y : object
            Ignored.
        names : sequence of str, optional
            Subject names, for messages.

        Returns
        -------
        ShapeModel
            The model itself, with at most M - 1 modes.

        Raises
        ------
        InputError
            If there are fewer than two subjects, positions are not finite, the numbers of names and subjects
            differ, or a parameter is invalid.
        """
        shapes = _rows(particles, names)
        if self.scaling:
            points = align(_points(shapes), scaling=True)
            shapes, self.size_ = points.reshape(shapes.shape), float(rms_radii(points).mean())
        mean = shapes.mean(axis=0)
        scores, modes, variances = principal_components((shapes - mean).reshape(len(shapes), -1))
        shares = variances / variances.sum()
        kept, count = self._kept(shares), mean.size / 3
        fitted = self.from_arrays(
            mean,
            np.sqrt(count) * modes[:kept].reshape(-1, *mean.shape),
            variances[:kept] / count,
            scores[:, :kept] / np.sqrt(count),
            shares[:kept],
        )
        vars(self).update({name: value for name, value in vars(fitted).items() if name.endswith("_")})
        return self

    def _kept(self, shares: FloatArray) -> int:
        """Return the number of modes that `n_components` asks for."""
        chosen = self.n_components
        if chosen is None:
            return len(shares)
        if isinstance(chosen, int | np.integer) and chosen >= 1:
            return min(int(chosen), len(shares))
        if isinstance(chosen, float) and 0.0 < chosen < 1.0:
            return min(int(np.searchsorted(np.cumsum(shares), chosen)) + 1, len(shares))
        raise InputError(
            f"n_components={chosen!r}: give a number of modes, or a share of the variance below 1"
        )

    @property
    def standard_deviations_(self) -> FloatArray:
        """Standard deviation of the scores in each mode [mm], shape (K,)."""
        deviations: FloatArray = np.sqrt(self.explained_variance_)
        return deviations

    def fit_transform(self, particles: ArrayLike, y: object = None) -> FloatArray:
        """Fit the model, and return the scores of its own subjects: see `fit` and `transform`.

        Parameters
        ----------
        particles : (M, N, 3) or (M, 3N) array_like
            World positions [mm].
        y : object
            Ignored.

        Returns
        -------
        (M, K) array
            Scores [mm].
        """
        return self.fit(particles, y).scores_

    def transform(self, particles: ArrayLike) -> FloatArray:
        """Return the scores of aligned particles.

        Parameters
        ----------
        particles : (..., N, 3) or (..., 3N) array_like
            Positions in the frame of the mean [mm].

        Returns
        -------
        (..., K) array
            Coordinates in the modes [mm], as in `scores_`.

        Raises
        ------
        InputError
            If the number of particles is not that of the model, or positions are not finite.
        """
        apart = self._placed(particles) - self.mean_
        flat = apart.reshape(*apart.shape[: apart.ndim - self.mean_.ndim], self.n_features_in_)
        scores: FloatArray = flat @ self.components_.reshape(self.n_components_, -1).T
        return scores / (self.n_features_in_ / 3)

    def _placed(self, particles: ArrayLike) -> FloatArray:
        """Return positions as the model has them: with `scaling`, at its size and aligned to its mean."""
        self._check_is_fitted()
        positions, shape = _numbers(particles), self.mean_.shape
        if len(shape) == 1 and positions.ndim < 2:
            raise InputError(f"Reshape your data to (M, {shape[0]}): a row for each flattened shape")
        if len(shape) == 1 and positions.shape[-1:] != shape:
            raise InputError(
                f"X has {positions.shape[-1]} features, but ShapeModel is expecting {shape[0]} features as "
                "input"
            )
        if positions.shape[-len(shape) :] != shape:
            raise InputError(f"particles need the model's shape (..., {shape[0]}, 3), not {positions.shape}")
        if not self.scaling:
            return positions
        points, mean = _points(positions), self.mean_.reshape(-1, 3)
        return superimposed(points, mean, self.size_).reshape(positions.shape)

    def inverse_transform(self, scores: ArrayLike) -> FloatArray:
        """Return the shape of given scores.

        Parameters
        ----------
        scores : (..., k) array_like
            Coordinates in the first k modes [mm], k <= K; the others are 0.

        Returns
        -------
        (..., N, 3) or (..., 3N) array
            Positions [mm].

        Raises
        ------
        InputError
            If there are more scores than modes, or they are not finite numbers.
        """
        known = self._of_modes(scores, "scores")
        shape: FloatArray = self.mean_ + np.tensordot(known, self.components_[: known.shape[-1]], axes=1)
        return shape

    def score(self, particles: ArrayLike, y: object = None) -> float:
        """Return minus the root mean square distance of particles from those that the modes rebuild [mm].

        In cross-validation this is the generalization of the model, and its best number of modes the one with
        the largest score.

        Parameters
        ----------
        particles : (M, N, 3) or (M, 3N) array_like
            Aligned positions [mm].
        y : object
            Ignored.

        Returns
        -------
        float
            At most 0.
        """
        rest = self._placed(particles) - self.inverse_transform(self.transform(particles))
        return -float(np.sqrt(3.0 * np.square(rest).mean()))

    def instance(self, deviations: ArrayLike) -> FloatArray:
        """Return the shape at given multiples of the modes' standard deviations.

        Parameters
        ----------
        deviations : (..., k) array_like
            Multiples for the first k modes, k <= K; the other modes are at their mean.

        Returns
        -------
        (..., N, 3) or (..., 3N) array
            Positions [mm].

        Raises
        ------
        InputError
            If there are more multiples than modes, or they are not finite numbers.
        """
        multiples = self._of_modes(deviations, "deviations")
        return self.inverse_transform(multiples * self.standard_deviations_[: multiples.shape[-1]])

    def _of_modes(self, values: ArrayLike, what: str) -> FloatArray:
        """Return numbers for the first modes as an array (..., k)."""
        self._check_is_fitted()
        numbers = finite_numbers(values, what)
        if numbers.ndim == 0 or numbers.shape[-1] > self.n_components_:
            raise InputError(
                f"{what} need the shape (..., k) with k at most {self.n_components_}, the number of modes, "
                f"not {numbers.shape}"
            )
        return numbers

    def sample(self, count: int = 1, random_state: int | np.random.Generator | None = None) -> FloatArray:
        """Draw shapes whose scores are independent and normally distributed.

        Parameters
        ----------
        count : int
            Number of shapes, 0 or more.
        random_state : int or numpy.random.Generator, optional
            Same number, same shapes; by default that of the model.

        Returns
        -------
        (count, N, 3) or (count, 3N) array
            Positions [mm].

        Raises
        ------
        InputError
            If the number of shapes is negative or not a whole number.
        """
        self._check_is_fitted()
        if not isinstance(count, int | np.integer) or count < 0:
            raise InputError(f"count={count!r}: must be a whole number, 0 or more")
        seed = self.random_state if random_state is None else random_state
        try:
            generator = np.random.default_rng(seed)
        except (TypeError, ValueError) as error:
            raise InputError(f"random_state={seed!r}: must be a whole number, 0 or more") from error
        return self.instance(generator.standard_normal((count, self.n_components_)))

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
        self._check_is_fitted()
        if path_of(path).suffix != ".npz":
            raise InputError(f"{path}: a shape model is written as .npz; choose such a name")
        kept = _STORED if self.scaling else _STORED[:-1]
        write_arrays(path_of(path), {name: getattr(self, f"{name}_") for name in kept})

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a model that `save` wrote, also in versions 0.2 and 0.3.

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
        stored = read_arrays(path_of(path), _GIVE)
        try:
            arrays: dict[str, Any] = {name: stored[name] for name in _STORED if name in stored}
            model = cls.from_arrays(**arrays)
        except (TypeError, ValueError) as error:
            raise InputError(f"{path}: contains no shape model ({error}); {_GIVE}") from error
        if not np.allclose(np.square(model.components_).sum(axis=(1, 2)), 1.0):
            return model
        count = len(model.mean_)  # version 0.2 had modes of length 1 in place of a root mean square of 1
        return cls.from_arrays(
            model.mean_,
            np.sqrt(count) * model.components_,
            model.explained_variance_ / count,
            model.scores_ / np.sqrt(count),
        )

    def to_dataframe(self) -> Any:  # noqa: ANN401 - pandas is imported when it is needed
        """Return a `pandas.DataFrame` with a row for each mode: standard deviation [mm], variance, shares."""
        shares = self.explained_variance_ratio_
        columns = {
            "standard_deviation": self.standard_deviations_,
            "explained_variance": self.explained_variance_,
            "explained_variance_ratio": shares,
            "cumulative": np.cumsum(shares),
        }
        return data_frame(columns, range(1, len(shares) + 1), "mode")

    def _repr_html_(self) -> str:
        """Return the summary that notebooks show."""
        return (
            html_of(repr(self), self.to_dataframe()) if self.__sklearn_is_fitted__() else f"<p>{self!r}</p>"
        )

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters by name, as scikit-learn does; `deep` is ignored."""
        return {
            "n_components": self.n_components,
            "scaling": self.scaling,
            "random_state": self.random_state,
        }

    def set_params(self, **parameters: Any) -> Self:  # noqa: ANN401 - checked by `fit`, as in scikit-learn
        """Set parameters by name, as scikit-learn does, and return the model; InputError for other names."""
        known = self.get_params()
        if other := sorted(parameters.keys() - known.keys()):
            raise InputError(f"ShapeModel has no parameter {other[0]!r}; choose from {', '.join(known)}")
        vars(self).update(parameters)
        return self

    def __sklearn_is_fitted__(self) -> bool:
        """Return whether the model has been fitted."""
        return hasattr(self, "mean_")

    def __sklearn_tags__(self) -> Any:  # noqa: ANN401 - scikit-learn need not be installed
        """Return what scikit-learn asks of its estimators."""
        from sklearn.utils import InputTags, Tags, TargetTags, TransformerTags

        return Tags(
            estimator_type=None,
            target_tags=TargetTags(required=False),
            transformer_tags=TransformerTags(),
            input_tags=InputTags(three_d_array=True),
        )

    def _check_is_fitted(self) -> None:
        if not self.__sklearn_is_fitted__():
            raise InputError("this ShapeModel is not fitted yet; call fit, load or from_arrays first")


def _numbers(particles: ArrayLike) -> FloatArray:
    """Return positions as float64; raise InputError if they are no finite real numbers."""
    if hasattr(particles, "toarray"):
        raise InputError("particles: sparse arrays are not supported; give an array of all positions")
    return finite_numbers(particles, "particles")


def _rows(particles: ArrayLike, names: Sequence[str] | None) -> FloatArray:
    """Return the positions of two or more subjects, (M, N, 3) or flattened (M, P)."""
    if getattr(particles, "ndim", 0) == 3 or names is not None:
        return checked_particles(particles, names)
    positions = _numbers(particles)
    if positions.ndim != 2:
        return checked_particles(positions)
    if 0 in positions.shape:
        raise InputError(
            f"particles: {positions.shape[1]} feature(s) (shape={positions.shape}) while a minimum of 1 is "
            "required."
        )
    if len(positions) < 2:
        raise InputError("n_samples=1: statistics need at least two subjects; add subjects")
    return positions


def _points(positions: FloatArray) -> FloatArray:
    """Return positions, also flattened ones, as (..., N, 3)."""
    if positions.ndim > 2:
        return positions
    if positions.shape[1] % 3:
        raise InputError(
            f"scaling: flattened particles have 3 coordinates each, not {positions.shape[1]} in all"
        )
    return positions.reshape(len(positions), -1, 3)


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
