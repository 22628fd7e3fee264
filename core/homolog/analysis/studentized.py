"""The statistic of all permutation tests: a Brown-Forsythe ratio, which holds when dispersions differ.

The sum of squares of the tested effect is divided by what it would be on average without an effect, given
each subject's own residual. For groups this is the statistic of Brown and Forsythe (1974), for two groups
the square of Welch's t (1947), summed over standardized coordinates (Alekseyenko 2016); for a continuous
variable and for covariates variances are those of MacKinnon and White's HC2 (1985). The permutation of
studentized statistics is asymptotically valid also if dispersions differ (Janssen 1997, Chung and Romano
2013), and exact if they do not.
"""

import numpy as np

from homolog.analysis.design import Design
from homolog.analysis.permutation import Relabelling
from homolog.arrays import FloatArray

__all__ = ["identity", "null_weights", "studentized_ratio"]

_LEAST_ROOM = 1e-6
"""A residual is divided by no less than this: with a leverage of one it is zero."""


def identity(design: Design) -> Relabelling:
    """Return the real labels as a relabelling."""
    return Relabelling(design.tested[None], design.covariates[None])


def null_weights(relabelling: Relabelling, design: Design) -> FloatArray:
    """Return what each subject's squared residual adds to the expected sum of squares, shape (c, M).

    This is the leverage of the tested columns divided by what all columns leave of the subject's variance.
    """
    tested = np.square(relabelling.tested).sum(axis=2)
    taken = tested + np.square(relabelling.covariates).sum(axis=2)
    if design.nuisance.shape[1]:
        taken = taken + 1.0 / len(design.tested)
    weights: FloatArray = tested / np.maximum(1.0 - taken, _LEAST_ROOM)
    return weights


def studentized_ratio(scores: FloatArray, relabelling: Relabelling, design: Design) -> FloatArray:
    """Return the ratio of tested to expected sum of squares of each relabelling, shape (c,).

    Parameters
    ----------
    scores : (M, k) or (c, M, k) array
        Standardized coordinates with the (relabelled) nuisance columns regressed out.
    relabelling : Relabelling
        Of c designs.
    design : Design
        The design that was relabelled.
    """
    projected = np.swapaxes(relabelling.tested, 1, 2) @ scores
    rest = np.square(scores - relabelling.tested @ projected).sum(axis=2)
    expected = (null_weights(relabelling, design) * rest).sum(axis=1)
    explained = np.square(projected).sum(axis=(1, 2))
    ratio: FloatArray = explained / np.maximum(expected, np.finfo(float).tiny)
    return ratio
