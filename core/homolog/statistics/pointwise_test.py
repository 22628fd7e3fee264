"""Pointwise tests: one at every particle, corrected over the surface.

Each position is tested in all directions by a Wald statistic, studentized by the covariance that subjects
show (`homolog.statistics.randomization`), so that dispersions may differ in amount and pattern. Over the
surface, family-wise error is controlled by the null distribution of the largest statistic (Westfall and Young
1993), and the false discovery rate by the method of Benjamini and Hochberg (1995).
Hotelling's T² (Wilks' lambda for several columns) and its parametric p are reported in addition.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick
from homolog.statistics.checks import checked_particles
from homolog.statistics.design import Hypothesis
from homolog.statistics.effects import CONFIDENCE, degrees, unit_parts
from homolog.statistics.randomization import Randomization
from homolog.statistics.wilks import wilks_p

__all__ = ["PointwiseTest", "pointwise_test"]

_MIN_VARIANCE_FRACTION = 1e-12
"""Directions at a particle with less than this fraction of the largest variance do not vary."""


@dataclass(frozen=True, slots=True, eq=False)
class PointwiseTest:
    """Tests at each particle. Arrays are read-only.

    Attributes
    ----------
    effect : (d, N, 3) array
        Coefficients of the tested columns: group differences, or change per unit [mm].
    explained : (N,) array
        1 - Wilks' lambda: share of variance explained, in [0, 1].
    p_f : (N,) array
        Parametric p of Hotelling's T², not corrected; for groups it assumes equal covariances.
    studentized : (N,) array
        Wald statistic: the effect, squared by the inverse of its covariance (HC2).
    p : (N,) array
        Randomization p of the Wald statistic at each particle, not corrected.
    p_fwe : (N,) array
        FWE-corrected p: probability of a statistic this large at any particle of the surface without an
        effect.
    q : (N,) array
        False discovery rate at which the particle is significant (Benjamini and Hochberg).
    permutations : int
        Number of permutations.
    variables : int
        Number of directions in which a particle varies, at most 3.
    covariance : (N, 3, 3) array
        Covariance of the effect of one tested column, from each subject's own residual (HC4; for
        groups Welch's) [mm²]; empty for
        several columns.
    dof : (N,) array
        Degrees of freedom of `covariance`.
    """

    effect: FloatArray
    explained: FloatArray
    p_f: FloatArray
    studentized: FloatArray
    p: FloatArray
    p_fwe: FloatArray
    q: FloatArray
    permutations: int
    variables: int
    covariance: FloatArray
    dof: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("effect", "explained", "p_f", "studentized", "p", "p_fwe", "q", "covariance", "dof"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    def bounds(self, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the 95 % interval of the effect along unit directions (N, 3) [mm], each (N,).

        The intervals of the particles are separate and not corrected over the surface.
        """
        along = np.einsum("ni,ni->n", self.effect[0], directions)
        error = np.sqrt(np.einsum("ni,nij,nj->n", directions, self.covariance, directions))
        reach = stats.t.ppf((1.0 + CONFIDENCE) / 2.0, self.dof) * error
        return along - reach, along + reach


def pointwise_test(
    particles: FloatArray,
    hypothesis: Hypothesis,
    *,
    members: Sequence[BoolArray] = (),
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> PointwiseTest:
    """Test every particle for the effect of a hypothesis.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions, or differences of pairs [mm].
    hypothesis : Hypothesis
        What is tested.
    members : sequence of (M,) bool arrays, optional
        The groups, without covariates: intervals then have the degrees of freedom of Welch (1947).
    permutations : int
        Number of permutations for the correction over the surface.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    PointwiseTest

    Raises
    ------
    InputError
        If there are too few subjects to test a position in three dimensions.
    """
    shapes = checked_particles(particles)
    if hypothesis.error_dof < 3:
        raise InputError(
            f"pointwise tests need at least 3 degrees of freedom for the error, not {hypothesis.error_dof}; "
            "use more subjects or fewer covariates"
        )
    rows = shapes.reshape(len(shapes), -1)
    residuals = hypothesis.residuals(rows).reshape(shapes.shape)
    explained, variables = _explained(residuals, hypothesis)
    tested = Randomization(hypothesis, rows, draws=permutations, seed=seed, tick=tick).surface(shapes)
    return PointwiseTest(
        effect=hypothesis.coefficients(rows).reshape(-1, *shapes.shape[1:]),
        explained=explained,
        p_f=wilks_p(1.0 - explained, variables, hypothesis.tested.shape[1], hypothesis.error_dof),
        studentized=tested.statistic,
        p=tested.p,
        p_fwe=tested.p_fwe,
        q=stats.false_discovery_control(tested.p),
        permutations=tested.count,
        variables=variables,
        **_errors(residuals, hypothesis, members),
    )


def _explained(residuals: FloatArray, hypothesis: Hypothesis) -> tuple[FloatArray, int]:
    """Return 1 - Wilks' lambda at each particle, (N,), and the number of directions that vary."""
    scatter = np.einsum("mni,mnj->nij", residuals, residuals)
    values, vectors = np.linalg.eigh(scatter)
    kept = values > _MIN_VARIANCE_FRACTION * max(float(values.max()), np.finfo(float).tiny)
    scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    along = np.einsum("md,mnj->ndj", hypothesis.tested, residuals)
    white = np.einsum("ndi,nij->ndj", along, vectors * scale[:, None, :])
    left = np.eye(3) - np.einsum("ndi,ndj->nij", white, white)
    return 1.0 - np.clip(np.linalg.det(left), 0.0, 1.0), int(kept.sum(axis=1).max())


def _errors(
    residuals: FloatArray, hypothesis: Hypothesis, members: Sequence[BoolArray]
) -> dict[str, FloatArray]:
    """Return covariance and degrees of freedom of the effect at each particle, for one tested column."""
    if hypothesis.tested.shape[1] > 1:
        return {"covariance": np.zeros((0, 3, 3)), "dof": np.zeros(0)}
    flat = residuals.reshape(len(residuals), -1)
    parts = unit_parts(flat, hypothesis, members).reshape(hypothesis.n_units, -1, 3)
    parts = parts / np.linalg.norm(hypothesis.columns)
    covariance = np.einsum("uni,unj->nij", parts, parts)
    return {"covariance": covariance, "dof": degrees(np.square(parts).sum(axis=2), hypothesis, members)}
