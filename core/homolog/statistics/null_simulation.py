"""Type I error rate of each test on the user's own cohort, estimated with permuted labels.

Labels are exchanged, so that every subject is equally likely in each group. The rates of permutation tests
are therefore 5 % by construction and verify the computation. Only the rates of parametric tests depend on the
cohort, such as on deviations from the normal distribution. No rate shows the effect of groups with different
dispersions; `homolog.statistics.assumptions` tests for them.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray
from homolog.progress import Tick, no_tick
from homolog.statistics.checks import checked_particles
from homolog.statistics.design import Design
from homolog.statistics.mode_test import ModeStatistic
from homolog.statistics.permutation import draw_permutations, permutation_count, permutation_p_value
from homolog.statistics.pointwise_test import PointwiseStatistic
from homolog.statistics.statistics import wilks_p
from homolog.threads import on_one_thread

__all__ = ["WHOLE_SHAPE_F", "WHOLE_SHAPE_PERMUTATION", "FalsePositives", "null_simulation"]

WHOLE_SHAPE_F = "whole shape, F distribution"
WHOLE_SHAPE_PERMUTATION = "whole shape, permutation (5 % by construction)"
_FAMILY_WISE = "any particle, family-wise correction (5 % by construction)"
_NOT_CORRECTED = "any particle, F distribution, not corrected"

_CHUNK = 100


@dataclass(frozen=True, slots=True)
class FalsePositives:
    """False positives of one test under permuted labels: its type I error rate.

    Attributes
    ----------
    test : str
        Description of the test and its correction.
    false_positives : int
        Number of permutations in which the test was significant.
    repeats : int
        Number of permutations.
    low, high : float
        95 % confidence bounds of the rate (Clopper and Pearson 1934).
    """

    test: str
    false_positives: int
    repeats: int
    low: float
    high: float

    @property
    def rate(self) -> float:
        """Type I error rate: fraction of permutations with a false positive."""
        return self.false_positives / self.repeats


@on_one_thread
def null_simulation(
    particles: FloatArray,
    design: Design,
    *,
    modes: int,
    repeats: int = 1000,
    permutations: int = 10_000,
    alpha: float = 0.05,
    seed: int = 0,
    tick: Tick = no_tick,
) -> tuple[FalsePositives, ...]:
    """Permute the labels many times and count how often each test is significant.

    The permutation tests share one separate set of permutations for their null distribution: without
    covariates this distribution is the same for all permuted labels.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions, or differences of pairs [mm].
    design : Design
        The tested design.
    modes : int
        Number of modes of the test of whole shapes, at least 1.
    repeats : int
        Number of permutations that are tested like the observed labels.
    permutations : int
        Number of permutations for the null distribution of the permutation tests.
    alpha : float
        Nominal significance level of each test.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    tuple of FalsePositives
    """
    shapes = checked_particles(particles)
    residuals = design.residuals(shapes.reshape(len(shapes), -1))
    whole = ModeStatistic(residuals, design, modes, scaled=False)
    local = PointwiseStatistic(residuals.reshape(shapes.shape), design, scaled=False)
    count, _ = permutation_count(design, permutations)
    reference, reference_largest = np.empty(count), np.empty(count)
    total, done = count + repeats, 0
    for draws in draw_permutations(design, permutations, chunk=_CHUNK, seed=seed):
        tick(done / total, "null simulation: permutation distribution")
        rows = slice(done, done + len(draws.tested))
        reference[rows] = whole.studentized(draws)
        reference_largest[rows] = local.studentized(draws).max(axis=1)
        done = rows.stop
    names = (WHOLE_SHAPE_F, WHOLE_SHAPE_PERMUTATION, _FAMILY_WISE, _NOT_CORRECTED)
    false_positives = np.zeros(len(names), np.int64)
    for draws in draw_permutations(design, repeats, chunk=_CHUNK, seed=seed + 1, exhaustive=False):
        tick(done / total, "null simulation: type I error rates")
        explained = local.explained(draws)
        p = wilks_p(1.0 - explained, local.variables, design.tested.shape[1], design.error_dof)
        p_values = (
            np.exp(whole.log_p(draws)),
            permutation_p_value(whole.studentized(draws), reference),
            permutation_p_value(local.studentized(draws).max(axis=1), reference_largest),
            p.min(axis=1),
        )
        false_positives += [np.count_nonzero(values <= alpha) for values in p_values]
        done += len(draws.tested)
    return tuple(
        _false_positives(name, int(count), repeats)
        for name, count in zip(names, false_positives, strict=True)
    )


def _false_positives(test: str, false_positives: int, repeats: int) -> FalsePositives:
    bounds = stats.binomtest(false_positives, repeats).proportion_ci(0.95, method="exact")
    return FalsePositives(test, false_positives, repeats, float(bounds.low), float(bounds.high))
