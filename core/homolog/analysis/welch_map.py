"""Welch's t of a number at each particle, such as outward displacement: signed, for unequal variances."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.analysis.permutation import permutation_p_value
from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick
from homolog.threads import on_one_thread

__all__ = ["WelchMap", "welch_map"]

_CHUNK_VALUES = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class WelchMap:
    """A signed test at each particle. Arrays are read-only.

    Attributes
    ----------
    difference : (N,) array
        Mean of the second group minus that of the first.
    t : (N,) array
        Welch's t; 0 where nothing varies.
    p : (N,) array
        Parametric and two-sided, for each particle by itself, not corrected.
    p_family : (N,) array
        Corrected by the permutation distribution of the largest magnitude of t over the surface, each as the
        normal deviate of the same p (Wallace 1959), so that t of few and of many degrees of freedom compare.
    q : (N,) array
        Benjamini-Hochberg false discovery rate.
    """

    difference: FloatArray
    t: FloatArray
    p: FloatArray
    p_family: FloatArray
    q: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


@on_one_thread
def welch_map(
    values: FloatArray,
    second: BoolArray,
    *,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> WelchMap:
    """Compare two groups at every particle (Welch 1947).

    Parameters
    ----------
    values : (M, N) array
        A number for each subject and particle, such as displacement along the mean's outward normals [mm].
    second : (M,) bool array
        Members of the second group; the others are the first.
    permutations : int
        Relabellings for the correction over the surface.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    WelchMap

    Raises
    ------
    InputError
        If a group has fewer than two subjects, or values are not finite.
    """
    if min(np.count_nonzero(second), np.count_nonzero(~second)) < 2 or not np.isfinite(values).all():
        raise InputError("a local comparison needs finite values and two or more subjects in each group")
    centred = values - values.mean(axis=0)
    membership = second.astype(np.float64)
    difference, t, dof = (item[0] for item in _welch(centred, membership[None]))
    generator = np.random.default_rng(seed)
    largest = np.empty(permutations)
    chunk = max(1, _CHUNK_VALUES // values.shape[1])
    for start in range(0, permutations, chunk):
        tick(start / permutations, "permutations of the outward map")
        order = generator.random((min(chunk, permutations - start), len(second))).argsort(axis=1)
        _, drawn, freedom = _welch(centred, membership[order])
        largest[start : start + len(order)] = _deviate(drawn, freedom).max(axis=1)
    p = np.asarray(2.0 * stats.t.sf(np.abs(t), dof), np.float64)
    return WelchMap(
        difference, t, p, permutation_p_value(_deviate(t, dof), largest), stats.false_discovery_control(p)
    )


def _deviate(t: FloatArray, dof: FloatArray) -> FloatArray:
    """Return the magnitude of the normal deviate that is as unlikely as t (Wallace 1959)."""
    deviate: FloatArray = (8.0 * dof + 1.0) / (8.0 * dof + 3.0) * np.sqrt(dof * np.log1p(np.square(t) / dof))
    return deviate


def _welch(centred: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Difference of means, t and its degrees of freedom, (c, N) each, for memberships (c, M) of 0 and 1."""
    squares, floor = np.square(centred), 1e-12 * np.square(centred).mean(axis=0)
    means, errors, spreads = [], [], []
    for members in (1.0 - second, second):
        count = members.sum(axis=1, keepdims=True)
        mean = members @ centred / count
        variance = np.maximum(members @ squares / count - np.square(mean), floor) * count / (count - 1.0)
        means.append(mean)
        errors.append(variance / count)
        spreads.append(np.square(variance / count) / (count - 1.0))
    error = np.maximum(errors[0] + errors[1], np.finfo(float).tiny)
    spread = np.maximum(spreads[0] + spreads[1], np.finfo(float).tiny)
    difference = means[1] - means[0]
    dof = np.clip(np.square(error) / spread, 1.0, float(second.shape[1]))
    return difference, difference / np.sqrt(error), dof
