"""A measure of the subjects by group: means, and whether they differ."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray
from homolog.errors import InputError

__all__ = ["GroupMeasure", "compare_measure"]


@dataclass(frozen=True, slots=True)
class GroupMeasure:
    """A measure by group.

    Attributes
    ----------
    groups : tuple of str
        Their names, sorted.
    counts : tuple of int
        Subjects with a value.
    means, deviations : tuple of float
        Mean and standard deviation of each group, in the measure's unit; not a number for a single subject.
    p : float or None
        Two-sided p-value of equal means; None if it can't be tested.
    """

    groups: tuple[str, ...]
    counts: tuple[int, ...]
    means: tuple[float, ...]
    deviations: tuple[float, ...]
    p: float | None


def compare_measure(values: FloatArray, groups: Sequence[str]) -> GroupMeasure:
    """Return mean and standard deviation of each group, and the p-value of Welch's test.

    Welch's t-test for two groups, and his analysis of variance for more, hold when variances differ
    (Welch 1951).
    The p-value is not corrected for the number of measures.

    Parameters
    ----------
    values : (M,) array
        One for each subject; those that are not numbers are excluded.
    groups : sequence of str
        The group of each subject; those without a name are excluded.

    Raises
    ------
    InputError
        If there are not as many groups as values.
    """
    if len(values) != len(groups):
        raise InputError(f"{len(values)} values and {len(groups)} groups: give each subject one of both")
    labels = np.array(groups, dtype=object)
    used = np.isfinite(values) & (labels != "")
    names = tuple(sorted(set(labels[used].tolist())))
    values_by_group = [np.asarray(values[used & (labels == name)], np.float64) for name in names]
    return GroupMeasure(
        names,
        tuple(len(part) for part in values_by_group),
        tuple(float(part.mean()) for part in values_by_group),
        tuple(float(part.std(ddof=1)) if len(part) > 1 else float("nan") for part in values_by_group),
        _welch_p(values_by_group),
    )


def _welch_p(values_by_group: Sequence[FloatArray]) -> float | None:
    """Return the p-value of Welch's analysis of variance; None where a group has no variance."""
    if len(values_by_group) < 2 or any(len(part) < 2 or part.var() <= 0.0 for part in values_by_group):
        return None
    return float(stats.f_oneway(*values_by_group, equal_var=False).pvalue)
