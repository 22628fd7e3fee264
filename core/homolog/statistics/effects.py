"""Effects with confidence intervals: distance of the means, size, displacement at particles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special, stats

from homolog.arrays import BoolArray, FloatArray
from homolog.statistics.design import Hypothesis
from homolog.statistics.randomization import Randomization, adjusted_columns
from homolog.statistics.wilks import rao_f

__all__ = [
    "CONFIDENCE",
    "STEIGER",
    "Effect",
    "SizeVariance",
    "coefficient",
    "corrected_distance",
    "degrees",
    "distance_of_several",
    "effect_bounds",
    "explained_variance",
    "size_effect",
    "size_variance",
    "standardized_size",
    "unit_parts",
]

CONFIDENCE = 0.95
_TAILS = (1.0 + CONFIDENCE) / 2.0, (1.0 - CONFIDENCE) / 2.0
STEIGER = 0.90
"""Level of intervals of D, omega squared and other effects that can't be negative: F is tested on one side,
so that with 95 % the intervals of one in three significant effects begin at 0 (Steiger 2004)."""
_ONE_SIDED = (1.0 + STEIGER) / 2.0, (1.0 - STEIGER) / 2.0
_NEGLIGIBLE = 1e-9
"""Least residual fraction of the variation of size; below it, size is adjusted for and not tested."""


@dataclass(frozen=True, slots=True)
class Effect:
    """An estimate with its confidence interval, and a permutation p-value if it was tested.

    Attributes
    ----------
    value, low, high : float
        Estimate and bounds of the interval.
    p : float or None
        Two-sided (for accuracy and AUC: one-sided) permutation p-value; None if not tested.
    permutations : int
        Number of permutations; 0 if not tested.
    level : float
        Level of the interval: 0.95, or 0.90 for effects that can't be negative (see `STEIGER`).
    """

    value: float
    low: float
    high: float
    p: float | None = None
    permutations: int = 0
    level: float = CONFIDENCE


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
    low, high = (_noncentrality(f, modes, within, tail) / scale for tail in _ONE_SIDED)
    return Effect(float(np.sqrt(max(square, 0.0))), float(np.sqrt(low)), float(np.sqrt(high)), level=STEIGER)


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
    low, high = (_noncentrality(f, product, within, tail) / subjects for tail in _ONE_SIDED)
    return Effect(float(np.sqrt(max(square, 0.0))), float(np.sqrt(low)), float(np.sqrt(high)), level=STEIGER)


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
    low, high = (_noncentrality(f, between, within, tail) for tail in _ONE_SIDED)
    value, low, high = (item / (item + root * subjects) for item in (unbiased, low, high))
    return Effect(value, low, high, level=STEIGER)


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


def unit_parts(values: FloatArray, hypothesis: Hypothesis, members: Sequence[BoolArray] = ()) -> FloatArray:
    """Return what each unit contributes to ``tested.T @ values`` of one column, (K, N).

    The sum of their squares is its variance: of groups without covariates Welch's (HC2), otherwise HC4.

    Parameters
    ----------
    values : (M, N) array
        Variables of each row.
    hypothesis : Hypothesis
        With one tested column.
    members : sequence of (M,) bool arrays, optional
        Groups of a design without covariates.
    """
    columns = np.hstack([hypothesis.tested, hypothesis.nuisance])
    rest = values - columns @ (columns.T @ values)
    parts = adjusted_columns(hypothesis, hc4=not members) * rest
    sums = np.zeros((hypothesis.n_units, values.shape[1]))
    np.add.at(sums, hypothesis.units, parts)
    return sums


def degrees(squares: FloatArray, hypothesis: Hypothesis, members: Sequence[BoolArray] = ()) -> FloatArray:
    """Return the degrees of freedom (N,) of the sum over units of squares (K, N).

    Those of Welch (1947) for groups without covariates, for units of several rows those of Bell and McCaffrey
    (2002), otherwise units less columns.
    """
    columns = hypothesis.nuisance.shape[1] + hypothesis.tested.shape[1]
    most = float(max(hypothesis.n_units - columns, 1))
    if hypothesis.n_units < len(hypothesis.units):
        most = _cluster_degrees(hypothesis)
    if not members:
        return np.full(squares.shape[1], most)
    spread = sum(np.square(squares[own].sum(axis=0)) / (np.count_nonzero(own) - 1.0) for own in members)
    whole = np.square(squares.sum(axis=0))
    dof: FloatArray = np.clip(whole / np.maximum(spread, np.finfo(float).tiny), 1.0, most)
    return dof


def _cluster_degrees(hypothesis: Hypothesis) -> float:
    """Return the degrees of freedom of the variance that units show, if rows are independent."""
    columns = np.hstack([hypothesis.tested, hypothesis.nuisance])
    adjusted = adjusted_columns(hypothesis, hc4=True)[:, :1]
    parts = adjusted * (hypothesis.units[:, None] == np.arange(hypothesis.n_units))
    parts -= columns @ (columns.T @ parts)
    products = parts.T @ parts
    return max(float(np.trace(products) ** 2 / np.square(products).sum()), 1.0)


def coefficient(
    values: FloatArray, hypothesis: Hypothesis, members: Sequence[BoolArray] = ()
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficient of one tested column, its standard error and its degrees of freedom, (N,) each.

    Parameters are those of `effect_bounds`.
    """
    unit = float(np.linalg.norm(hypothesis.columns[:, 0]))
    squares = np.square(unit_parts(values, hypothesis, members) / unit)
    value = hypothesis.tested[:, 0] @ values / unit
    return value, np.sqrt(squares.sum(axis=0)), degrees(squares, hypothesis, members)


def effect_bounds(
    values: FloatArray, hypothesis: Hypothesis, members: Sequence[BoolArray] = ()
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficient of one tested column for many variables, with bounds of its 95 % interval.

    Parameters
    ----------
    values : (M, N) array
        Variables of each row.
    hypothesis : Hypothesis
        With one tested column.
    members : sequence of (M,) bool arrays, optional
        Groups of a design without covariates; intervals are then Welch's.

    Returns
    -------
    value, low, high : (N,) arrays
        Standard errors are those that units show: Welch's, or HC4 (of units of several rows its extension to
        clusters).
    """
    value, error, dof = coefficient(values, hypothesis, members)
    reach = stats.t.ppf((1.0 + CONFIDENCE) / 2.0, dof) * error
    return value, value - reach, value + reach


def size_effect(
    size: FloatArray,
    hypothesis: Hypothesis,
    members: Sequence[BoolArray] = (),
    *,
    shapes: FloatArray | None = None,
    permutations: int = 10_000,
    seed: int = 0,
) -> Effect | None:
    """Test whether size differs or changes, by residual randomization.

    Parameters
    ----------
    size : (M,) array
        Size of each subject, or the differences of pairs [mm].
    hypothesis : Hypothesis
        What is tested.
    members : sequence of (M,) bool arrays, optional
        The groups, without covariates; see `effect_bounds`.
    shapes : (M, P) array, optional
        Shapes whose dispersions are the weights of the reduced model; by default equal weights.
    permutations, seed : int
        Number of randomizations, and their seed.

    Returns
    -------
    Effect or None
        Difference or change per unit [mm]; value and bounds are NaN for more than two groups. None if size
        itself is tested or adjusted for.
    """
    residuals = hypothesis.residuals(size[:, None])
    spread = float(np.square(size - (size.mean() if hypothesis.nuisance.shape[1] else 0.0)).sum())
    left = residuals - hypothesis.tested @ (hypothesis.tested.T @ residuals)
    if spread == 0.0 or float(np.square(left).sum()) <= _NEGLIGIBLE * spread:
        return None
    drawn = Randomization(hypothesis, shapes, draws=permutations, seed=seed)
    p = drawn.ratio(size[:, None]).p
    if hypothesis.tested.shape[1] > 1:
        return Effect(float("nan"), float("nan"), float("nan"), p, drawn.count)
    bounds = effect_bounds(size[:, None], hypothesis, members)
    value, low, high = (float(bound[0]) for bound in bounds)
    return Effect(value, low, high, p, drawn.count)


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


def size_variance(
    size: FloatArray, hypothesis: Hypothesis, members: Sequence[BoolArray] = ()
) -> SizeVariance:
    """Return the share of the variance of size between groups.

    Parameters
    ----------
    size : (M,) array
        Size of each subject [mm].
    hypothesis : Hypothesis
        Design of three or more groups.
    members : sequence of (M,) bool arrays, optional
        The groups, without covariates.
    """
    between, count = hypothesis.tested.shape[1], len(size)
    if members:
        f, within = _welch_f([size[own] for own in members])
    else:
        residuals = hypothesis.residuals(size[:, None])[:, 0]
        explained = float(np.square(hypothesis.tested.T @ residuals).sum())
        within = float(hypothesis.error_dof)
        f = explained / between / ((float(np.square(residuals).sum()) - explained) / within)
    share = between * (f - 1.0)
    low, high = (_noncentrality(f, between, within, tail) for tail in _ONE_SIDED)
    omega = Effect(
        max(share, 0.0) / (max(share, 0.0) + count), low / (low + count), high / (high + count), level=STEIGER
    )
    return SizeVariance(f, (float(between), within), omega)


def standardized_size(size: FloatArray, hypothesis: Hypothesis) -> Effect | None:
    """Return the effect of one tested column on size in residual standard deviations.

    For two groups this is Hedges' g; for pairs, the mean difference in standard deviations of the
    differences. Bounds from the noncentral t distribution assume equal variances. None for several columns,
    or without residual variation.
    """
    residuals = hypothesis.residuals(size[:, None])[:, 0]
    along = hypothesis.tested.T @ residuals
    left = float(np.square(residuals - hypothesis.tested @ along).sum())
    dof = hypothesis.error_dof
    if len(along) > 1 or dof < 2 or left <= _NEGLIGIBLE * float(np.square(residuals).sum()):
        return None
    t = float(along[0]) / np.sqrt(left / dof)
    unit = float(np.linalg.norm(hypothesis.columns[:, 0]))
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
