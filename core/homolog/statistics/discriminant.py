"""The linear discriminant of two groups: a direction of shape space, and its cross-validated accuracy."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.effects import Effect
from homolog.statistics.held_out import accuracy_bounds, auc_bounds, held_out_by_moments, stratified_folds
from homolog.statistics.randomization import p_values
from homolog.statistics.shape_model import leading_scores, principal_components
from homolog.threads import on_one_thread

__all__ = ["Discriminant", "discriminant", "shrunk_covariance"]

MANY = 300
"""Number of subjects from which on cross-validation uses the leading modes of all and `_FURTHER` more."""
_FURTHER = 24
_CHUNK_VALUES = 1_000_000
_FLAT = 1e-9
"""Modes with less than this fraction of the first one's variance are rounding errors."""
_MOST_FOLDS = 10
_REPEATS_OF_P, _FURTHER_OF_P = 2, 8
"""Repeats of the cross-validation for observed and permuted labels; number of further modes used there."""


@dataclass(frozen=True, slots=True, eq=False)
class Discriminant:
    """Discriminant direction from the first group to the second. Arrays are read-only.

    Attributes
    ----------
    modes : (k, N, 3) array
        Unit modes in which the direction is expressed.
    weights : (k,) array
        The difference of the group means along the unit discriminant direction, in the
        modes [mm].
    bootstrap : (B, k) array
        Weights of cohorts drawn with replacement within each group.
    second : (M,) bool array
        Members of the second group.
    scores : (M,) array
        Each subject's position along the direction [mm], as root mean square over the particles; zero is
        midway between the groups' means.
    shrinkage : float
        Weight of the identity in the shrunk covariance (Ledoit and Wolf 2004), in [0, 1].
    accuracy : Effect
        Cross-validated balanced accuracy: mean of the shares of both groups that are classified correctly.
        Its interval combines those of the two shares (Wilson 1927, combined as by Newcombe 1998).
    auc : Effect
        Cross-validated area under the receiver operating characteristic. Its interval is that of
        method 5 of Newcombe (2006) for the mean over the repeats and the numbers of both groups.
    held_out : (M,) array
        Cross-validated score of each subject, mean over the repeats, relative to the distance of the groups.
    right : (float, float)
        Correctly classified subjects of the first and of the second group, mean over the repeats.
    folds, repeats : int
        Of the cross-validation. Modes and direction are fitted without the held-out subjects.
    """

    modes: FloatArray
    weights: FloatArray
    bootstrap: FloatArray
    second: BoolArray
    scores: FloatArray
    shrinkage: float
    accuracy: Effect
    auc: Effect
    held_out: FloatArray
    right: tuple[float, float]
    folds: int
    repeats: int

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("modes", "weights", "bootstrap", "scores", "held_out"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        object.__setattr__(self, "second", frozen(self.second))

    @property
    def displacement(self) -> FloatArray:
        """The difference of the groups along the discriminant, at each particle [mm], shape (N, 3)."""
        displacement: FloatArray = np.tensordot(self.weights, self.modes, axes=1)
        return displacement

    @property
    def cross_validated(self) -> FloatArray:
        """The cross-validated position of each subject [mm], as root mean square over the particles, (M,)."""
        apart = float(np.linalg.norm(self.weights)) / np.sqrt(self.modes.shape[1])
        positions: FloatArray = self.held_out * apart
        return positions

    def bounds(self, mode_maps: FloatArray, percent: float = 95.0) -> FloatArray:
        """Return bootstrap bounds of a map on the surface, shape (2, V).

        Parameters
        ----------
        mode_maps : (k, V) array
            The map of each unit mode, such as its signed normal displacement at the vertices.
        percent : float
            Percentage of the bootstrap samples between the bounds.

        Returns
        -------
        (2, V) array
            Lower and upper bound.
        """
        tail = (100.0 - percent) / 2.0
        limits: FloatArray = np.percentile(self.bootstrap @ mode_maps, [tail, 100.0 - tail], axis=0)
        return limits


@on_one_thread
def discriminant(
    particles: FloatArray,
    second: BoolArray,
    modes: int,
    *,
    covariates: FloatArray | None = None,
    repeats: int = 20,
    bootstraps: int = 1000,
    permutations: int = 1999,
    seed: int = 0,
    tick: Tick = no_tick,
) -> Discriminant:
    """Fit, cross-validate and bootstrap the discriminant between two groups.

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions [mm].
    second : (M,) bool array
        Members of the second group; the others are the first.
    modes : int
        Number of leading modes, at least 1.
    covariates : (M, c) array, optional
        Columns to regress out; every fold of the cross-validation uses only its training subjects for this.
    repeats : int
        Repeats of the stratified cross-validation with different folds.
    bootstraps : int
        Number of bootstrap samples for the bounds.
    permutations : int
        Permutations for the p-values of accuracy and AUC; 0 omits them. With covariates, rows of
        labels and covariates are exchanged together.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    Discriminant

    Raises
    ------
    InputError
        If there is no mode, or a group has fewer than two subjects.
    """
    smallest = min(int(np.count_nonzero(second)), int(np.count_nonzero(~second)))
    if modes < 1 or smallest < 2:
        raise InputError("a discriminant needs at least one mode and two subjects in each group")
    extra = np.zeros((len(second), 0)) if covariates is None else covariates
    rows = particles.reshape(len(particles), -1)
    rows = rows - rows.mean(axis=0)
    rows = _without_covariates(rows, second, extra, np.ones(len(rows)))
    rows = rows - rows.mean(axis=0)
    scores, basis = _leading(rows, modes)
    fit = _fit(scores, second, np.ones(len(second)))
    generator = np.random.default_rng(seed)
    drawn = _bootstrapped(scores, second, bootstraps, generator, part_of(tick, 0.0, 0.5))
    folds = min(_MOST_FOLDS, smallest)
    # With many subjects, the leading modes of a training set are nearly in the span of those of all.
    reduced, _ = leading_scores(rows, len(rows) if len(rows) <= MANY else modes + _FURTHER)
    tick(0.5, "cross-validation of the discriminant")
    fold_of = np.stack([stratified_folds(second, folds, generator) for _ in range(repeats)])
    own = second[None], extra[None]
    rounds = np.concatenate([_held_out(reduced, *own, each[None], modes) for each in fold_of])
    accuracy, auc = (float(item) for item in _rates(rounds, np.tile(second, (repeats, 1))).mean(axis=0))
    # A permutation test is valid for any statistic, so that leading modes suffice here.
    tick_of_p = part_of(tick, 0.6, 1.0)
    leading = reduced[:, : modes + _FURTHER_OF_P]
    rates = _permuted_rates(leading, second, extra, modes, folds, permutations, generator, tick_of_p)
    p = [
        float(p_values(item, column)) if permutations else None
        for item, column in zip(rates[0], rates[1:].T, strict=True)
    ]
    held_out = np.mean(rounds, axis=0)
    correct = np.mean((rounds > 0.0) == second, axis=0)
    return Discriminant(
        modes=basis.reshape(-1, *particles.shape[1:]),
        weights=fit.direction * fit.separation,
        bootstrap=drawn,
        second=second,
        scores=(scores @ fit.direction - fit.midpoint) / np.sqrt(particles.shape[1]),
        shrinkage=float(fit.shrinkage),
        accuracy=Effect(accuracy, *accuracy_bounds(correct, second, accuracy), p[0], permutations),
        auc=Effect(auc, *auc_bounds(auc, second), p[1], permutations),
        held_out=held_out,
        right=(float(correct[~second].sum()), float(correct[second].sum())),
        folds=folds,
        repeats=repeats,
    )


def shrunk_covariance(
    centred: FloatArray, weights: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return covariances shrunk towards a multiple of the identity, and the weights (Ledoit and Wolf 2004).

    Parameters
    ----------
    centred : (..., M, k) array
        Rows with mean zero. Columns of zeros stay zeros.
    weights : (..., M) array, optional
        Multiplicity of each row; 1 by default.

    Returns
    -------
    (..., k, k) array
        The covariances.
    (...) array
        Weight of the identity in each.
    """
    often = np.ones(centred.shape[:-1]) if weights is None else weights
    count = often.sum(axis=-1)[..., None, None]
    covariance = np.swapaxes(centred * often[..., None], -1, -2) @ centred / count
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    varying = variances > 0.0
    width = np.maximum(varying.sum(axis=-1), 1)
    sphere = (variances.sum(axis=-1) / width)[..., None, None] * (
        varying[..., None] * np.eye(centred.shape[-1])
    )
    distance = np.square(covariance - sphere).sum(axis=(-2, -1))
    fourth = (often * np.square(np.square(centred).sum(axis=-1))).sum(axis=-1)
    spread = fourth / count[..., 0, 0] - np.square(covariance).sum(axis=(-2, -1))
    ratio = spread / count[..., 0, 0] / np.where(distance > 0.0, distance, 1.0)
    shrinkage = np.where(distance > 0.0, np.clip(ratio, 0.0, 1.0), 1.0)
    part = shrinkage[..., None, None]
    return part * sphere + (1.0 - part) * covariance, shrinkage


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """Unit directions (..., k), distances of the means along them, midpoints and shrinkages (...)."""

    direction: FloatArray
    separation: FloatArray
    midpoint: FloatArray
    shrinkage: FloatArray


def _fit(scores: FloatArray, second: BoolArray, weights: FloatArray) -> _Fit:
    """Fit discriminants to scores (..., M, k) with labels and multiplicities (..., M) of the subjects."""
    means = []
    for own in (~second, second):
        part = weights * own
        means.append((part[..., None, :] @ scores)[..., 0, :] / part.sum(axis=-1)[..., None])
    first_mean, second_mean = means
    group = np.where(second[..., None], second_mean[..., None, :], first_mean[..., None, :])
    covariance, shrinkage = shrunk_covariance(scores - group, weights)
    difference = second_mean - first_mean
    direction = (np.linalg.pinv(covariance, hermitian=True) @ difference[..., None])[..., 0]
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    direction = direction / np.maximum(length, np.finfo(float).tiny)
    midpoint = ((first_mean + second_mean) * direction).sum(axis=-1) / 2.0
    return _Fit(direction, (difference * direction).sum(axis=-1), midpoint, shrinkage)


def _bootstrapped(
    scores: FloatArray, second: BoolArray, count: int, generator: np.random.Generator, tick: Tick
) -> FloatArray:
    """Return the weights (B, k) of cohorts drawn with replacement within each group."""
    drawn = np.empty((count, scores.shape[1]))
    chunk = max(1, _CHUNK_VALUES // scores.size)
    groups = np.flatnonzero(~second), np.flatnonzero(second)
    for start in range(0, count, chunk):
        tick(start / count, "bootstrap of the discriminant")
        size = min(chunk, count - start)
        again = _fit(scores, second, np.stack([_resampled(groups, generator) for _ in range(size)]))
        drawn[start : start + size] = again.direction * again.separation[:, None]
    return drawn


def _resampled(groups: Sequence[IntArray], generator: np.random.Generator) -> FloatArray:
    """Draw subjects with replacement, at least two different ones per group; return multiplicities (M,)."""
    often = np.zeros(sum(map(len, groups)))
    for members in groups:
        drawn = generator.integers(len(members), size=len(members))
        while (drawn == drawn[0]).all():
            drawn = generator.integers(len(members), size=len(members))
        often[members] = np.bincount(drawn, minlength=len(members))
    return often


def _leading(rows: FloatArray, modes: int) -> tuple[FloatArray, FloatArray]:
    """Return scores (M, k) and unit modes (k, P) of centred rows, with the signs of a shape model."""
    if len(rows) <= MANY:
        scores, basis, _ = principal_components(rows)
        return scores[:, :modes], basis[:modes]
    scores, squares = leading_scores(rows, modes)
    basis = (scores / np.sqrt(np.where(squares > 0.0, squares, 1.0))).T @ rows
    basis /= np.maximum(np.linalg.norm(basis, axis=1, keepdims=True), np.finfo(float).tiny)
    signs = np.sign(np.take_along_axis(basis, np.abs(basis).argmax(axis=1, keepdims=True), axis=1))
    return scores * signs[:, 0], basis * signs


def _without_covariates(
    rows: FloatArray, second: BoolArray, covariates: FloatArray, trains: FloatArray
) -> FloatArray:
    """Regress covariates (..., M, c), fitted to the training subjects (..., M), out of rows (..., M, P)."""
    if not covariates.shape[-1]:
        return rows
    others = np.stack([np.ones(second.shape), second], axis=-1)
    columns = np.concatenate([covariates, others], axis=-1)
    # The pseudoinverse of zero rows is zero: held-out subjects have no effect.
    effect = np.linalg.pinv(columns * trains[..., None])[..., : covariates.shape[-1], :]
    rest: FloatArray = rows - covariates @ (effect @ rows)
    return rest


def _permuted_rates(
    rows: FloatArray,
    second: BoolArray,
    covariates: FloatArray,
    modes: int,
    folds: int,
    permutations: int,
    generator: np.random.Generator,
    tick: Tick,
) -> FloatArray:
    """Return balanced accuracy and area under the curve (1 + B, 2) for observed, then permuted labels."""
    count = len(second)
    # With many subjects it hardly matters. It must not depend on the labels.
    shrinkage = float(shrunk_covariance(rows - rows.mean(axis=0))[1])
    rates = np.empty((1 + permutations, 2))
    chunk = max(1, _CHUNK_VALUES // (_REPEATS_OF_P * folds * rows.size))
    for start in range(0, len(rates), chunk):
        tick(start / len(rates), "permutations of the discriminant")
        stop = min(start + chunk, len(rates))
        orders, fold_of = [], []
        for entry in range(start, stop):
            order = generator.permutation(count) if entry else np.arange(count)
            orders += [order] * _REPEATS_OF_P
            fold_of += [stratified_folds(second[order], folds, generator) for _ in range(_REPEATS_OF_P)]
        labels = second[orders]
        given = labels, covariates[orders], np.stack(fold_of)
        if count > MANY:
            rounds = zip(*given, strict=True)
            held_out = np.stack([held_out_by_moments(rows, *each, modes, shrinkage) for each in rounds])
        else:
            held_out = _held_out(rows, *given, modes)
        rates[start:stop] = _rates(held_out, labels).reshape(-1, _REPEATS_OF_P, 2).mean(axis=1)
    return rates


def _held_out(
    rows: FloatArray, second: BoolArray, covariates: FloatArray, fold_of: IntArray, modes: int
) -> FloatArray:
    """Return each subject's score when it is held out, in distances of the groups.

    Parameters
    ----------
    rows : (M, k) array
    second : (R, M) bool array
        Labels in each of R cross-validations; group sizes are equal in all.
    covariates : (R, M, c) array
    fold_of : (R, M) int array
        The fold in which a subject is held out.
    modes : int

    Returns
    -------
    (R, M) array
    """
    folds = int(fold_of.max()) + 1
    trains = (fold_of[:, None, :] != np.arange(folds)[:, None]).astype(np.float64)
    shared = rows[None, None]
    if covariates.shape[2]:
        shared = _without_covariates(rows, second[:, None], covariates[:, None], trains)
    mean = trains[:, :, None, :] @ shared / trains.sum(axis=2)[..., None, None]
    centred = shared - mean
    squares, vectors = np.linalg.eigh(np.swapaxes(centred * trains[..., None], 2, 3) @ centred)
    squares, axes = squares[..., ::-1][..., :modes], vectors[..., ::-1][..., :modes]
    scores = centred @ (axes * (squares > _FLAT * squares[..., :1])[..., None, :])
    fit = _fit(scores, second[:, None], trains)
    along = (scores @ fit.direction[..., None])[..., 0] - fit.midpoint[..., None]
    held_out = np.take_along_axis(along, fold_of[:, None, :], axis=1)[:, 0]
    of_fold = np.where(fit.separation == 0.0, 1.0, fit.separation)
    return np.asarray(held_out / np.take_along_axis(of_fold, fold_of, axis=1), np.float64)


def _rates(held_out: FloatArray, second: BoolArray) -> FloatArray:
    """Return balanced accuracy and area under the curve (R, 2) of cross-validated scores (R, M).

    Group sizes are equal in all rows. The area follows from the ranks (Mann and Whitney 1947).
    """
    high, low = (held_out[labels].reshape(len(held_out), -1) for labels in (second, ~second))
    accuracy = ((high > 0.0).mean(axis=1) + (low <= 0.0).mean(axis=1)) / 2.0
    count = high.shape[1]
    ranks = rankdata(np.concatenate([high, low], axis=1), axis=1)[:, :count].sum(axis=1)
    return np.column_stack([accuracy, (ranks - count * (count + 1) / 2.0) / (count * low.shape[1])])
