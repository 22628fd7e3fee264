"""All results about one effect: whole shape, every particle, size, discriminant."""

from dataclasses import dataclass

import numpy as np

from homolog.analysis.design import Design
from homolog.analysis.discriminant import Discriminant
from homolog.analysis.local_map import LocalMap, local_map
from homolog.analysis.mode_test import ModeTest, mode_test
from homolog.analysis.null_simulation import FalseAlarms, null_simulation
from homolog.analysis.procrustes import align, sizes
from homolog.analysis.wilks import wilks_p
from homolog.arrays import FloatArray, IntArray, frozen
from homolog.progress import Tick, part_of

__all__ = ["DEFAULT", "Comparison", "Options", "compared", "prepared"]


@dataclass(frozen=True, slots=True)
class Options:
    """How a comparison is computed.

    Attributes
    ----------
    scaling : bool
        Take size out of the shapes first; it is tested apart in any case.
    modes : int or None
        Number of modes; by parallel analysis if not given.
    permutations : int
        Relabellings of each test.
    bootstraps : int
        Cohorts drawn for the bounds of the discriminant.
    null_repeats : int
        Relabellings of the null simulation; 0 leaves it out.
    seed : int
        Same seed, same result.
    """

    scaling: bool = False
    modes: int | None = None
    permutations: int = 10_000
    bootstraps: int = 1000
    null_repeats: int = 0
    seed: int = 0


DEFAULT = Options()


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All results about one effect.

    Attributes
    ----------
    title : str
        Such as ``"HCM - NOR"``.
    subjects : (m,) int array
        Indices of the subjects that took part; for pairs, of their first.
    counts : dict
        Subjects in each group.
    mean : (N, 3) array
        Mean shape of those subjects [mm].
    test : ModeTest
        Of the whole shape.
    local : LocalMap
        At every particle; its effect is the difference, or the change per unit [mm].
    size_effect : (d,) array
        Difference in size, or change per unit [mm].
    size_p : float
        Parametric p-value of that.
    discriminant : Discriminant or None
        For two groups, if at least one mode is kept.
    p_adjusted : float
        The permutation p-value of the test, adjusted by Holm's method if it is one of several pairs.
    false_alarms : tuple of FalseAlarms
        What the same tests find on this cohort when labels mean nothing; empty without a null simulation.
    """

    title: str
    subjects: IntArray
    counts: dict[str, int]
    mean: FloatArray
    test: ModeTest
    local: LocalMap
    size_effect: FloatArray
    size_p: float
    discriminant: Discriminant | None
    p_adjusted: float
    false_alarms: tuple[FalseAlarms, ...]

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("subjects", "mean", "size_effect"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def compared(
    shapes: FloatArray,
    subjects: IntArray,
    design: Design,
    title: str,
    counts: dict[str, int],
    options: Options,
    tick: Tick,
    *,
    data: FloatArray | None = None,
    size: FloatArray | None = None,
) -> Comparison:
    """Run the tests of one design.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Checked positions of the whole cohort [mm].
    subjects : (m,) int array
        Those who take part.
    design : Design
        What is tested, with m rows.
    title, counts, options
        See `Comparison`.
    tick : Tick
        Progress and cancelling.
    data : (m, N, 3) array, optional
        What is tested in place of the subjects' shapes: differences of pairs [mm].
    size : (m,) array, optional
        The same for size [mm].
    """
    own = prepared(shapes[subjects], options)
    data = own if data is None else data
    size = sizes(shapes[subjects]) if size is None else size
    test = mode_test(
        data,
        design,
        modes=options.modes,
        permutations=options.permutations,
        seed=options.seed,
        tick=part_of(tick, 0.0, 0.4),
    )
    local = local_map(
        data, design, permutations=options.permutations, seed=options.seed, tick=part_of(tick, 0.4, 0.8)
    )
    false_alarms: tuple[FalseAlarms, ...] = ()
    if options.null_repeats and test.modes:
        false_alarms = null_simulation(
            data,
            design,
            modes=test.modes,
            repeats=options.null_repeats,
            seed=options.seed,
            tick=part_of(tick, 0.8, 1.0),
        )
    return Comparison(
        title=title,
        subjects=subjects,
        counts=counts,
        mean=own.mean(axis=0),
        test=test,
        local=local,
        size_effect=design.coefficients(size[:, None])[:, 0],
        size_p=_size_p(size, design),
        discriminant=None,
        p_adjusted=test.p_permutation,
        false_alarms=false_alarms,
    )


def prepared(shapes: FloatArray, options: Options) -> FloatArray:
    """Return the shapes as they are compared: brought to one size, if that is wished."""
    return align(shapes, scaling=True) if options.scaling else shapes


def _size_p(size: FloatArray, design: Design) -> float:
    residuals = design.residuals(size[:, None])[:, 0]
    total = float(residuals @ residuals)
    if total <= np.finfo(float).eps * float(size @ size):
        return 1.0
    explained = float(np.square(design.tested.T @ residuals).sum()) / total
    columns = design.tested.shape[1]
    return float(wilks_p(np.array(max(1.0 - explained, 0.0)), 1, columns, design.error_dof))
