"""Welch's tests of a number for groups of unequal variances: at each particle, and per subject."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick
from homolog.statistics.design import group_design, reference_first
from homolog.statistics.effects import CONFIDENCE, Effect, coefficient
from homolog.statistics.randomization import Randomization

__all__ = ["GroupMeasure", "WelchMap", "compare_measure", "mean_difference", "welch_map"]


@dataclass(frozen=True, slots=True, eq=False)
class WelchMap:
    """A signed test at each particle. Arrays are read-only.

    Attributes
    ----------
    difference : (N,) array
        Mean of the second group minus that of the first.
    t : (N,) array
        Welch's t; 0 where nothing varies.
    p : (N,) array
        Parametric, two-sided p at each particle, not corrected.
    p_fwe : (N,) array
        p corrected by the null distribution of the largest magnitude of t over the surface
        (`homolog.statistics.randomization`).
    q : (N,) array
        Benjamini-Hochberg false discovery rate.
    """

    difference: FloatArray
    t: FloatArray
    p: FloatArray
    p_fwe: FloatArray
    q: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


def welch_map(
    values: FloatArray,
    second: BoolArray,
    *,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> WelchMap:
    """Compare two groups at every particle (Welch 1947).

    Parameters
    ----------
    values : (M, N) array
        A number for each subject and particle, such as displacement along the mean's outward normals [mm].
    second : (M,) bool array
        Members of the second group; the others are the first.
    permutations : int
        Number of permutations for the correction over the surface.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    WelchMap

    Raises
    ------
    InputError
        If a group has fewer than two subjects, or values are not finite.
    """
    if min(np.count_nonzero(second), np.count_nonzero(~second)) < 2 or not np.isfinite(values).all():
        raise InputError("a pointwise comparison needs finite values and at least two subjects in each group")
    hypothesis = group_design(np.where(second, "b", "a").tolist(), ["a", "b"])
    difference, error, dof = coefficient(values, hypothesis, [~second, second])
    varies = (error > 0.0) & (np.ptp(values, axis=0) > 0.0)
    t = np.where(varies, difference / np.where(varies, error, 1.0), 0.0)
    p = np.asarray(2.0 * stats.t.sf(np.abs(t), dof), np.float64)
    drawn = Randomization(hypothesis, values, draws=permutations, seed=seed, tick=tick)
    p_fwe = drawn.surface(values[:, :, None]).p_fwe
    return WelchMap(difference, t, p, p_fwe, stats.false_discovery_control(p))


@dataclass(frozen=True, slots=True)
class GroupMeasure:
    """A measure by group.

    Attributes
    ----------
    groups : tuple of str
        Names of the groups, sorted.
    values : tuple of (n,) array
        The values of each group that are not missing.
    means, deviations : tuple of float
        Mean and standard deviation of each group, in the measure's unit; the deviation of a single subject is
        NaN.
    p : float or None
        Two-sided p-value of equal means; None if it can't be tested.
    """

    groups: tuple[str, ...]
    values: tuple[FloatArray, ...]
    means: tuple[float, ...]
    deviations: tuple[float, ...]
    p: float | None

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of subjects with a value."""
        return tuple(map(len, self.values))


def compare_measure(values: FloatArray, groups: Sequence[str]) -> GroupMeasure:
    """Return mean and standard deviation of each group, and the p-value of Welch's test.

    Welch's t-test for two groups, and his analysis of variance for more, are valid for unequal variances
    (Welch 1951).
    The p-value is not corrected for the number of measures.

    Parameters
    ----------
    values : (M,) array
        Value of each subject; NaN is excluded.
    groups : sequence of str
        The group of each subject; those without a name are excluded.

    Raises
    ------
    InputError
        If the numbers of groups and values differ.
    """
    if len(values) != len(groups):
        raise InputError(
            f"{len(values)} values and {len(groups)} groups: give each subject one value and one group"
        )
    labels = np.array(groups, dtype=object)
    used = np.isfinite(values) & (labels != "")
    names = tuple(reference_first(labels[used].tolist()))
    values_by_group = [np.asarray(values[used & (labels == name)], np.float64) for name in names]
    return GroupMeasure(
        names,
        tuple(values_by_group),
        tuple(float(part.mean()) for part in values_by_group),
        tuple(float(part.std(ddof=1)) if len(part) > 1 else float("nan") for part in values_by_group),
        _welch_p(values_by_group),
    )


def mean_difference(first: FloatArray, second: FloatArray) -> Effect | None:
    """Return the mean of the second group minus that of the first, with Welch's interval and p.

    Parameters
    ----------
    first, second : (n,) arrays
        Values; NaN is excluded.

    Returns
    -------
    Effect or None
        The p-value is that of Welch's t-test. None if a group has fewer than two values, or neither varies.
    """
    own = [values[np.isfinite(values)] for values in (first, second)]
    if min(map(len, own)) < 2 or not sum(values.var() for values in own) > 0.0:
        return None
    test = stats.ttest_ind(own[1], own[0], equal_var=False)
    low, high = test.confidence_interval(CONFIDENCE)
    return Effect(float(own[1].mean() - own[0].mean()), float(low), float(high), float(test.pvalue))


def _welch_p(values_by_group: Sequence[FloatArray]) -> float | None:
    """Return the p-value of Welch's analysis of variance; None where a group has no variance."""
    if len(values_by_group) < 2 or any(len(part) < 2 or part.var() <= 0.0 for part in values_by_group):
        return None
    return float(stats.f_oneway(*values_by_group, equal_var=False).pvalue)
