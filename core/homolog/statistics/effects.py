"""Effects with 95 % confidence intervals: distance of the means, size, displacement at particles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special, stats

from homolog.arrays import BoolArray, FloatArray
from homolog.statistics.design import Design
from homolog.statistics.permutation import (
    PermutedDesigns,
    null_distribution,
    permutation_count,
    permutation_p_value,
)
from homolog.statistics.statistics import (
    WelchStatistic,
    equalize_groups,
    equalize_subjects,
    null_weights,
    observed_design,
    rao_f,
    restores_mean,
    studentized_ratio,
)
from homolog.threads import on_one_thread

__all__ = [
    "CONFIDENCE",
    "Effect",
    "SizeVariance",
    "corrected_distance",
    "distance_of_several",
    "effect_bounds",
    "explained_variance",
    "size_effect",
    "size_variance",
    "standardized_size",
]

CONFIDENCE = 0.95
_TAILS = (1.0 + CONFIDENCE) / 2.0, (1.0 - CONFIDENCE) / 2.0
_CHUNK = 500
_NEGLIGIBLE = 1e-9
"""Least residual fraction of the variation of size; below it, size is adjusted for and not tested."""


@dataclass(frozen=True, slots=True)
class Effect:
    """An estimate with its confidence interval, and a permutation p-value if it was tested.

    Attributes
    ----------
    value, low, high : float
        Estimate and bounds of the 95 % interval.
    p : float or None
        Two-sided (for accuracy and AUC: one-sided) permutation p-value; None if not tested.
    permutations : int
        Number of permutations; 0 if not tested.
    """

    value: float
    low: float
    high: float
    p: float | None = None
    permutations: int = 0


def corrected_distance(t_squared: float, modes: int, error_dof: int, scale: float) -> Effect | None:
    """Return the Mahalanobis distance corrected for its bias, with its interval.

    The square is unbiased for normal data, ``(v - k - 1) / v D² - k / scale`` with v degrees of freedom of
    the error and k modes; negative values become zero. Bounds from the noncentral F distribution (Reiser
    2001) are valid for normal data with equal covariances.

    Parameters
    ----------
    t_squared : float
        Hotelling's T².
    modes : int
        Number of modes k.
    error_dof : int
        Degrees of freedom of the error.
    scale : float
        T² divided by D²: for two groups ``n1 n2 / (n1 + n2)``.

    Returns
    -------
    Effect or None
        None with fewer than two degrees of freedom more than modes.
    """
    within = error_dof - modes + 1
    if modes < 1 or within < 3:
        return None
    square = (error_dof - modes - 1) / error_dof * t_squared / scale - modes / scale
    f = t_squared * within / (modes * error_dof)
    low, high = (_noncentrality(f, modes, within, tail) / scale for tail in _TAILS)
    return Effect(float(np.sqrt(max(square, 0.0))), float(np.sqrt(low)), float(np.sqrt(high)))


def distance_of_several(
    lawley: float, modes: int, columns: int, error_dof: int, subjects: int
) -> Effect | None:
    """Return the root mean square Mahalanobis distance of three or more groups from their common mean.

    Means are over the subjects. The square is unbiased for normal data, ``((v - k - 1) U - k d) / M`` with v
    degrees of freedom of the error, k modes and d columns. Bounds use McKeon's (1974) approximation of the
    trace U by a noncentral F distribution and are valid for equal covariances. For one column of two equal
    groups the result is half their distance.

    Parameters
    ----------
    lawley : float
        Hotelling and Lawley's trace U.
    modes, columns : int
        Number of modes k, and of tested columns d.
    error_dof : int
        Degrees of freedom of the error.
    subjects : int
        Number of subjects M.

    Returns
    -------
    Effect or None
        None with fewer than four degrees of freedom more than modes.
    """
    left = error_dof - modes
    if modes < 1 or left < 4:
        return None
    product = modes * columns
    ratio = (error_dof + columns - modes - 1) * (error_dof - 1) / ((left - 3) * left)
    within = 4.0 + (product + 2.0) / (ratio - 1.0)
    f = lawley * (left - 1) / product * within / (within - 2.0)
    square = ((left - 1) * lawley - product) / subjects
    low, high = (_noncentrality(f, product, within, tail) / subjects for tail in _TAILS)
    return Effect(float(np.sqrt(max(square, 0.0))), float(np.sqrt(low)), float(np.sqrt(high)))


def explained_variance(
    wilks: float, modes: int, columns: int, error_dof: int, subjects: int
) -> Effect | None:
    """Return the share of the generalised variance that the tested effect explains, with its interval.

    This is ``1 - lambda ** (1 / s)`` of Wilks' lambda, with s as in Rao's F, corrected for bias (omega
    squared). Bounds from the noncentral F distribution (Steiger 2004) are valid for normal data with equal
    covariances; for more than two modes and columns they are approximate (O'Brien and Shieh 1992).

    Parameters
    ----------
    wilks : float
        Wilks' lambda.
    modes, columns : int
        Number of modes, and of tested columns.
    error_dof : int
        Degrees of freedom of the error.
    subjects : int
        Number of subjects.

    Returns
    -------
    Effect or None
        None with fewer than two degrees of freedom more than modes.
    """
    if modes < 1 or error_dof - modes < 2:
        return None
    f, between, within = (float(item) for item in rao_f(np.array(wilks), modes, columns, error_dof))
    root = (within + between / 2.0 - 1.0) / (error_dof - (modes - columns + 1.0) / 2.0)
    unbiased = max(between * (f * (within - 2.0) / within - 1.0), 0.0)
    low, high = (_noncentrality(f, between, within, tail) for tail in _TAILS)
    value, low, high = (item / (item + root * subjects) for item in (unbiased, low, high))
    return Effect(value, low, high)


def _noncentrality(f: float, between: float, within: float, probability: float) -> float:
    """Return the noncentrality at which F is below f with this probability; 0 if it never is."""
    if stats.f.cdf(f, between, within) <= probability:
        return 0.0

    def above(noncentrality: float) -> float:
        return float(stats.ncf.cdf(f, between, within, noncentrality)) - probability

    limit = 10.0 + 2.0 * f * between
    while above(limit) > 0.0:
        limit *= 2.0
    return float(optimize.brentq(above, 0.0, limit, xtol=1e-10 * limit))


def effect_bounds(
    values: FloatArray, design: Design, members: Sequence[BoolArray] = ()
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficient of one tested column for many variables, with bounds of its 95 % interval.

    Parameters
    ----------
    values : (M, N) array
        Variables of each subject.
    design : Design
        Design with one tested column.
    members : sequence of (M,) bool arrays, optional
        Groups of a design without covariates. Degrees of freedom are then those of Welch (1947), otherwise
        those of the design.

    Returns
    -------
    value, low, high : (N,) arrays
        Standard errors use each group's own variance (HC2 with covariates or a variable).
    """
    column = design.tested[:, 0]
    unit = float(np.linalg.norm(design.columns[:, 0]))
    residuals = design.residuals(values)
    along = column @ residuals
    rest = residuals - column[:, None] * along
    parts = null_weights(observed_design(design), design)[0][:, None] * np.square(rest)
    variance = parts.sum(axis=0)
    dof = np.full(values.shape[1], float(design.error_dof))
    if members:
        spread = sum(
            np.square(parts[member].sum(axis=0)) / (np.count_nonzero(member) - 1.0) for member in members
        )
        dof = np.square(variance) / np.maximum(spread, np.finfo(float).tiny)
        dof = np.clip(dof, 1.0, float(design.error_dof))
    reach = stats.t.ppf((1.0 + CONFIDENCE) / 2.0, dof) * np.sqrt(variance) / unit
    value = along / unit
    return value, value - reach, value + reach


@on_one_thread
def size_effect(
    size: FloatArray,
    design: Design,
    members: Sequence[BoolArray] = (),
    *,
    permutations: int = 10_000,
    seed: int = 0,
) -> Effect | None:
    """Test whether size differs or changes, by permutation of its studentized statistic.

    Parameters
    ----------
    size : (M,) array
        Size of each subject, or the differences of pairs [mm].
    design : Design
        The tested design.
    members : sequence of (M,) bool arrays, optional
        The groups, without covariates; see `effect_bounds`.
    permutations, seed : int
        See `homolog.statistics.mode_test.mode_test`.

    Returns
    -------
    Effect or None
        Difference or change per unit [mm]; value and bounds are NaN for more than two groups. None if size
        itself is tested or adjusted for.
    """
    residuals = design.residuals(size[:, None])
    spread = float(np.square(size - (size.mean() if design.nuisance.shape[1] else 0.0)).sum())
    left = residuals - design.tested @ (design.tested.T @ residuals)
    if spread == 0.0 or float(np.square(left).sum()) <= _NEGLIGIBLE * spread:
        return None
    count, _ = permutation_count(design, permutations)
    groups = equalize_groups(residuals, design)
    welch = None if groups is None else WelchStatistic(groups.values[None], np.ones(1), groups, design)
    equalized = None if groups is not None else equalize_subjects(residuals, design)

    def statistic(some: PermutedDesigns) -> FloatArray:
        if welch is not None:
            return welch.deviate(some)[:, 0]
        if equalized is not None:
            return studentized_ratio(equalized.restored(equalized.values, some), some, design)
        rest = residuals[None, :, :]
        rest = rest - some.covariates @ (np.swapaxes(some.covariates, 1, 2) @ rest)
        return studentized_ratio(rest, some, design)

    means = restores_mean(welch, equalized)
    null_statistics = null_distribution(statistic, design, permutations, chunk=_CHUNK, seed=seed, means=means)
    p = float(permutation_p_value(statistic(observed_design(design)), null_statistics, count)[0])
    if design.tested.shape[1] > 1:
        return Effect(float("nan"), float("nan"), float("nan"), p, count)
    value, low, high = (
        float(effect_bound[0]) for effect_bound in effect_bounds(size[:, None], design, members)
    )
    return Effect(value, low, high, p, count)


@dataclass(frozen=True, slots=True)
class SizeVariance:
    """Share of the variance of size between three or more groups.

    Attributes
    ----------
    f : float
        Welch's F (1951); with covariates, F of the analysis of covariance.
    dof : (float, float)
        Degrees of freedom of numerator and denominator.
    omega_squared : Effect
        Share of the variance (with covariates, of the residual variance) between the groups, corrected for
        bias (Hays 1963), with bounds from the noncentral F distribution. It has no p; see `size_effect`.
    """

    f: float
    dof: tuple[float, float]
    omega_squared: Effect


def size_variance(size: FloatArray, design: Design, members: Sequence[BoolArray] = ()) -> SizeVariance:
    """Return the share of the variance of size between groups.

    Parameters
    ----------
    size : (M,) array
        Size of each subject [mm].
    design : Design
        Design of three or more groups.
    members : sequence of (M,) bool arrays, optional
        The groups, without covariates.
    """
    between, count = design.tested.shape[1], len(size)
    if members:
        f, within = _welch_f([size[own] for own in members])
    else:
        residuals = design.residuals(size[:, None])[:, 0]
        explained = float(np.square(design.tested.T @ residuals).sum())
        within = float(design.error_dof)
        f = explained / between / ((float(np.square(residuals).sum()) - explained) / within)
    share = between * (f - 1.0)
    low, high = (_noncentrality(f, between, within, tail) for tail in _TAILS)
    omega = Effect(max(share, 0.0) / (max(share, 0.0) + count), low / (low + count), high / (high + count))
    return SizeVariance(f, (float(between), within), omega)


def standardized_size(size: FloatArray, design: Design) -> Effect | None:
    """Return the effect of one tested column on size in residual standard deviations.

    For two groups this is Hedges' g; for pairs, the mean difference in standard deviations of the
    differences. Bounds from the noncentral t distribution assume equal variances. None for several columns,
    or without residual variation.
    """
    residuals = design.residuals(size[:, None])[:, 0]
    along = design.tested.T @ residuals
    left = float(np.square(residuals - design.tested @ along).sum())
    dof = design.error_dof
    if len(along) > 1 or dof < 2 or left <= _NEGLIGIBLE * float(np.square(residuals).sum()):
        return None
    t = float(along[0]) / np.sqrt(left / dof)
    unit = float(np.linalg.norm(design.columns[:, 0]))
    unbiased = np.exp(special.gammaln(dof / 2) - special.gammaln((dof - 1) / 2)) * np.sqrt(2 / dof)
    low, high = (_noncentral_t(t, dof, tail) for tail in _TAILS)
    return Effect(float(unbiased * t / unit), low / unit, high / unit)


def _noncentral_t(t: float, dof: int, probability: float) -> float:
    """Return the noncentrality at which Student's t is below t with this probability."""

    def above(noncentrality: float) -> float:
        return float(special.nctdtr(dof, noncentrality, t)) - probability

    step, way = 1.0, 1.0 if above(t) > 0.0 else -1.0
    while above(t + way * step) * way > 0.0:  # comparison with NaN ends it, too
        step *= 1.5
    low, high = sorted((t, t + way * step))
    if not np.isfinite([above(low), above(high)]).all():
        return float("nan")
    return float(optimize.brentq(above, low, high, xtol=1e-9))


def _welch_f(parts: Sequence[FloatArray]) -> tuple[float, float]:
    """Return F and the degrees of freedom of its denominator (Welch 1951)."""
    groups, free = len(parts), np.array([len(part) - 1.0 for part in parts])
    variances = np.array([max(part.var(ddof=1), np.finfo(float).tiny) for part in parts])
    weights, means = (free + 1.0) / variances, np.array([part.mean() for part in parts])
    grand = weights @ means / weights.sum()
    spread = float((np.square(1.0 - weights / weights.sum()) / free).sum())
    ratio = float(weights @ np.square(means - grand)) / (groups - 1.0)
    f = ratio / (1.0 + 2.0 * (groups - 2.0) / (groups**2 - 1.0) * spread)
    return f, (groups**2 - 1.0) / (3.0 * spread)
