"""The weight of H(Z), derived for each cohort.

The sampling entropy of a shape is low where its particles are spread evenly, so that corresponding parts of
all shapes have the same share of the surface. True homologues don't: the logarithm of a part's share varies
between subjects, with standard deviation s. So -H(P), which is half its mean square per particle, is to the
logarithm of a probability as s² to the number of parts that vary independently, R:

    - log p = R / s² (-H(P)) + 1/2 sum over the modes of log(variance)  =  R / s² (-H(P) + s² / R H(Z)).

The fewer parts vary independently, the more particles a mode moves together, and the better the modes are
known. R is that of the deviations of the first particles from the mean shape (`independent_parts`).
"""

import numpy as np

from homolog.arrays import FloatArray
from homolog.settings import OptimizeSettings

__all__ = ["independent_parts", "weighted", "with_weight"]

AREA_VARIATION = 0.2
"""Standard deviation of the logarithm of a part's share of the surface. On 19 cohorts of known correspondence
it is 0.05 to 0.28 (256 parts)."""


def independent_parts(variances: FloatArray, subjects: int) -> float:
    """Return how many parts of a surface vary independently: (tr S)² / tr S², without bias.

    Parameters
    ----------
    variances : (r,) array
        Variances along all modes.
    subjects : int
        Of which they are; both traces are corrected for few of them (Bai and Saranadasa 1996). Two subjects
        have one mode, which doesn't tell.

    Returns
    -------
    float
        At least one.
    """
    freedom = subjects - 1
    total, squares = float(np.sum(variances)) ** 2, float(np.square(variances).sum())
    of_all = (freedom + 1) * total - 2.0 * squares
    of_squares = freedom * squares - total
    if freedom < 2 or not of_all > 0.0:
        return 1.0
    return max(1.0, of_all / max(of_squares, 1e-9 * of_all))


def weighted(settings: OptimizeSettings, variances: FloatArray, subjects: int) -> OptimizeSettings:
    """Return settings with the weight of H(Z) derived for shapes of these modes, unless they have one.

    Parameters
    ----------
    settings : OptimizeSettings
    variances, subjects
        See `independent_parts`.
    """
    return with_weight(settings, independent_parts(variances, subjects))


def with_weight(settings: OptimizeSettings, parts: float) -> OptimizeSettings:
    """Return settings with the weight of H(Z) for a number of independent parts, unless they have one."""
    if settings.ensemble_weight is not None:
        return settings
    return settings.model_copy(update={"ensemble_weight": AREA_VARIATION**2 / parts})
