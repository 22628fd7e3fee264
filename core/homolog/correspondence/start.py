"""What the first particles tell about a cohort, and whether the optimization improves on them."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.stats import f as f_distribution

from homolog.arrays import FloatArray
from homolog.correspondence.entropy.weight import independent_parts
from homolog.registration.entropy import covariance

__all__ = ["Start"]

CHANCE = 0.01
"""Of cohorts that are predicted equally well, the share in which the first particles count as better."""


@dataclass(frozen=True, slots=True)
class Start:
    """The first particles in numbers.

    Attributes
    ----------
    parts : float
        Of the surface that vary independently (`independent_parts`).
    left_out : float
        Variance of a left-out subject about its best fit by all modes of the others, per particle
        [squared optimizer length]; 0 with fewer than three subjects.
    """

    parts: float
    left_out: float

    @classmethod
    def of(cls, aligned: FloatArray) -> Self:
        """Return the numbers of aligned particles (M, n, 3)."""
        subjects = len(aligned)
        modes = np.linalg.eigvalsh(_covariance(aligned)).astype(np.float64)
        return cls(independent_parts(modes, subjects), _left_out(aligned))

    def is_better_than(self, aligned: FloatArray) -> bool:
        """Return whether as many aligned particles (M, n, 3) predict left-out subjects clearly worse.

        The ratio of the variances is compared with chance (F-test), in which every independent part of every
        subject counts once.
        """
        now, freedom = _left_out(aligned), self.parts * len(aligned)
        if not self.left_out > 0.0:
            return False
        return bool(f_distribution.sf(now / self.left_out, freedom, freedom) < CHANCE)


def _left_out(aligned: FloatArray) -> float:
    """Return the mean squared distance of a subject from the affine span of the others, per particle."""
    matrix, subjects = _covariance(aligned), len(aligned)
    if subjects < 3 or not np.trace(matrix) > 0.0:
        return 0.0
    inverse = np.linalg.pinv(matrix, rcond=1e-6, hermitian=True)  # the positions are of single precision
    return float((subjects - 1) * (1.0 / np.diag(inverse)).mean())


def _covariance(aligned: FloatArray) -> FloatArray:
    rows = aligned.reshape(len(aligned), -1)
    return covariance(rows - rows.mean(axis=0))
