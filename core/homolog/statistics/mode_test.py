"""The test of whole shapes in the modes that parallel analysis retains.

The primary p-value is from permutations of a studentized statistic (`homolog.statistics.statistics`), valid
also if the groups' covariances differ. Hotelling's T², Wilks' lambda and F are reported in addition.

The modes are those of the data with covariates regressed out, but including the tested effect, so that they
do not depend on the labels. For normal data the subjects' scores, scaled to unit variance, are then a
uniformly distributed orthonormal frame for any variances of the modes: the choice of modes by variance does
not bias the test. F is exact for normal data of equal covariance.
"""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.checks import checked_particles
from homolog.statistics.design import Design, Exchange
from homolog.statistics.parallel import Null, ParallelAnalysis, parallel_analysis
from homolog.statistics.permutation import (
    PermutedDesigns,
    null_distribution,
    permutation_count,
    permutation_p_value,
)
from homolog.statistics.shape_model import leading_scores
from homolog.statistics.statistics import (
    EqualizedSubjects,
    WelchStatistic,
    equalize_groups,
    equalize_subjects,
    hotelling,
    observed_design,
    rao_f,
    restores_mean,
    studentized_ratio,
    wilks_p,
)
from homolog.threads import on_one_thread

__all__ = ["ModeStatistic", "ModeTest", "mode_test"]

_CHUNK = 500
_CHUNK_VALUES = 4_000_000
MANY = 300
"""Number of subjects from which on shapes are reduced to the leading modes and `_FURTHER` more."""
_FURTHER = 24
_MIN_DOF_PER_MODE = 3
"""Degrees of freedom of the error per mode below which a test gets a warning about low power."""


@dataclass(frozen=True, slots=True)
class ModeTest:
    """Result of a test of whole shapes.

    Attributes
    ----------
    modes : int
        Number of modes of the test, retained by parallel analysis or given.
    wilks : float
        Wilks' lambda: share of the generalised variance that the tested effect leaves unexplained.
    pillai : float
        Pillai's trace.
    lawley : float
        Hotelling and Lawley's trace: sums of squares of the tested effect over those within, summed.
    t_squared : float or None
        Hotelling's T², for one tested column (two groups, a continuous variable, pairs).
    mahalanobis : float or None
        Effect size for one tested column: length of its coefficient in units of the standard deviation
        within groups; for two groups the distance of their means.
    f, dof : float, (float, float)
        F statistic and its degrees of freedom; for Wilks' lambda of more than two modes and columns Rao's
        approximation. Both 0 if no mode is retained.
    p : float
        Parametric p-value of F; for groups it assumes equal covariances.
    studentized : float
        Welch's F of groups in standardized modes; with covariates or for a variable the ratio of the tested
        sum of squares to the one expected without an effect.
    p_permutation : float
        Share of the permutations whose studentized statistic is at least as large.
    permutations : int
        Number of permutations.
    exact : bool
        Whether these are all distinct permutations.
    parallel : ParallelAnalysis
        The choice of modes.
    warnings : tuple of str
        Cautions as sentences.
    """

    modes: int
    wilks: float
    pillai: float
    lawley: float
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
        The design whose rows are exchanged.
    n_modes : int
        Number of modes of the test.
    scaled : bool
        Whether the dispersions of groups, or along a variable, are equalized before subjects are exchanged;
        see `equalize_groups` and `equalize_subjects`. The modes of the permutation statistic are then those
        of the equalized shapes.
    """

    def __init__(
        self,
        residuals: FloatArray,
        design: Design,
        n_modes: int,
        *,
        scaled: bool = True,
    ) -> None:
        self._design = design
        self._many = len(residuals) > MANY
        rows = leading_scores(residuals, n_modes + _FURTHER)[0] if self._many else residuals
        self._rows = rows
        self._gram = rows.T @ rows if self._many else rows @ rows.T
        self._n_modes = n_modes
        self._frame = _unit_columns(rows) if self._many else self._decomposed(self._gram)
        self._welch: WelchStatistic | None = None
        self._equalized: EqualizedSubjects | None = None
        groups = equalize_groups(residuals, design, scaled=scaled)
        if groups is not None and n_modes:
            coordinates = self._modes_of(groups.values).T[:, :, None]
            self._welch = WelchStatistic(coordinates, np.array([float(n_modes)]), groups, design)
        elif groups is None and scaled and n_modes:
            self._equalized = equalize_subjects(residuals, design, variables=True)
            if self._equalized is not None:
                self._equal_scores = self._modes_of(self._equalized.values)

    def projections(self, permuted: PermutedDesigns) -> FloatArray:
        """Return the tested columns in the modes, (c, d, k)."""
        projected: FloatArray = np.swapaxes(permuted.tested, 1, 2) @ self._scores(permuted)
        return projected

    def scores(self, modes: int) -> FloatArray:
        """Return the subjects' scores in the first modes, shape (M, modes), columns of length 1."""
        return self._frame[:, :modes]

    def _scores(self, permuted: PermutedDesigns) -> FloatArray:
        """Return the subjects' standardized scores (M, k), with covariates (c, M, k).

        Without covariates the modes are the same for all permutations. With covariates the data change (their
        permuted residuals are regressed on the covariates again), and so do the modes.
        """
        covariates = permuted.covariates
        if covariates.shape[2] == 0:
            return self._frame[:, : self._n_modes]
        across = np.swapaxes(covariates, 1, 2)
        if self._many:
            along = across @ self._rows
            frames = self._decomposed(self._gram - np.swapaxes(along, 1, 2) @ along)[..., : self._n_modes]
            return _unit_columns(self._rows @ frames - covariates @ (along @ frames))
        gram = self._gram - covariates @ (across @ self._gram)
        gram = gram - (gram @ covariates) @ across
        return self._decomposed(gram)[..., : self._n_modes]

    def log_p(self, permuted: PermutedDesigns) -> FloatArray:
        """Return the logarithm of the parametric p-value of each permutation, shape (c,)."""
        return _log_p(_wilks(self.projections(permuted)), self._n_modes, self._design)

    def statistic(self) -> float:
        """Return the studentized statistic of the observed labels; see `ModeTest.studentized`."""
        original = observed_design(self._design)
        if self._welch is not None:
            return float(self._welch.f(original)[0][0, 0])
        return float(self.studentized(original)[0])

    def studentized(self, permuted: PermutedDesigns) -> FloatArray:
        """Return a statistic that is comparable between permutations, shape (c,); 0 without a mode.

        For groups the normal deviate of Welch's F, else the studentized ratio.
        """
        if self._welch is not None:
            return self._welch.deviate(permuted)[:, 0]
        if self._n_modes == 0:
            return np.zeros(len(permuted.tested))
        if self._equalized is not None:
            restored = self._equalized.restored(self._equal_scores, permuted)
            return studentized_ratio(restored, permuted, self._design)
        return studentized_ratio(self._scores(permuted), permuted, self._design)

    @property
    def restores_mean(self) -> bool:
        """Whether the statistic depends on the mean that is added to permuted values."""
        return restores_mean(self._welch, self._equalized)

    def _modes_of(self, rows: FloatArray) -> FloatArray:
        """Return the scores of rows (M, P) in their leading modes, (M, n_modes), columns of length 1."""
        if self._many:
            return _unit_columns(leading_scores(rows, self._n_modes)[0])
        return self._decomposed(rows @ rows.T)[:, : self._n_modes]

    def _decomposed(self, gram: FloatArray) -> FloatArray:
        """Left singular vectors as columns, those of the largest singular values first."""
        vectors: FloatArray = np.linalg.eigh(gram)[1][..., ::-1]
        return vectors


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
        The tested design.
    modes : int, optional
        Number of modes; chosen by parallel analysis if not given.
    permutations : int
        Permutations for the permutation p-value.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

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
    count, exact = permutation_count(design, permutations)
    drawn = 0 if exact else seed  # p from all permutations does not depend on the seed
    parallel = parallel_analysis(
        residuals, nuisance=design.nuisance, null=null, seed=drawn, tick=part_of(tick, 0.0, 0.3)
    )
    n_modes = parallel.n_retained if modes is None else modes
    _check_modes(n_modes, design, len(parallel.eigenvalues))
    statistic = ModeStatistic(residuals, design, n_modes)
    original = observed_design(design)
    projected = statistic.projections(original)
    wilks = float(_wilks(projected)[0])
    null_statistics = null_distribution(
        statistic.studentized,
        design,
        permutations,
        chunk=max(1, min(_CHUNK, _CHUNK_VALUES // (len(shapes) * max(n_modes, 1)))),
        seed=seed,
        means=statistic.restores_mean,
        tick=part_of(tick, 0.3, 1.0),
        message="permutations of the whole shape",
    )
    observed = _log_p(np.array([wilks]), n_modes, design)
    columns = design.tested.shape[1]
    f, between, within = (
        float(value) for value in rao_f(np.array(wilks), max(n_modes, 1), columns, design.error_dof)
    )
    t_squared = float(hotelling(wilks, design.error_dof)) if columns == 1 else None
    return ModeTest(
        modes=n_modes,
        wilks=wilks,
        pillai=float(np.square(projected).sum()),
        lawley=_lawley(projected[0]),
        t_squared=t_squared,
        mahalanobis=None if t_squared is None else float(np.sqrt(t_squared) / np.linalg.norm(design.columns)),
        f=f if n_modes else 0.0,
        dof=(between, within) if n_modes else (0.0, 0.0),
        p=float(np.exp(observed[0])),
        studentized=statistic.statistic(),
        p_permutation=float(permutation_p_value(statistic.studentized(original), null_statistics, count)[0]),
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


def _lawley(projected: FloatArray) -> float:
    """Return Hotelling and Lawley's trace from the tested columns in the modes (d, K)."""
    shares = np.clip(np.linalg.eigvalsh(projected @ projected.T), 0.0, 1.0 - np.finfo(float).eps)
    return float((shares / (1.0 - shares)).sum())


def _log_p(wilks: FloatArray, modes: int, design: Design) -> FloatArray:
    if modes == 0:
        return np.zeros(wilks.shape)
    return wilks_p(wilks, modes, design.tested.shape[1], design.error_dof, log=True)


def _check_modes(n_modes: int, design: Design, available: int) -> None:
    most = min(design.error_dof, available)
    if not 0 <= n_modes <= most:
        raise InputError(
            f"{n_modes} modes are more than the {most} that {len(design.tested)} subjects with this design "
            "can be tested in; use fewer modes, fewer covariates or more subjects"
        )


def _warnings(n_modes: int, design: Design) -> tuple[str, ...]:
    if n_modes == 0:
        return (
            "Parallel analysis retains no mode: the shapes can't be distinguished from noise, and p is 1.",
        )
    if design.error_dof < _MIN_DOF_PER_MODE * n_modes:
        return (
            f"Low power: {design.error_dof} degrees of freedom for {n_modes} modes. Only large effects can "
            "be detected, and intervals are wide.",
        )
    return ()
