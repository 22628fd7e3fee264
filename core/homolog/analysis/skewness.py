"""Whether sizes are skewed, which tests of means of few and unequal groups do not bear."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.analysis.design import Design, Exchange
from homolog.arrays import BoolArray, FloatArray

__all__ = ["SizeSkewness", "size_skewness"]

_FEWEST = 8
"""Subjects below which the test is not defined."""


@dataclass(frozen=True, slots=True)
class SizeSkewness:
    """Skewness of the sizes within groups.

    Attributes
    ----------
    value : float
        Skewness of the residuals, each divided by the standard deviation of its group.
    p : float
        Of the test that they are not skewed (D'Agostino 1970).
    deviations : dict
        Standard deviation of size in each group [mm]; empty for pairs.
    """

    value: float
    p: float
    deviations: dict[str, float]


def size_skewness(size: FloatArray, design: Design, members: Mapping[str, BoolArray]) -> SizeSkewness | None:
    """Test whether sizes are skewed within groups; None for a variable, or fewer than eight subjects.

    Parameters
    ----------
    size : (M,) array
        Size of each subject, or the differences of pairs [mm].
    design : Design
        What is tested.
    members : mapping of str to (M,) bool arrays
        Who is in each group; empty for pairs and for a variable.
    """
    paired = design.exchange is Exchange.SIGNS
    if len(size) < _FEWEST or not (paired or members):
        return None
    residuals = design.residuals(size[:, None])
    residuals = (residuals - design.tested @ (design.tested.T @ residuals))[:, 0]
    deviations = {name: float(residuals[own].std(ddof=1)) for name, own in members.items()}
    scale = np.ones(len(size))
    for name, own in members.items():
        scale[own] = deviations[name]
    if residuals.std() <= 1e-9 * max(float(np.abs(size).max()), 1e-300) or scale.min() <= 0.0:
        return None
    standard = residuals / scale
    return SizeSkewness(float(stats.skew(standard)), float(stats.skewtest(standard).pvalue), deviations)
