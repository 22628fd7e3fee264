"""The linear discriminant between two groups: a direction of shape space, and how well it separates them."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.analysis.shape_model import principal_components
from homolog.analysis.threads import on_one_thread
from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of

__all__ = ["Discriminant", "discriminant", "shrunk_covariance"]

_MOST_FOLDS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Discriminant:
    """Discriminant direction from the first group to the second. Arrays are read-only.

    Attributes
    ----------
    modes : (k, N, 3) array
        Unit modes that the direction lies in.
    weights : (k,) array
        The way from the first group's mean to the second's along the unit discriminant direction, in the
        modes [mm].
    bootstrap : (B, k) array
        The same of cohorts drawn with replacement within each group.
    scores : (M,) array
        Each subject's place along the direction [mm]; zero is midway between the groups' means.
    shrinkage : float
        Weight of the sphere in the covariance (Ledoit and Wolf 2004), in [0, 1].
    accuracy : float
        Cross-validated: mean of the shares of the two groups that fall on their own side.
    auc : float
        Cross-validated area under the receiver operating characteristic.
    folds, repeats : int
        Of the cross-validation; modes and direction are fitted without the left-out subjects.
    """

    modes: FloatArray
    weights: FloatArray
    bootstrap: FloatArray
    scores: FloatArray
    shrinkage: float
    accuracy: float
    auc: float
    folds: int
    repeats: int

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("modes", "weights", "bootstrap", "scores"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def displacement(self) -> FloatArray:
        """The way from group to group along the discriminant, at each particle [mm], shape (N, 3)."""
        way: FloatArray = np.tensordot(self.weights, self.modes, axes=1)
        return way

    def bounds(self, mode_maps: FloatArray, percent: float = 95.0) -> FloatArray:
        """Return bootstrap bounds of a map on the surface, shape (2, V).

        Parameters
        ----------
        mode_maps : (k, V) array
            The map of each unit mode, such as its signed normal displacement at the vertices.
        percent : float
            Between lower and upper bound lie so many percent of the bootstrap.
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
        Regressed out, inside every fold of the cross-validation from its training subjects only.
    repeats : int
        Repeats of the stratified cross-validation with other folds.
    bootstraps : int
        Cohorts drawn for the bounds.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancelling.

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
    rows = _without_covariates(second, extra, np.arange(len(rows))) @ rows
    scores, basis, _ = principal_components(rows - rows.mean(axis=0))
    scores, basis = scores[:, :modes], basis[:modes]
    direction, gap, middle, shrinkage = _fit(scores, second)
    generator = np.random.default_rng(seed)
    drawn = np.empty((bootstraps, len(basis)))
    for one in range(bootstraps):
        tick(0.5 * one / bootstraps, "bootstrap of the discriminant")
        again = _resampled(second, generator)
        way, length, _, _ = _fit(scores[again], second[again])
        drawn[one] = way * length
    folds = min(_MOST_FOLDS, smallest)
    accuracy, auc = _cross_validated(
        rows @ rows.T, second, extra, modes, (folds, repeats), generator, part_of(tick, 0.5, 1.0)
    )
    return Discriminant(
        modes=basis.reshape(-1, *particles.shape[1:]),
        weights=direction * gap,
        bootstrap=drawn,
        scores=scores @ direction - middle,
        shrinkage=shrinkage,
        accuracy=accuracy,
        auc=auc,
        folds=folds,
        repeats=repeats,
    )


def shrunk_covariance(centred: FloatArray) -> tuple[FloatArray, float]:
    """Return a covariance drawn towards the sphere, and by how much (Ledoit and Wolf 2004).

    Parameters
    ----------
    centred : (M, k) array
        Rows with mean zero.
    """
    count, width = centred.shape
    covariance = centred.T @ centred / count
    sphere = np.trace(covariance) / width * np.eye(width)
    distance = np.square(covariance - sphere).sum()
    spread = (np.square(centred).sum(axis=1) ** 2).sum() / count - np.square(covariance).sum()
    shrinkage = float(np.clip(spread / count / distance, 0.0, 1.0)) if distance > 0.0 else 1.0
    return shrinkage * sphere + (1.0 - shrinkage) * covariance, shrinkage


def _fit(scores: FloatArray, second: BoolArray) -> tuple[FloatArray, float, float, float]:
    """Return unit direction, distance of the means along it, place midway between them, shrinkage."""
    first_mean, second_mean = scores[~second].mean(axis=0), scores[second].mean(axis=0)
    covariance, shrinkage = shrunk_covariance(scores - np.where(second[:, None], second_mean, first_mean))
    apart = second_mean - first_mean
    direction = np.linalg.pinv(covariance) @ apart
    direction /= max(float(np.linalg.norm(direction)), np.finfo(float).tiny)
    middle = float((first_mean + second_mean) @ direction / 2.0)
    return direction, float(apart @ direction), middle, shrinkage


def _resampled(second: BoolArray, generator: np.random.Generator) -> IntArray:
    """Draw subjects with replacement within each group, at least two different ones of each."""
    parts = []
    for members in (np.flatnonzero(~second), np.flatnonzero(second)):
        drawn = generator.choice(members, len(members))
        while (drawn == drawn[0]).all():
            drawn = generator.choice(members, len(members))
        parts.append(drawn)
    return np.concatenate(parts)


def _without_covariates(second: BoolArray, covariates: FloatArray, train: IntArray) -> FloatArray:
    """Return the matrix (M, M) that takes out of all rows what covariates do to the training subjects."""
    operator = np.eye(len(second))
    if covariates.shape[1]:
        columns = np.column_stack([covariates, np.ones(len(second)), second])
        effect = np.linalg.pinv(columns[train])[: covariates.shape[1]]
        operator[:, train] -= covariates @ effect
    return operator


def _cross_validated(
    gram: FloatArray,
    second: BoolArray,
    covariates: FloatArray,
    modes: int,
    rounds: tuple[int, int],
    generator: np.random.Generator,
    tick: Tick,
) -> tuple[float, float]:
    """Return mean accuracy and AUC over the repeats; everything is done in inner products of the subjects."""
    folds, repeats = rounds
    accuracies, areas = [], []
    for repeat in range(repeats):
        tick(repeat / repeats, "cross-validation of the discriminant")
        places = np.empty(len(second))
        fold_of = _stratified(second, folds, generator)
        for fold in range(folds):
            train, test = np.flatnonzero(fold_of != fold), np.flatnonzero(fold_of == fold)
            operator = _without_covariates(second, covariates, train)
            places[test] = _predicted(operator @ gram @ operator.T, second, train, test, modes)
        on_own_side = (places > 0.0) == second
        accuracies.append((on_own_side[second].mean() + on_own_side[~second].mean()) / 2.0)
        wins = stats.mannwhitneyu(places[second], places[~second]).statistic
        areas.append(wins / (np.count_nonzero(second) * np.count_nonzero(~second)))
    return float(np.mean(accuracies)), float(np.mean(areas))


def _predicted(
    gram: FloatArray, second: BoolArray, train: IntArray, test: IntArray, modes: int
) -> FloatArray:
    """Return how far along the training subjects' discriminant the others lie, in distances of its groups."""
    centred = gram - gram[train].mean(axis=0)
    centred = centred - centred[:, train].mean(axis=1, keepdims=True)
    squares, vectors = np.linalg.eigh(centred[np.ix_(train, train)])
    squares, vectors = squares[::-1][:modes], vectors[:, ::-1][:, :modes]
    kept = squares > 1e-9 * squares[0]
    axes = vectors[:, kept] / np.sqrt(squares[kept])
    direction, gap, middle, _ = _fit(centred[np.ix_(train, train)] @ axes, second[train])
    places: FloatArray = (centred[np.ix_(test, train)] @ axes @ direction - middle) / (gap or 1.0)
    return places


def _stratified(second: BoolArray, folds: int, generator: np.random.Generator) -> IntArray:
    """Return a random fold of each subject, the groups spread evenly over the folds."""
    fold_of = np.empty(len(second), np.int64)
    for members in (np.flatnonzero(~second), np.flatnonzero(second)):
        fold_of[generator.permutation(members)] = np.arange(len(members)) % folds
    return fold_of
