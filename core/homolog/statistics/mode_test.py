"""The test of whole shapes: on all coordinates, and in the modes that parallel analysis retains.

The p-value is that of residual randomization on all coordinates (`homolog.statistics.randomization`), which
chooses no modes and is the test of Procrustes ANOVA. Retained modes, scaled to unit variance, give the effect
size D, Hotelling's T² or Wilks' lambda with F (normal data of equal covariance), and a randomization p of
their own, which sees effects in modes of small variance.

The modes are those of the data with covariates regressed out, but including the tested effect, so that they
do not depend on the labels. For normal data the subjects' scores, scaled to unit variance, are then a
uniformly distributed orthonormal frame for any variances of the modes: the choice of modes by variance does
not bias the test.
"""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.checks import checked_particles
from homolog.statistics.design import Hypothesis
from homolog.statistics.parallel import Null, ParallelAnalysis, parallel_analysis
from homolog.statistics.randomization import LEVEL, Randomization, RandomizationTest
from homolog.statistics.shape_model import leading_scores
from homolog.statistics.wilks import hotelling, rao_f, wilks_p
from homolog.threads import on_one_thread

__all__ = ["ModeTest", "mode_test"]

_MIN_DOF_PER_MODE = 3
"""Degrees of freedom of the error per mode below which a test gets a warning about low power."""


@dataclass(frozen=True, slots=True, eq=False)
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
        Hotelling's T², for one tested column (two groups, a continuous variable, pairs) of independent rows.
    mahalanobis : float or None
        Effect size for one tested column: length of its coefficient in units of the standard deviation
        within groups; for two groups the distance of their means.
    f, dof : float, (float, float)
        F statistic and its degrees of freedom; for Wilks' lambda of more than two modes and columns Rao's
        approximation. Both 0 if no mode is retained, and for repeated measures.
    p : float
        Parametric p-value of F; for groups it assumes equal covariances.
    r_squared : float
        Share of the sum of squares of all coordinates, without nuisance columns, that the effect explains.
    whole : RandomizationTest
        The test on all coordinates: the tested sum of squares divided by the one expected without an effect.
    noise : (float, float)
        Trace of the covariance of the effect of one tested column in all coordinates, as residuals show it,
        and trace of its square [mm², mm⁴].
    p_modes : float
        p in the retained modes, scaled to unit variance.
    permuted : bool
        Whether rows were permuted, as with up to twelve rows along a number; otherwise signs were flipped.
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
    r_squared: float
    whole: RandomizationTest
    noise: tuple[float, float]
    p_modes: float
    permuted: bool
    parallel: ParallelAnalysis
    warnings: tuple[str, ...]

    @property
    def studentized(self) -> float:
        """Statistic of the whole shape."""
        return self.whole.statistic

    @property
    def z(self) -> float:
        """Standard deviates of its logarithm from the null distribution."""
        return self.whole.z

    @property
    def p_permutation(self) -> float:
        """P of the whole shape, on all coordinates."""
        return self.whole.p

    @property
    def permutations(self) -> int:
        """Number of randomizations."""
        return len(self.whole.null)

    @property
    def exact(self) -> bool:
        """Whether these are all distinct ones."""
        return self.whole.exact


@on_one_thread
def mode_test(
    particles: FloatArray,
    hypothesis: Hypothesis,
    *,
    modes: int | None = None,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> ModeTest:
    """Test the whole shape for the effect of a hypothesis.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions, or differences of pairs [mm].
    hypothesis : Hypothesis
        What is tested.
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
    rows = shapes.reshape(len(shapes), -1)
    residuals = hypothesis.residuals(rows)
    paired = hypothesis.nuisance.shape[1] == 0
    parallel = parallel_analysis(
        residuals,
        nuisance=hypothesis.nuisance,
        null=Null.SIGNS if paired else Null.PERMUTATION,
        seed=seed,
        tick=part_of(tick, 0.0, 0.3),
    )
    n_modes = parallel.n_retained if modes is None else modes
    _check_modes(n_modes, hypothesis, len(parallel.eigenvalues))
    drawn = Randomization(hypothesis, rows, draws=permutations, seed=seed, tick=part_of(tick, 0.3, 1.0))
    whole = drawn.ratio(rows)
    scores = _unit_columns(leading_scores(residuals, max(n_modes, 1))[0])[:, :n_modes]
    projected = hypothesis.tested.T @ scores
    wilks = float(np.clip(np.linalg.det(np.eye(len(projected)) - projected @ projected.T), 0.0, 1.0))
    columns = hypothesis.tested.shape[1]
    f, between, within = (
        float(value) for value in rao_f(np.array(wilks), max(n_modes, 1), columns, hypothesis.error_dof)
    )
    independent = hypothesis.n_units == len(rows)
    t_squared = float(hotelling(wilks, hypothesis.error_dof)) if columns == 1 and independent else None
    has_f = n_modes > 0 and independent
    unit = float(np.linalg.norm(hypothesis.columns))
    total = float(np.square(residuals).sum())
    return ModeTest(
        modes=n_modes,
        wilks=wilks,
        pillai=float(np.square(projected).sum()),
        lawley=_lawley(projected),
        t_squared=t_squared,
        mahalanobis=None if t_squared is None else float(np.sqrt(t_squared) / unit),
        f=f if has_f else 0.0,
        dof=(between, within) if has_f else (0.0, 0.0),
        p=float(wilks_p(np.array(wilks), n_modes, columns, hypothesis.error_dof)) if has_f else 1.0,
        r_squared=float(np.square(hypothesis.tested.T @ residuals).sum()) / total if total else 0.0,
        whole=whole,
        noise=_noise(residuals - hypothesis.tested @ (hypothesis.tested.T @ residuals), hypothesis),
        p_modes=drawn.ratio(scores).p if n_modes else 1.0,
        permuted=drawn.permuted,
        parallel=parallel,
        warnings=_warnings(n_modes, hypothesis, drawn.arrangements),
    )


def _noise(rest: FloatArray, hypothesis: Hypothesis) -> tuple[float, float]:
    """Return the traces of the effect's covariance and its square, unbiased, from residuals (M, P)."""
    dof = hypothesis.error_dof
    products = rest @ rest.T / max(float(np.square(hypothesis.columns).sum()), np.finfo(float).tiny)
    trace = float(np.trace(products)) / dof
    square = float(np.square(products).sum()) / dof**2
    unbiased = (square - trace**2 / dof) * dof**2 / max((dof - 1.0) * (dof + 2.0), 1.0)
    return trace, max(unbiased, trace**2 / rest.shape[1])


def _unit_columns(columns: FloatArray) -> FloatArray:
    """Return columns (..., M, K) of length 1; zeros stay zeros."""
    lengths = np.linalg.norm(columns, axis=-2, keepdims=True)
    unit: FloatArray = columns / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _lawley(projected: FloatArray) -> float:
    """Return Hotelling and Lawley's trace from the tested columns in the modes (d, K)."""
    shares = np.clip(np.linalg.eigvalsh(projected @ projected.T), 0.0, 1.0 - np.finfo(float).eps)
    return float((shares / (1.0 - shares)).sum())


def _check_modes(n_modes: int, hypothesis: Hypothesis, available: int) -> None:
    most = min(hypothesis.error_dof, available)
    if not 0 <= n_modes <= most:
        raise InputError(
            f"{n_modes} modes are more than the {most} that {len(hypothesis.tested)} subjects with this "
            "design can be tested in; use fewer modes, fewer covariates or more subjects"
        )


def _warnings(n_modes: int, hypothesis: Hypothesis, arrangements: int) -> tuple[str, ...]:
    if arrangements * LEVEL < 1.0:
        return (
            f"Too few subjects: they have {arrangements} distinct arrangements, so that p is at least "
            f"{1.0 / arrangements:.2g} and no test can show an effect, however large.",
        )
    if n_modes == 0:
        return ("Parallel analysis retains no mode: the shapes can't be told from noise, and there is no D.",)
    if hypothesis.error_dof < _MIN_DOF_PER_MODE * n_modes:
        return (
            f"Low power: {hypothesis.error_dof} degrees of freedom for {n_modes} modes. Only large effects "
            "can be detected, and intervals are wide.",
        )
    return ()
