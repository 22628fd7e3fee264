"""Assumptions of the tests: dispersion of the groups, skewness of sizes, outliers.

Equal covariances: lengths and directions of residual scores in the retained modes are compared between the
groups, or along the variable, by permutation: covariances may differ in amount (then distances to the
centroid do, as by Anderson 2006) or in pattern. Tests of means are not
robust to skewed data in few and unequal groups. A shape far from all others usually has a faulty segmentation
or correspondence.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.statistics.design import Hypothesis
from homolog.statistics.effects import CONFIDENCE, Effect
from homolog.statistics.randomization import p_values
from homolog.statistics.shape_model import leading_scores
from homolog.threads import on_one_thread

__all__ = [
    "Dispersion",
    "SizeSkewness",
    "dispersion_test",
    "outlier_limit",
    "outliers_by",
    "relative_distances",
    "shape_outliers",
    "size_skewness",
]

_CHUNK = 500
_CHUNK_VALUES = 2_000_000
_LEAST_LEFT = 1e-6
"""Lower bound of 1 - leverage as a divisor."""
_FEWEST_OF_GROUP = 3
"""Least number of subjects for an interval of a group's dispersion."""


@dataclass(frozen=True, slots=True, eq=False)
class Dispersion:
    """Dispersion of the groups, and the test for a difference.

    Attributes
    ----------
    distances : (M,) array
        Distance of each subject to its group's centroid, or to its fitted shape, in the retained modes: root
        mean square over the particles [mm], corrected for fitting the centroid.
    by_group : dict
        Mean distance in each group [mm]; empty without groups.
    f : float
        F of lengths and directions of residual scores: how much covariances differ, in amount or pattern.
    p : float
        Share of the permutations of residuals with an F at least as large. The model is fitted to them again.
    permutations : int
        Number of permutations.
    intervals : dict
        Mean distance in each group with its 95 % interval [mm]; empty without groups, or if one of them has
        fewer than three subjects.
    effect : Effect or None
        For two groups, the ratio of the second's mean distance to the first's; for a variable, the change of
        the distance per unit [mm]; with 95 % interval. None for several tested columns.
    """

    distances: FloatArray
    by_group: dict[str, float]
    f: float
    p: float
    permutations: int
    intervals: dict[str, Effect]
    effect: Effect | None

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "distances", frozen(self.distances, np.float64))

    @property
    def ratio(self) -> float:
        """Largest mean distance of a group divided by the smallest; 1 without groups."""
        means = list(self.by_group.values())
        return max(means) / max(min(means), np.finfo(float).tiny) if means else 1.0


@on_one_thread
def dispersion_test(
    particles: FloatArray,
    design: Hypothesis,
    modes: int,
    members: dict[str, BoolArray],
    *,
    permutations: int = 10_000,
    seed: int = 0,
) -> Dispersion | None:
    """Test whether residual distances differ between groups, or along a variable.

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions [mm].
    design : Hypothesis
        Of groups or of a continuous variable.
    modes : int
        Number of leading modes.
    members : dict of (M,) bool arrays
        Members of each group; empty for a continuous variable.
    permutations : int
        Permutations of the residuals.
    seed : int
        Same seed, same result.

    Returns
    -------
    Dispersion or None
        None without a mode, and for pairs, whose differences form one group.
    """
    if modes == 0 or not design.nuisance.shape[1] or design.n_units < len(design.units):
        return None
    scores, _ = leading_scores(design.residuals(particles.reshape(len(particles), -1)), modes)
    columns = np.hstack([design.nuisance, design.tested])
    rest, left = _rest(scores, columns[None])
    standardized = rest[0] / np.sqrt(left[0])[:, None]
    lengths = np.linalg.norm(standardized, axis=0)
    observed, null_statistics = _covariances(
        standardized / np.where(lengths > 0.0, lengths, 1.0), design, bool(members), permutations, seed
    )
    distances = np.sqrt(np.square(standardized).sum(axis=1) / particles.shape[1])
    by_group = {name: float(distances[own].mean()) for name, own in members.items()}
    p = float(p_values(observed, null_statistics))
    held_out = _HeldOut(scores / np.sqrt(particles.shape[1]), columns)
    if members:
        intervals, effect = _of_groups(held_out, by_group, members)
    else:
        intervals, effect = {}, None
        if design.tested.shape[1] == 1:
            effect = _along(held_out, distances, float(np.linalg.norm(design.columns)))
    return Dispersion(distances, by_group, observed, p, len(null_statistics), intervals, effect)


class _HeldOut:
    """Leave-one-out distances: centroids are fitted without the held-out subject."""

    def __init__(self, rows: FloatArray, columns: FloatArray) -> None:
        (self.rest,), (self.left,) = _rest(rows, columns[None])
        self.columns = columns

    def blocks(self, own: IntArray) -> Iterator[tuple[IntArray, FloatArray]]:
        """Yield held-out subjects, each with the distances of its group; its own distance is zero."""
        for held in np.array_split(own, max(1, len(own) ** 2 // _CHUNK_VALUES)):
            shared = self.columns[held] @ self.columns[own].T
            shift = shared / self.left[held, None]
            products = self.rest[held] @ self.rest[own].T
            lengths = np.square(self.rest).sum(axis=1)
            squares = lengths[own] + 2.0 * shift * products + np.square(shift) * lengths[held, None]
            left = np.maximum(self.left[own] - shared * shift, _LEAST_LEFT)
            yield held, np.sqrt(np.maximum(squares, 0.0) / left) * (held[:, None] != own)


def _of_groups(
    held_out: _HeldOut, by_group: dict[str, float], members: Mapping[str, BoolArray]
) -> tuple[dict[str, Effect], Effect | None]:
    """Return mean distances of groups, and the ratio of two, with jackknife intervals of their logarithms."""
    fewest = min(np.count_nonzero(own) for own in members.values())
    if fewest < _FEWEST_OF_GROUP or not all(by_group.values()):
        return {}, None
    variances, free = [], []
    for own in map(np.flatnonzero, members.values()):
        sums = np.concatenate([distances.sum(axis=1) for _, distances in held_out.blocks(own)])
        variances.append((len(own) - 1.0) ** 2 / len(own) * float(np.log(sums).var(ddof=1)))
        free.append(len(own) - 1.0)
    intervals = {
        name: _of_logarithm(mean, variance, dof)
        for (name, mean), variance, dof in zip(by_group.items(), variances, free, strict=True)
    }
    if len(by_group) > 2:
        return intervals, None
    first, second = by_group.values()
    both = sum(variances)
    dof = both**2 / sum(item**2 / own for item, own in zip(variances, free, strict=True))
    return intervals, _of_logarithm(second / first, both, dof)


def _of_logarithm(value: float, variance: float, dof: float) -> Effect:
    """Return a positive value with the interval from the variance of its logarithm."""
    reach = float(np.exp(stats.t.ppf((1.0 + CONFIDENCE) / 2.0, dof) * np.sqrt(variance)))
    return Effect(value, value / reach, value * reach)


def _along(held_out: _HeldOut, distances: FloatArray, unit: float) -> Effect:
    """Return the change of the distances along a variable, with its jackknife interval."""
    columns, count = held_out.columns, len(distances)
    slopes = []
    for held, values in held_out.blocks(np.arange(count)):
        fitted = values @ columns
        missed = (columns[held] * fitted).sum(axis=1) / held_out.left[held]
        slopes.append(fitted[:, -1] + missed * columns[held, -1])
    variance = (count - 1.0) ** 2 / count * float(np.concatenate(slopes).var(ddof=1))
    dof = count - columns.shape[1]
    reach = float(stats.t.ppf((1.0 + CONFIDENCE) / 2.0, dof) * np.sqrt(variance)) / unit
    value = float(columns[:, -1] @ distances) / unit
    return Effect(value, value - reach, value + reach)


def _rest(rows: FloatArray, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (c, M, k) of rows (M, k) after columns (c, M, q), and 1 - leverage (c, M)."""
    rest: FloatArray = rows - columns @ (np.swapaxes(columns, 1, 2) @ rows)
    return rest, np.maximum(1.0 - np.square(columns).sum(axis=2), _LEAST_LEFT)


def _covariances(
    scores: FloatArray, design: Hypothesis, has_groups: bool, permutations: int, seed: int
) -> tuple[float, FloatArray]:
    """Return F of how residual scores (M, k) scatter, and its permutation distribution.

    A row of residuals is described by the logarithm of its length, which tells amounts of scatter, and by the
    products of its direction, which tell patterns: both scatter alike in all groups, so that a difference is
    noticed whichever group has it, and outliers weigh little. The model is fitted again to each permutation,
    since residuals from fitted means are dependent. In a design without groups the covariance may change with
    any column.
    """
    columns = np.hstack([design.nuisance, design.tested])
    changing = design.tested if has_groups else columns[:, 1:]
    left = np.maximum(1.0 - np.square(columns).sum(axis=1), _LEAST_LEFT)
    first, second = np.triu_indices(scores.shape[1])
    counted = np.where(first == second, 1.0, np.sqrt(2.0))

    def ratio(rows: FloatArray) -> FloatArray:
        rest = rows - columns @ (columns.T @ rows)
        rest /= np.sqrt(left)[:, None]
        lengths = np.linalg.norm(rest, axis=2, keepdims=True)
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        rest /= lengths
        described = np.concatenate(
            [rest[:, :, first] * rest[:, :, second] * counted, np.log(lengths)], axis=2
        )
        whole = np.square(described - described.mean(axis=1, keepdims=True)).sum(axis=(1, 2))
        error = whole - np.square(columns[:, 1:].T @ described).sum(axis=(1, 2))
        explained = np.square(changing.T @ described).sum(axis=(1, 2))
        scale = design.error_dof / changing.shape[1]
        f: FloatArray = scale * explained / np.maximum(error, np.finfo(float).tiny)
        return f

    generator, null = np.random.default_rng(seed), np.empty(permutations)
    chunk = max(1, min(_CHUNK, _CHUNK_VALUES // (len(scores) * len(first))))
    for start in range(0, permutations, chunk):
        size = min(chunk, permutations - start)
        orders = generator.random((size, len(scores))).argsort(axis=1)
        null[start : start + size] = ratio(scores[orders])
    return float(ratio(scores[None])[0]), null


_FEWEST = 8
"""Least number of subjects for which the test is defined."""
_MODES = 5


@dataclass(frozen=True, slots=True)
class SizeSkewness:
    """Skewness of sizes and shapes within groups.

    Attributes
    ----------
    value : float
        Skewness of the residuals, each divided by the standard deviation of its group.
    p : float
        p of the test that sizes are not skewed (D'Agostino 1970).
    shape_p : float
        p of the test that scores in the five leading modes are not skewed (sum of squared normal deviates).
    deviations : dict
        Standard deviation of size in each group [mm]; empty for pairs.
    """

    value: float
    p: float
    shape_p: float
    deviations: dict[str, float]


def size_skewness(
    size: FloatArray, shapes: FloatArray, design: Hypothesis, members: Mapping[str, BoolArray]
) -> SizeSkewness | None:
    """Test whether sizes and shapes are skewed within groups; None for a variable or under eight subjects.

    The test has little power for few sizes. Shapes, which include size, show skewness more often.

    Parameters
    ----------
    size : (M,) array
        Size of each subject, or the differences of pairs [mm].
    shapes : (M, N, 3) array
        Aligned positions, or the differences of pairs [mm].
    design : Hypothesis
        The tested design.
    members : mapping of str to (M,) bool arrays
        Members of each group; empty for pairs and for a variable.
    """
    paired = not design.nuisance.shape[1]
    if len(size) < _FEWEST or not (paired or members):
        return None
    residuals = _within(size[:, None], design)[:, 0]
    deviations = {name: float(residuals[own].std(ddof=1)) for name, own in members.items()}
    scale = np.ones(len(size))
    for name, own in members.items():
        scale[own] = deviations[name]
    if residuals.std() <= 1e-9 * max(float(np.abs(size).max()), 1e-300) or scale.min() <= 0.0:
        return None
    standard = residuals / scale
    return SizeSkewness(
        float(stats.skew(standard)),
        float(stats.skewtest(standard).pvalue),
        _shape_p(_within(shapes.reshape(len(shapes), -1), design), members),
        deviations,
    )


def _within(values: FloatArray, design: Hypothesis) -> FloatArray:
    """Return the residuals of values (M, P) after nuisance columns and tested effect."""
    residuals = design.residuals(values)
    residuals -= design.tested @ (design.tested.T @ residuals)
    return residuals


def _shape_p(residuals: FloatArray, members: Mapping[str, BoolArray]) -> float:
    for own in members.values():
        residuals[own] /= max(float(np.sqrt(np.square(residuals[own]).mean())), np.finfo(float).tiny)
    scores, _ = leading_scores(residuals, _MODES)
    deviates = np.atleast_1d(stats.skewtest(scores[:, scores.std(axis=0) > 0.0], axis=0).statistic)
    return float(stats.chi2.sf(np.square(deviates).sum(), max(len(deviates), 1)))


_LIMIT = 5.0


def shape_outliers(particles: FloatArray, *, limit: float = _LIMIT) -> IntArray:
    """Return the indices of subjects far from the median shape, the farthest first.

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions [mm].
    limit : float
        A subject is far if its distance exceeds the median distance by more than this number of standard
        deviations, estimated by the median absolute deviation (Leys et al. 2013).

    Returns
    -------
    (n,) int array
        Distances are root mean squares over the particles from the median of each coordinate.
    """
    apart = particles - np.median(particles, axis=0)
    distance = np.sqrt(np.square(apart).sum(axis=2).mean(axis=1))
    return outliers_by(distance, limit)


def relative_distances(
    particles: FloatArray, design: Hypothesis, members: Collection[BoolArray] = ()
) -> FloatArray:
    """Return the distance of each subject from the mean of its group, relative to the group's median, (M,).

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions, or differences of pairs [mm].
    design : Hypothesis
        Distances are those from the shape that the design fits to a subject.
    members : collection of (M,) bool arrays
        The groups; distances are divided by the median of their group.
    """
    rest = _within(particles.reshape(len(particles), -1), design)
    distance: FloatArray = np.sqrt(np.square(rest).mean(axis=1))
    for own in members:
        distance[own] /= max(float(np.median(distance[own])), np.finfo(float).tiny)
    return distance


def outlier_limit(distance: FloatArray, limit: float = _LIMIT) -> float:
    """Return the distance above which subjects are outliers; infinite if half of the distances are equal."""
    middle = float(np.median(distance))
    deviation = 1.4826 * float(np.median(np.abs(distance - middle)))
    return middle + limit * deviation if deviation > 0.0 else float("inf")


def outliers_by(distance: FloatArray, limit: float = _LIMIT) -> IntArray:
    """Return the indices of subjects beyond `outlier_limit`, the farthest first."""
    far = np.flatnonzero(distance > outlier_limit(distance, limit))
    order: IntArray = far[np.argsort(-distance[far])]
    return order
