"""The test of whole shapes in the modes that parallel analysis retains.

The p-value to trust is that of the permutation of a studentized statistic (`homolog.analysis.statistics`),
which holds when the groups' covariances differ. Hotelling's T², Wilks' lambda and F are reported with it.

The modes are those of the data with covariates regressed out but with the tested effect still in, so they
don't depend on the labels. For normal data the subjects' scores, scaled to unit variance, are then a
uniformly distributed orthonormal frame whatever the variances of the modes are: choosing modes by their
variance costs nothing. F is exact for normal data of equal covariance, and so is the permutation p for any
exchangeable data.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.analysis.checks import checked_particles
from homolog.analysis.design import Design, Exchange
from homolog.analysis.parallel import Null, ParallelAnalysis, parallel_analysis
from homolog.analysis.permutation import (
    PermutedDesigns,
    null_distribution,
    permutation_count,
    permutation_p_value,
)
from homolog.analysis.shape_model import leading_scores
from homolog.analysis.statistics import (
    EqualizedAlong,
    WelchStatistic,
    equalize_along,
    equalize_groups,
    hotelling,
    observed_design,
    rao_f,
    studentized_ratio,
    wilks_p,
)
from homolog.arrays import FloatArray, IntArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.threads import on_one_thread

__all__ = ["ModeStatistic", "ModeTest", "mode_test"]

_CHUNK = 500
_CHUNK_VALUES = 4_000_000
_MANY = 300
"""Subjects from which shapes are reduced to the leading modes and `_FURTHER` after them."""
_FURTHER = 24
_MIN_DOF_PER_MODE = 3
"""Degrees of freedom of the error for each mode below which a test is said to have low power."""


@dataclass(frozen=True, slots=True)
class ModeTest:
    """Result of a test of whole shapes.

    Attributes
    ----------
    modes : int
        Number of modes tested in, retained by parallel analysis or given.
    wilks : float
        Wilks' lambda: share of the generalised variance that the tested effect leaves unexplained.
    pillai : float
        Pillai's trace.
    t_squared : float or None
        Hotelling's T², for one tested column (two groups, a continuous variable, pairs).
    mahalanobis : float or None
        Effect size for one tested column: length of its coefficient in units of the standard deviation
        within groups; for two groups the distance of their means.
    f, dof : float, (float, float)
        F statistic and its degrees of freedom; for Wilks' lambda of more than two modes and columns Rao's
        approximation. Both 0 if no mode is retained.
    p : float
        Parametric p-value of F; of groups it needs equal covariances.
    studentized : float
        Welch's F of groups in standardized modes; with covariates or for a variable the ratio of the tested
        sum of squares to the one expected without an effect.
    p_permutation : float
        Share of the permutations whose studentized statistic, with modes chosen again, is as large.
    permutations : int
        Number of permutations.
    exact : bool
        Whether these are all different permutations that there are.
    parallel : ParallelAnalysis
        The choice of modes.
    warnings : tuple of str
        What to be careful about, in sentences.
    """

    modes: int
    wilks: float
    pillai: float
    t_squared: float | None
    mahalanobis: float | None
    f: float
    dof: tuple[float, float]
    p: float
    studentized: float
    p_permutation: float
    permutations: int
    exact: bool
    parallel: ParallelAnalysis
    warnings: tuple[str, ...]


class ModeStatistic:
    """The statistic of one data set for any permutation of its design.

    Parameters
    ----------
    residuals : (M, P) array
        Data with the nuisance columns of the design regressed out.
    design : Design
        Whose rows are exchanged.
    n_modes : int
        Modes of the test, where they are not chosen again.
    threshold : (K,) array or None
        Variances above which a mode is retained; None tests in the first `n_modes` modes always.
    scaled : bool
        Whether the dispersions of groups, or along a variable, are equalized before subjects are exchanged;
        see `equalize_groups` and `equalize_along`. The modes of the permutation statistic are then those of
        the equalized shapes.
    """

    def __init__(
        self,
        residuals: FloatArray,
        design: Design,
        n_modes: int,
        threshold: FloatArray | None,
        *,
        scaled: bool = True,
    ) -> None:
        self._design = design
        self._many = len(residuals) > _MANY
        rows = leading_scores(residuals, n_modes + _FURTHER)[0] if self._many else residuals
        self._rows = rows
        self._gram = rows.T @ rows if self._many else rows @ rows.T
        self._n_modes = n_modes
        self._dof = len(residuals) - design.nuisance.shape[1]
        self._threshold = None if threshold is None else threshold * self._dof
        self._frame = _unit_columns(rows) if self._many else self._decomposed(self._gram)[0]
        self._welch: WelchStatistic | None = None
        self._along: EqualizedAlong | None = None
        groups = equalize_groups(residuals, design, scaled=scaled)
        if groups is not None and n_modes:
            coordinates = self._modes_of(groups.values).T[:, :, None]
            self._welch = WelchStatistic(coordinates, np.array([float(n_modes)]), groups, design)
        elif groups is None and scaled and n_modes:
            self._along = equalize_along(residuals, design)
            if self._along is not None:
                self._equalized = self._modes_of(self._along.values)

    def projections(self, permuted: PermutedDesigns) -> tuple[FloatArray, IntArray]:
        """Return the tested columns in the modes, (c, d, K) with zeros from mode k on, and k (c,).

        Without covariates the modes are the same for all permutations. With covariates the data change
        (their permuted residuals are regressed on the covariates again), and so modes are chosen again.
        """
        scores, modes = self._scores(permuted)
        return np.swapaxes(permuted.tested, 1, 2) @ scores, modes

    def scores(self, modes: int) -> FloatArray:
        """Return the subjects' scores in the first modes, shape (M, modes), columns of length 1."""
        return self._frame[:, :modes]

    def _scores(self, permuted: PermutedDesigns) -> tuple[FloatArray, IntArray]:
        """Return the subjects' standardized scores (M, k) or (c, M, K), zero from mode k on, and k (c,)."""
        if permuted.covariates.shape[2] == 0:
            return self._frame[:, : self._n_modes], np.full(len(permuted.tested), self._n_modes)
        covariates = permuted.covariates
        across = np.swapaxes(covariates, 1, 2)
        if self._many:
            along = across @ self._rows
            vectors, squares = self._decomposed(self._gram - np.swapaxes(along, 1, 2) @ along)
        else:
            gram = self._gram - covariates @ (across @ self._gram)
            gram = gram - (gram @ covariates) @ across
            vectors, squares = self._decomposed(gram)
        modes = np.full(len(vectors), self._n_modes)
        if self._threshold is not None:
            threshold = self._threshold[: squares.shape[1]]
            above = squares[:, : len(threshold)] > threshold
            modes = np.where(above.all(axis=1), above.shape[1], above.argmin(axis=1))
        frames = vectors[:, :, : max(int(modes.max()), 1)]
        if self._many:
            frames = _unit_columns(self._rows @ frames - covariates @ (along @ frames))
        return frames * (np.arange(frames.shape[2]) < modes[:, None, None]), modes

    def log_p(self, permuted: PermutedDesigns) -> FloatArray:
        """Return the logarithm of the parametric p-value of each permutation, shape (c,)."""
        projected, modes = self.projections(permuted)
        return _log_p(_wilks(projected), modes, self._design)

    def statistic(self) -> float:
        """Return the studentized statistic of the observed labels; see `ModeTest.studentized`."""
        original = observed_design(self._design)
        if self._welch is not None:
            return float(self._welch.f(original)[0][0, 0])
        if self._n_modes == 0:
            return 0.0
        if self._along is not None:
            return float(self.studentized(original)[0])
        return float(studentized_ratio(self.scores(self._n_modes), original, self._design)[0])

    def studentized(self, permuted: PermutedDesigns) -> FloatArray:
        """Return a statistic that is comparable between permutations, shape (c,); 0 without a mode.

        For groups the normal deviate of Welch's F, else the studentized ratio. Where modes are chosen again
        it is the quantile that the ratio is among F ratios of so many modes, so that permutations with more
        and with fewer modes can be compared.
        """
        if self._welch is not None:
            return self._welch.deviate(permuted)[:, 0]
        if self._along is not None:
            restored = self._along.restored(self._equalized, permuted)
            return studentized_ratio(restored, permuted, self._design)
        scores, modes = self._scores(permuted)
        ratio = studentized_ratio(scores, permuted, self._design)
        if permuted.covariates.shape[2]:
            across = self._design.tested.shape[1] * np.maximum(modes, 1)
            within = self._design.error_dof * np.maximum(modes, 1)
            ratio = -np.log(np.maximum(stats.f.sf(ratio, across, within), np.finfo(float).tiny))
        return np.where(modes > 0, ratio, 0.0)

    def _modes_of(self, rows: FloatArray) -> FloatArray:
        """Return the scores of rows (M, P) in their leading modes, (M, n_modes), columns of length 1."""
        if self._many:
            return _unit_columns(leading_scores(rows, self._n_modes)[0])
        return self._decomposed(rows @ rows.T)[0][:, : self._n_modes]

    def _decomposed(self, gram: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Left singular vectors as columns, and squared singular values, largest first."""
        squares, vectors = np.linalg.eigh(gram)
        return vectors[..., ::-1], squares[..., ::-1]


@on_one_thread
def mode_test(
    particles: FloatArray,
    design: Design,
    *,
    modes: int | None = None,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> ModeTest:
    """Test the whole shape for the effect of a design.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions, or differences of pairs [mm].
    design : Design
        What is tested.
    modes : int, optional
        Number of modes; chosen by parallel analysis if not given.
    permutations : int
        Permutations for the permutation p-value.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    ModeTest

    Raises
    ------
    InputError
        If there are more modes than degrees of freedom.
    """
    shapes = checked_particles(particles)
    residuals = design.residuals(shapes.reshape(len(shapes), -1))
    null = Null.SIGNS if design.exchange is Exchange.SIGNS else Null.PERMUTATION
    parallel = parallel_analysis(
        residuals, nuisance=design.nuisance, null=null, seed=seed, tick=part_of(tick, 0.0, 0.3)
    )
    n_modes = parallel.n_retained if modes is None else modes
    _check_modes(n_modes, design, len(parallel.eigenvalues))
    count, exact = permutation_count(design, permutations)
    threshold = parallel.threshold if modes is None else None
    statistic = ModeStatistic(residuals, design, n_modes, threshold, scaled=not exact)
    original = observed_design(design)
    projected, _ = statistic.projections(original)
    wilks = float(_wilks(projected)[0])
    null_statistics = null_distribution(
        statistic.studentized,
        design,
        permutations,
        chunk=max(1, min(_CHUNK, _CHUNK_VALUES // (len(shapes) * max(n_modes, 1)))),
        seed=seed,
        tick=part_of(tick, 0.3, 1.0),
        message="permutations of the whole shape",
    )
    observed = _log_p(np.array([wilks]), np.array([n_modes]), design)
    columns = design.tested.shape[1]
    f, between, within = (
        float(value) for value in rao_f(np.array(wilks), max(n_modes, 1), columns, design.error_dof)
    )
    t_squared = float(hotelling(wilks, design.error_dof)) if columns == 1 else None
    return ModeTest(
        modes=n_modes,
        wilks=wilks,
        pillai=float(np.square(projected).sum()),
        t_squared=t_squared,
        mahalanobis=None if t_squared is None else float(np.sqrt(t_squared) / np.linalg.norm(design.columns)),
        f=f if n_modes else 0.0,
        dof=(between, within) if n_modes else (0.0, 0.0),
        p=float(np.exp(observed[0])),
        studentized=statistic.statistic(),
        p_permutation=float(permutation_p_value(statistic.studentized(original), null_statistics)[0]),
        permutations=count,
        exact=exact,
        parallel=parallel,
        warnings=_warnings(n_modes, design),
    )


def _unit_columns(columns: FloatArray) -> FloatArray:
    """Return columns (..., M, K) of length 1; zeros stay zeros."""
    lengths = np.linalg.norm(columns, axis=-2, keepdims=True)
    unit: FloatArray = columns / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _wilks(projected: FloatArray) -> FloatArray:
    """Wilks' lambda (c,) from the tested columns in the modes (c, d, K)."""
    left = np.eye(projected.shape[1]) - projected @ np.swapaxes(projected, 1, 2)
    wilks: FloatArray = np.clip(np.linalg.det(left), 0.0, 1.0)
    return wilks


def _log_p(wilks: FloatArray, modes: IntArray, design: Design) -> FloatArray:
    log_p = wilks_p(wilks, np.maximum(modes, 1), design.tested.shape[1], design.error_dof, log=True)
    return np.where(modes > 0, log_p, 0.0)


def _check_modes(n_modes: int, design: Design, available: int) -> None:
    most = min(design.error_dof, available)
    if not 0 <= n_modes <= most:
        raise InputError(
            f"{n_modes} modes are more than the {most} that {len(design.tested)} subjects with this design "
            "can be tested in; use fewer modes, fewer covariates or more subjects"
        )


def _warnings(n_modes: int, design: Design) -> tuple[str, ...]:
    if n_modes == 0:
        return ("No mode has more variance than chance gives: the shapes differ by noise only, p is 1.",)
    if design.error_dof < _MIN_DOF_PER_MODE * n_modes:
        return (
            f"Low power: {design.error_dof} degrees of freedom for {n_modes} modes. Only large effects can "
            "be found, and intervals are wide.",
        )
    return ()
