"""Percentiles of a patient's values among the controls."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray

__all__ = ["Percentile", "percentile"]


@dataclass(frozen=True, slots=True)
class Percentile:
    """A value among the leave-one-out values of M controls.

    Attributes
    ----------
    value : float
        Value of the patient.
    percent : float
        Share of the controls with lower values [%].
    low, high : float
        95 % confidence interval of that share in the population [%] (Clopper and Pearson 1934).
    p : float
        Probability that a control's value is at least as extreme, ``(1 + number as extreme) / (M + 1)``.
    """

    value: float
    percent: float
    low: float
    high: float
    p: float


def percentile(value: float, controls: FloatArray, *, both_sides: bool = False) -> Percentile:
    """Return the percentile of a value among those of the controls (M,).

    Parameters
    ----------
    value : float
    controls : (M,) array
    both_sides : bool
        Whether low values are as unusual as high ones.
    """
    count, below = len(controls), int(np.count_nonzero(controls < value))
    low = float(stats.beta.ppf(0.025, below, count - below + 1)) if below else 0.0
    high = float(stats.beta.ppf(0.975, below + 1, count - below)) if below < count else 1.0
    above = int(np.count_nonzero(controls >= value))
    p = (1 + above) / (count + 1)
    if both_sides:
        at_most = int(np.count_nonzero(controls <= value))
        p = min(1.0, 2.0 * min(p, (1 + at_most) / (count + 1)))
    return Percentile(value, 100.0 * below / count, 100.0 * low, 100.0 * high, p)
