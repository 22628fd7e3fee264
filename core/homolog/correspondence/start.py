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
    variance : float
        Of a subject about the mean, per particle [squared optimizer length].
    left_out : float
        The same of a left-out subject about its best fit by all modes of the others; 0 with fewer than three.
    """

    parts: float
    variance: float
    left_out: float

    @classmethod
    def of(cls, aligned: FloatArray) -> Self:
        """Return the numbers of aligned particles (M, n, 3)."""
        matrix = _covariance(aligned)
        modes = np.linalg.eigvalsh(matrix).astype(np.float64)
        return cls(independent_parts(modes, len(aligned)), float(np.trace(matrix)), _left_out(matrix))

    def is_better_than(self, aligned: FloatArray) -> bool:
        """Return whether as many aligned particles (M, n, 3) are clearly noisier.

        They are if both variances have grown by more than chance (F-test), in which every independent part of
        every subject counts once.
        """
        now, freedom = Start.of(aligned), self.parts * len(aligned)
        if not self.left_out > 0.0:
            return False
        ratios = now.variance / self.variance, now.left_out / self.left_out
        return bool(f_distribution.sf(min(ratios), freedom, freedom) < CHANCE)


def _left_out(matrix: FloatArray) -> float:
    """Return the mean squared distance of a subject from the affine span of the others, per particle."""
    if len(matrix) < 3 or not np.trace(matrix) > 0.0:
        return 0.0
    inverse = np.linalg.pinv(matrix, rcond=1e-6, hermitian=True)  # the positions are of single precision
    return float((len(matrix) - 1) * (1.0 / np.diag(inverse)).mean())


def _covariance(aligned: FloatArray) -> FloatArray:
    rows = aligned.reshape(len(aligned), -1)
    return covariance(rows - rows.mean(axis=0))
