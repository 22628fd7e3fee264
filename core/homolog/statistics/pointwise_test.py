"""Pointwise tests: one at every particle, corrected over the surface.

Each position is tested by a studentized statistic (`homolog.statistics.statistics`), which is valid
if the groups' dispersions differ. Over the surface, family-wise error is controlled by the permutation
distribution of the largest statistic (Westfall and Young 1993), and the false discovery rate by the method
of Benjamini and Hochberg (1995).
Hotelling's T² (Wilks' lambda for several columns) and its parametric p are reported in addition.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy import stats

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick
from homolog.statistics.checks import checked_particles
from homolog.statistics.design import Design
from homolog.statistics.effects import CONFIDENCE
from homolog.statistics.permutation import (
    PermutedDesigns,
    draw_permutations,
    mean_draws,
    permutation_count,
    permutation_p_value,
    subtract_rounding,
)
from homolog.statistics.statistics import (
    EqualizedSubjects,
    WelchStatistic,
    design_columns,
    equalize_groups,
    equalize_subjects,
    null_weights,
    observed_design,
    restores_mean,
    wilks_p,
)
from homolog.threads import cores, on_one_thread

__all__ = ["PointwiseStatistic", "PointwiseTest", "pointwise_test"]

_CHUNK_VALUES = 200_000
_MANY = 300
"""Number of subjects from which on several chunks of permutations are computed in parallel."""
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
        Welch's F of groups; with covariates or for a variable the ratio of the tested sum of squares to the
        one expected without an effect.
    p : (N,) array
        Permutation p of the studentized statistic at each particle, not corrected.
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
        Covariance of the effect of one tested column, from each subject's own residual (HC2) [mm²]; empty for
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


class PointwiseStatistic:
    """The statistics of every particle for any permutation of a design.

    Parameters
    ----------
    residuals : (M, N, 3) array
        Positions with the nuisance columns of the design regressed out [mm].
    design : Design
        The design whose rows are exchanged.
    scaled : bool
        Whether dispersions are equalized before subjects are exchanged; see `equalize_groups` and
        `equalize_subjects`.
    """

    def __init__(self, residuals: FloatArray, design: Design, *, scaled: bool = True) -> None:
        self._design = design
        self._white, varying = _whitened(residuals)
        self._squares = np.square(self._white).sum(axis=0)
        self.variables = int(varying.max())
        self.particles = residuals.shape[1]
        self._welch: WelchStatistic | None = None
        self._equalized: EqualizedSubjects | None = None
        rows = residuals.reshape(len(residuals), -1)
        groups = equalize_groups(rows, design, scaled=scaled)
        if groups is None and scaled:
            self._equalized = equalize_subjects(rows, design)
        if self._equalized is not None:
            self._equal = _whitened(self._equalized.values.reshape(residuals.shape))[0]
            self._equal_squares = np.square(self._equal).sum(axis=0)
        if groups is not None:
            white, varying = _whitened(groups.values.reshape(residuals.shape))
            self._welch = WelchStatistic(white, np.maximum(varying, 1.0), groups, design)

    def explained(self, permuted: PermutedDesigns) -> FloatArray:
        """Return 1 - Wilks' lambda, shape (c, N)."""
        total = self._residual_determinant(_squares(self._projections(permuted.covariates)))
        both = np.concatenate([permuted.covariates, permuted.tested], axis=2)
        error = self._residual_determinant(_squares(self._projections(both)))
        explained: FloatArray = 1.0 - np.clip(error / np.maximum(total, np.finfo(float).tiny), 0.0, 1.0)
        return explained

    def statistic(self) -> FloatArray:
        """Return the studentized statistic of the observed labels, (N,); see `PointwiseTest.studentized`."""
        original = observed_design(self._design)
        if self._welch is None:
            return np.asarray(self.studentized(original)[0])
        return np.asarray(self._welch.f(original)[0][0])

    def studentized(self, permuted: PermutedDesigns) -> FloatArray:
        """Return a statistic that is comparable between permutations and particles, shape (c, N).

        For groups the normal deviate of Welch's F, else the ratio of tested to expected sum of squares.
        """
        if self._welch is not None:
            return self._welch.deviate(permuted)
        white, squares, equalized = self._white, self._squares, self._equalized
        columns = np.concatenate([permuted.covariates, permuted.tested], axis=2)
        scale = np.ones(columns.shape[:2])
        if equalized is not None:
            white, squares = self._equal, self._equal_squares
            columns = design_columns(permuted)
            scale = equalized.dispersions(columns)
        weights = null_weights(permuted, self._design)
        crossed = np.einsum("cm,cmq,cmr->cqr", weights, columns, columns)
        first_tested = columns.shape[2] - permuted.tested.shape[2]
        columns = columns * scale[:, :, None]
        of_squares = weights * np.square(scale)
        expected = of_squares @ squares
        explained = np.zeros_like(expected)
        for axis in white:
            mean = np.zeros((1, 1))
            if equalized is not None:
                mean = equalized.random_mean(axis, permuted)
                expected += mean * (of_squares @ axis + _product(of_squares, axis, mean))
            along = [_product(column, axis, mean) for column in np.moveaxis(columns, 2, 0)]
            for item, place in enumerate(along):
                expected -= 2.0 * place * _product(weights * columns[:, :, item], axis, mean)
                for other, another in enumerate(along):
                    expected += crossed[:, item, other, None] * place * another
                if item >= first_tested:
                    explained += np.square(place)
        ratio: FloatArray = explained / np.maximum(expected, np.finfo(float).tiny)
        return np.where(explained > 0.0, ratio, 0.0)

    @property
    def restores_mean(self) -> bool:
        """Whether the statistic depends on the mean that is added to permuted values."""
        return restores_mean(self._welch, self._equalized)

    def _projections(self, columns: FloatArray) -> list[FloatArray]:
        """Inner products of the columns (c, M, q) with each whitened axis: three arrays (q, c, N)."""
        projected = np.ascontiguousarray(columns.transpose(2, 0, 1))
        return [projected @ axis for axis in self._white]

    @staticmethod
    def _residual_determinant(squares: FloatArray) -> FloatArray:
        """Return the determinant of the identity minus the explained scatter, (6, c, N) to (c, N)."""
        xx, yy, zz, xy, xz, yz = squares
        a, b, c = 1.0 - xx, 1.0 - yy, 1.0 - zz
        determinant: FloatArray = a * b * c - 2.0 * xy * xz * yz - a * yz**2 - b * xz**2 - c * xy**2
        return determinant


@on_one_thread
def pointwise_test(
    particles: FloatArray,
    design: Design,
    *,
    members: Sequence[BoolArray] = (),
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> PointwiseTest:
    """Test every particle for the effect of a design.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions, or differences of pairs [mm].
    design : Design
        The tested design.
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
    if design.error_dof < 3:
        raise InputError(
            f"pointwise tests need at least 3 degrees of freedom for the error, not {design.error_dof}; "
            "use more subjects or fewer covariates"
        )
    rows = shapes.reshape(len(shapes), -1)
    count, exact = permutation_count(design, permutations)
    statistic = PointwiseStatistic(design.residuals(rows).reshape(shapes.shape), design)
    repeats = mean_draws(design) if exact and statistic.restores_mean else 1
    original = observed_design(design)
    explained, observed = statistic.explained(original)[0], statistic.studentized(original)[0]
    largest, beyond = np.empty(count * repeats), np.zeros(len(observed), np.int64)
    limit, done = subtract_rounding(observed), 0
    chunk = max(1, _CHUNK_VALUES // (statistic.particles * (1 + design.tested.shape[1])))
    draws = draw_permutations(design, permutations, chunk=chunk, seed=seed, means=repeats > 1)
    workers = cores() if len(shapes) >= _MANY else 1
    with ThreadPoolExecutor(workers) as pool:
        while batch := list(islice(draws, workers)):
            tick(done / max(len(largest), 1), "permutations of the pointwise tests")
            for drawn in pool.map(statistic.studentized, batch):
                largest[done : done + len(drawn)] = drawn.max(axis=1)
                beyond += np.count_nonzero(drawn >= limit, axis=0)
                done += len(drawn)
    value = statistic.statistic()
    p = np.where(value > 0.0, (beyond / repeats + 1.0) / (count + 1.0), 1.0)
    return PointwiseTest(
        effect=design.coefficients(rows).reshape(-1, *shapes.shape[1:]),
        explained=explained,
        p_f=wilks_p(1.0 - explained, statistic.variables, design.tested.shape[1], design.error_dof),
        studentized=value,
        p=p,
        p_fwe=permutation_p_value(observed, largest, count),
        q=stats.false_discovery_control(p),
        permutations=count,
        variables=statistic.variables,
        **_errors(design.residuals(rows), design, members),
    )


def _product(rows: FloatArray, axis: FloatArray, mean: FloatArray) -> FloatArray:
    """Return rows (c, M) times an axis (M, N) to which a mean (c, N) is added, (c, N)."""
    product: FloatArray = rows @ axis + mean * rows.sum(axis=1)[:, None]
    return product


def _whitened(residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions of unit scatter at each particle, (3, M, N), and numbers of varying directions, (N,).

    Coordinates in flat directions are 0. 1 - lambda does not depend on the axes.
    """
    scatter = np.einsum("mni,mnj->nij", residuals, residuals)
    values, vectors = np.linalg.eigh(scatter)
    kept = values > _MIN_VARIANCE_FRACTION * max(float(values.max()), np.finfo(float).tiny)
    scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    white = np.einsum("mni,nij->jmn", residuals, vectors * scale[:, None, :])
    return np.ascontiguousarray(white), kept.sum(axis=1).astype(np.float64)


def _errors(residuals: FloatArray, design: Design, members: Sequence[BoolArray]) -> dict[str, FloatArray]:
    """Return covariance and degrees of freedom of the effect at each particle, for one tested column."""
    if design.tested.shape[1] > 1:
        return {"covariance": np.zeros((0, 3, 3)), "dof": np.zeros(0)}
    column = design.tested
    rest = (residuals - column @ (column.T @ residuals)).reshape(len(residuals), -1, 3)
    weights = null_weights(observed_design(design), design)[0] / np.square(design.columns).sum()
    covariance = np.einsum("m,mni,mnj->nij", weights, rest, rest)
    dof = np.full(rest.shape[1], float(design.error_dof))
    if members:
        each = weights[:, None] * np.square(rest).sum(axis=2)
        spread = sum(
            np.square(each[member].sum(axis=0)) / (np.count_nonzero(member) - 1.0) for member in members
        )
        whole = np.square(each.sum(axis=0))
        dof = np.clip(whole / np.maximum(spread, np.finfo(float).tiny), 1.0, float(design.error_dof))
    return {"covariance": covariance, "dof": dof}


def _squares(projected: list[FloatArray]) -> FloatArray:
    """Return xx, yy, zz, xy, xz, yz summed over columns, shape (6, c, N)."""
    x, y, z = projected
    pairs = ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z))
    return np.stack([np.einsum("qcn,qcn->cn", item, other) for item, other in pairs])
