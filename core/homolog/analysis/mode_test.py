"""The test of whole shapes in the modes that parallel analysis keeps.

The p-value to trust is that of the permutation of a studentized statistic (`homolog.analysis.studentized`),
which holds when the groups' covariances differ. Hotelling's T², Wilks' lambda and F stand beside it.

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
from homolog.analysis.permutation import Relabelling, permutation_p_value, relabelling_count, relabellings
from homolog.analysis.studentized import WelchStatistic, equalized, identity, studentized_ratio
from homolog.analysis.wilks import hotelling, rao_f, wilks_p
from homolog.arrays import FloatArray, IntArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.threads import on_one_thread

__all__ = ["ModeStatistic", "ModeTest", "mode_test"]

_CHUNK = 500
_CHUNK_VALUES = 4_000_000
_MIN_DOF_PER_MODE = 3
"""Degrees of freedom of the error for each mode below which a test is said to have low power."""


@dataclass(frozen=True, slots=True)
class ModeTest:
    """Result of a test of whole shapes.

    Attributes
    ----------
    modes : int
        Number of modes tested in, kept by parallel analysis or given.
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
        approximation. Both 0 if no mode is kept.
    p : float
        Parametric p-value of F; of groups it needs equal covariances.
    studentized : float
        Welch's F of groups in standardized modes; with covariates or for a variable the ratio of the tested
        sum of squares to the one expected without an effect.
    p_permutation : float
        Share of the relabellings whose studentized statistic, with modes chosen anew, is as large.
    permutations : int
        Number of relabellings.
    exact : bool
        Whether these are all different relabellings that there are.
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
    """The statistic of one data set for any relabelling of its design.

    Parameters
    ----------
    residuals : (M, P) array
        Data with the nuisance columns of the design regressed out.
    design : Design
        Whose rows are exchanged.
    kept : int
        Modes tested in, where they are not chosen anew.
    threshold : (K,) array or None
        Variances above which a mode is kept; None tests in the first `kept` modes always.
    scaled : bool
        Whether the groups' dispersions are equalized before subjects are exchanged; see `equalized`. The
        modes of Welch's F are then those of the equalized shapes.
    """

    def __init__(
        self,
        residuals: FloatArray,
        design: Design,
        kept: int,
        threshold: FloatArray | None,
        *,
        scaled: bool = True,
    ) -> None:
        self._gram = residuals @ residuals.T
        self._design = design
        self._kept = kept
        self._dof = len(residuals) - design.nuisance.shape[1]
        self._threshold = None if threshold is None else threshold * self._dof
        self._frame, _ = self._decomposed(self._gram)
        self._welch: WelchStatistic | None = None
        groups = equalized(residuals, design, scaled=scaled)
        if groups is not None and kept:
            frame, _ = self._decomposed(groups.values @ groups.values.T)
            self._welch = WelchStatistic(frame.T[:kept, :, None], np.array([float(kept)]), groups, design)

    def projections(self, relabelling: Relabelling) -> tuple[FloatArray, IntArray]:
        """Return the tested columns in the modes, (c, d, K) with zeros from mode k on, and k (c,).

        Without covariates the modes are the same for all relabellings. With covariates the data change
        (their permuted residuals are regressed on the covariates again), and so modes are chosen again.
        """
        scores, modes = self._scores(relabelling)
        return np.swapaxes(relabelling.tested, 1, 2) @ scores, modes

    def scores(self, modes: int) -> FloatArray:
        """Return the subjects' scores in the first modes, shape (M, modes), columns of length 1."""
        return self._frame[:, :modes]

    def _scores(self, relabelling: Relabelling) -> tuple[FloatArray, IntArray]:
        """Return the subjects' standardized scores (M, k) or (c, M, K), zero from mode k on, and k (c,)."""
        if relabelling.covariates.shape[2] == 0:
            return self._frame[:, : self._kept], np.full(len(relabelling.tested), self._kept)
        covariates = relabelling.covariates
        across = np.swapaxes(covariates, 1, 2)
        gram = self._gram - covariates @ (across @ self._gram)
        gram = gram - (gram @ covariates) @ across
        frames, squares = self._decomposed(gram)
        modes = np.full(len(gram), self._kept)
        if self._threshold is not None:
            above = squares[:, : len(self._threshold)] > self._threshold
            modes = np.where(above.all(axis=1), above.shape[1], above.argmin(axis=1))
        frames = frames[:, :, : max(int(modes.max()), 1)]
        return frames * (np.arange(frames.shape[2]) < modes[:, None, None]), modes

    def log_p(self, relabelling: Relabelling) -> FloatArray:
        """Return the logarithm of the parametric p-value of each relabelling, shape (c,)."""
        projected, modes = self.projections(relabelling)
        return _log_p(_wilks(projected), modes, self._design)

    def statistic(self) -> float:
        """Return the studentized statistic of the real labels; see `ModeTest.studentized`."""
        real = identity(self._design)
        if self._welch is not None:
            return float(self._welch.f(real)[0][0, 0])
        return float(studentized_ratio(self.scores(self._kept), real, self._design)[0]) if self._kept else 0.0

    def studentized(self, relabelling: Relabelling) -> FloatArray:
        """Return a statistic that is comparable between relabellings, shape (c,); 0 without a mode.

        For groups the normal deviate of Welch's F, else the studentized ratio. Where modes are chosen anew
        it is the quantile that the ratio is among F ratios of so many modes, so that relabellings with more
        and with fewer modes can be compared.
        """
        if self._welch is not None:
            return self._welch.deviate(relabelling)[:, 0]
        scores, modes = self._scores(relabelling)
        ratio = studentized_ratio(scores, relabelling, self._design)
        if relabelling.covariates.shape[2]:
            across = self._design.tested.shape[1] * np.maximum(modes, 1)
            within = self._design.error_dof * np.maximum(modes, 1)
            ratio = -np.log(np.maximum(stats.f.sf(ratio, across, within), np.finfo(float).tiny))
        return np.where(modes > 0, ratio, 0.0)

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
        Relabellings for the permutation p-value.
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
    kept = parallel.kept if modes is None else modes
    _check_modes(kept, design, len(parallel.variances))
    count, exact = relabelling_count(design, permutations)
    threshold = parallel.threshold if modes is None else None
    statistic = ModeStatistic(residuals, design, kept, threshold, scaled=not exact)
    real = identity(design)
    projected, _ = statistic.projections(real)
    wilks = float(_wilks(projected)[0])
    drawn = np.empty(count)
    done = 0
    chunk = max(1, min(_CHUNK, _CHUNK_VALUES // (len(shapes) * max(kept, 1))))
    for some in relabellings(design, permutations, chunk=chunk, seed=seed):
        tick(0.3 + 0.7 * done / max(count, 1), "permutations of the whole shape")
        drawn[done : done + len(some.tested)] = statistic.studentized(some)
        done += len(some.tested)
    observed = _log_p(np.array([wilks]), np.array([kept]), design)
    columns = design.tested.shape[1]
    f, between, within = (
        float(value) for value in rao_f(np.array(wilks), max(kept, 1), columns, design.error_dof)
    )
    t_squared = float(hotelling(wilks, design.error_dof)) if columns == 1 else None
    return ModeTest(
        modes=kept,
        wilks=wilks,
        pillai=float(np.square(projected).sum()),
        t_squared=t_squared,
        mahalanobis=None if t_squared is None else float(np.sqrt(t_squared) / np.linalg.norm(design.columns)),
        f=f if kept else 0.0,
        dof=(between, within) if kept else (0.0, 0.0),
        p=float(np.exp(observed[0])),
        studentized=statistic.statistic(),
        p_permutation=float(permutation_p_value(statistic.studentized(real), drawn)[0]),
        permutations=count,
        exact=exact,
        parallel=parallel,
        warnings=_warnings(kept, design),
    )


def _wilks(projected: FloatArray) -> FloatArray:
    """Wilks' lambda (c,) from the tested columns in the modes (c, d, K)."""
    left = np.eye(projected.shape[1]) - projected @ np.swapaxes(projected, 1, 2)
    wilks: FloatArray = np.clip(np.linalg.det(left), 0.0, 1.0)
    return wilks


def _log_p(wilks: FloatArray, modes: IntArray, design: Design) -> FloatArray:
    log_p = wilks_p(wilks, np.maximum(modes, 1), design.tested.shape[1], design.error_dof, log=True)
    return np.where(modes > 0, log_p, 0.0)


def _check_modes(kept: int, design: Design, available: int) -> None:
    most = min(design.error_dof, available)
    if not 0 <= kept <= most:
        raise InputError(
            f"{kept} modes are more than the {most} that {len(design.tested)} subjects with this design "
            "can be tested in; use fewer modes, fewer covariates or more subjects"
        )


def _warnings(kept: int, design: Design) -> tuple[str, ...]:
    if kept == 0:
        return ("No mode has more variance than chance gives: the shapes differ by noise only, p is 1.",)
    if design.error_dof < _MIN_DOF_PER_MODE * kept:
        return (
            f"Low power: {design.error_dof} degrees of freedom for {kept} modes. Only large effects can be "
            "found, and intervals are wide.",
        )
    return ()
