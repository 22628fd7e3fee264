"""Whether sizes or shapes are skewed, which tests of means of few and unequal groups do not bear."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.analysis.design import Design, Exchange
from homolog.analysis.shape_model import leading_scores
from homolog.arrays import BoolArray, FloatArray

__all__ = ["SizeSkewness", "size_skewness"]

_FEWEST = 8
"""Subjects below which the test is not defined."""
_MODES = 5


@dataclass(frozen=True, slots=True)
class SizeSkewness:
    """Skewness of sizes and shapes within groups.

    Attributes
    ----------
    value : float
        Skewness of the residuals, each divided by the standard deviation of its group.
    p : float
        Of the test that sizes are not skewed (D'Agostino 1970).
    shape_p : float
        Of the test that scores in the five leading modes are not skewed: their squared deviates, summed.
    deviations : dict
        Standard deviation of size in each group [mm]; empty for pairs.
    """

    value: float
    p: float
    shape_p: float
    deviations: dict[str, float]


def size_skewness(
    size: FloatArray, shapes: FloatArray, design: Design, members: Mapping[str, BoolArray]
) -> SizeSkewness | None:
    """Test whether sizes and shapes are skewed within groups; None for a variable or under eight subjects.

    Few sizes seldom show that they are skewed. Shapes, of which they are a part, show it more often.

    Parameters
    ----------
    size : (M,) array
        Size of each subject, or the differences of pairs [mm].
    shapes : (M, N, 3) array
        Aligned positions, or the differences of pairs [mm].
    design : Design
        What is tested.
    members : mapping of str to (M,) bool arrays
        Who is in each group; empty for pairs and for a variable.
    """
    paired = design.exchange is Exchange.SIGNS
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


def _within(values: FloatArray, design: Design) -> FloatArray:
    """Return what design and tested effect leave of values (M, P)."""
    residuals = design.residuals(values)
    residuals -= design.tested @ (design.tested.T @ residuals)
    return residuals


def _shape_p(residuals: FloatArray, members: Mapping[str, BoolArray]) -> float:
    for own in members.values():
        residuals[own] /= max(float(np.sqrt(np.square(residuals[own]).mean())), np.finfo(float).tiny)
    scores, _ = leading_scores(residuals, _MODES)
    deviates = stats.skewtest(scores[:, scores.std(axis=0) > 0.0], axis=0).statistic
    return float(stats.chi2.sf(np.square(deviates).sum(), max(len(deviates), 1)))
