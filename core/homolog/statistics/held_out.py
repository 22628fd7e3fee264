"""Cross-validation of a linear discriminant from moments, for many subjects, and its intervals."""

from itertools import pairwise

import numpy as np
from scipy import optimize, stats

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.statistics.effects import CONFIDENCE

__all__ = ["accuracy_bounds", "auc_bounds", "held_out_by_moments", "stratified_folds"]

_FLAT = 1e-9
"""Modes with less than this fraction of the first one's variance are rounding errors."""


def held_out_by_moments(
    rows: FloatArray,
    second: BoolArray,
    covariates: FloatArray,
    fold_of: IntArray,
    modes: int,
    shrinkage: float,
) -> FloatArray:
    """Return each subject's score when it is held out, in distances of the groups.

    Sums and products over the training subjects are those over all subjects minus those over the fold, so
    that each subject is summed once and not for every fold.

    Parameters
    ----------
    rows : (M, k) array
        Centred scores.
    second : (M,) bool array
        Members of the second group.
    covariates : (M, c) array
        Columns to regress out within the groups, as fitted to the training subjects of each fold.
    fold_of : (M,) int array
        The fold in which a subject is held out; each leaves members of both groups.
    modes : int
        Number of leading modes of the training subjects in which the discriminant is fitted.
    shrinkage : float
        Weight of the identity in the covariance.

    Returns
    -------
    (M,) array
    """
    folds, width = int(fold_of.max()) + 1, rows.shape[1]
    cell_of = 2 * fold_of + second
    order = np.argsort(cell_of, kind="stable")
    sorted_rows = np.concatenate([rows, covariates], axis=1)[order]
    ends = np.searchsorted(cell_of[order], np.arange(2 * folds + 1))
    cells = [sorted_rows[begin:end] for begin, end in pairwise(ends)]
    counts = np.diff(ends).reshape(folds, 2).astype(np.float64)
    sums = np.stack([cell.sum(axis=0) for cell in cells]).reshape(folds, 2, -1)
    products = (
        np.stack([cell.T @ cell for cell in cells]).reshape(folds, 2, *2 * [sorted_rows.shape[1]]).sum(1)
    )
    counts, sums, products = (whole.sum(axis=0) - whole for whole in (counts, sums, products))
    means = sums / counts[..., None]  # by group, over the training subjects of each fold
    within = products - np.einsum("fgi,fgj->fij", sums, means)
    kept = np.tile(np.eye(sorted_rows.shape[1], width), (folds, 1, 1))
    if covariates.shape[1]:
        effect = np.linalg.pinv(within[:, width:, width:], hermitian=True) @ within[:, width:, :width]
        kept[:, width:] = -effect
    total, count = sums.sum(axis=1), counts.sum(axis=1)
    scatter = products - total[:, :, None] * total[:, None, :] / count[:, None, None]
    squares, vectors = np.linalg.eigh(np.swapaxes(kept, 1, 2) @ scatter @ kept)
    squares, axes = squares[:, ::-1][:, :modes], vectors[..., ::-1][..., :modes]
    axes = kept @ (axes * (squares > _FLAT * squares[:, :1])[:, None, :])
    centres = means @ axes
    covariance = np.swapaxes(axes, 1, 2) @ within @ axes / count[:, None, None]
    direction, separation = _direction(covariance, centres[:, 1] - centres[:, 0], shrinkage)
    midpoint = (centres.sum(axis=1) * direction).sum(axis=1) / 2.0
    along = (axes @ direction[..., None])[..., 0]
    scores = np.concatenate(
        [(cell @ along[place // 2] - midpoint[place // 2]) for place, cell in enumerate(cells)]
    )
    result = np.empty(len(rows))
    result[order] = scores / np.repeat(np.where(separation == 0.0, 1.0, separation), np.diff(ends[::2]))
    return result


def stratified_folds(second: BoolArray, folds: int, generator: np.random.Generator) -> IntArray:
    """Return a random fold (M,) for each subject, with the groups spread evenly over the folds."""
    fold_of = np.empty(len(second), np.int64)
    for members in (np.flatnonzero(~second), np.flatnonzero(second)):
        fold_of[generator.permutation(members)] = np.arange(len(members)) % folds
    return fold_of


def _direction(
    covariance: FloatArray, difference: FloatArray, shrinkage: float
) -> tuple[FloatArray, FloatArray]:
    """Return unit directions (F, k) of discriminants, and the distances of the means along them (F,)."""
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    varying = variances > 0.0
    size = variances.sum(axis=1) / np.maximum(varying.sum(axis=1), 1)
    sphere = size[:, None, None] * varying[:, None, :] * np.eye(covariance.shape[1])
    shrunk = shrinkage * sphere + (1.0 - shrinkage) * covariance
    direction = (np.linalg.pinv(shrunk, hermitian=True) @ difference[..., None])[..., 0]
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    direction = direction / np.maximum(length, np.finfo(float).tiny)
    return direction, (difference * direction).sum(axis=1)


def accuracy_bounds(correct: FloatArray, second: BoolArray, accuracy: float) -> tuple[float, float]:
    """Combine the Wilson intervals of both groups' shares, as Newcombe (1998) does for a difference."""
    z = float(stats.norm.ppf((1.0 + CONFIDENCE) / 2.0))
    below = above = 0.0
    for own in (correct[second], correct[~second]):
        share, count = float(own.mean()), len(own)
        centre = (share + z**2 / (2 * count)) / (1 + z**2 / count)
        reach = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
        below += (share - (centre - reach)) ** 2
        above += (centre + reach - share) ** 2
    return float(max(accuracy - np.sqrt(below) / 2.0, 0.0)), float(min(accuracy + np.sqrt(above) / 2.0, 1.0))


def auc_bounds(auc: float, second: BoolArray) -> tuple[float, float]:
    """Return the interval of an area under the curve by method 5 of Newcombe (2006).

    It contains the values that differ from the estimate by at most z of their standard errors (variance of
    Hanley and McNeil 1982). It depends only on the area and the numbers of both groups, lies in [0, 1], and
    increases with the area up to 1.
    """
    high = int(np.count_nonzero(second))
    low, z = len(second) - high, float(stats.norm.ppf((1.0 + CONFIDENCE) / 2.0))

    def excess(bound: float, value: float) -> float:
        pairs = (1.0 - bound) / (2.0 - bound) + bound / (1.0 + bound)
        variance = bound * (1.0 - bound) * (1.0 + ((high + low) / 2.0 - 1.0) * pairs) / (high * low)
        return value - bound - z * float(np.sqrt(variance))

    def lower(value: float) -> float:
        if value <= 0.0:
            return 0.0
        below = np.nextafter(1.0, 0.0) if value >= 1.0 else value
        return float(optimize.brentq(excess, 0.0, below, args=(value,)))

    return lower(auc), 1.0 - lower(1.0 - auc)
