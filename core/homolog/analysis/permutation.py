"""Relabellings under the null hypothesis, and the p-values counted over them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import factorial, prod

import numpy as np

from homolog.analysis.design import Design, Exchange
from homolog.arrays import FloatArray, IntArray

__all__ = ["Relabelling", "lowered", "permutation_p_value", "relabelling_count", "relabellings"]

_ROUNDING = 1e-9
"""Statistics that differ by less than this part are equal: the same split computed in another order."""


@dataclass(frozen=True, slots=True, eq=False)
class Relabelling:
    """Designs whose rows were exchanged, many at a time.

    Exchanging residuals among subjects and exchanging the rows of the design the other way round are the
    same thing; the second keeps the data where they are.

    Attributes
    ----------
    tested : (c, M, d) array
        The tested basis of each of c relabellings.
    covariates : (c, M, q - 1) array
        The nuisance basis of each, without the intercept.
    signs : (c, M) array, optional
        A random sign for each subject, for what else a statistic draws at random.
    """

    tested: FloatArray
    covariates: FloatArray
    signs: FloatArray | None = None


def relabelling_count(design: Design, count: int) -> tuple[int, bool]:
    """Return how many relabellings `relabellings` yields, and whether they are all that there are.

    Small groups have fewer different relabellings than are asked for. Each is then taken once, so that the
    permutation test is exact without chance. The real labels are not among them.
    """
    possible = _possible(design)
    return (possible - 1, True) if possible <= count else (count, False)


def relabellings(
    design: Design, count: int, *, chunk: int, seed: int, exhaustive: bool = True
) -> Iterator[Relabelling]:
    """Yield so many random relabellings in chunks, or each different one if those are fewer.

    Parameters
    ----------
    design : Design
        Its rows, or signs, are exchanged.
    count : int
        Relabellings in all.
    chunk : int
        Most relabellings at a time.
    seed : int
        Same seed, same relabellings, whatever the chunk.
    exhaustive : bool
        Take each different relabelling once where there are no more than `count`; else draw always.
    """
    if exhaustive and relabelling_count(design, count)[1]:
        yield from _all_relabellings(design, chunk)
        return
    generator, of_signs = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    subjects = len(design.tested)
    for start in range(0, count, chunk):
        some = min(chunk, count - start)
        if design.exchange is Exchange.SIGNS:
            signs = 2.0 * generator.integers(0, 2, size=(some, subjects, 1)) - 1.0
            yield Relabelling(signs * design.tested, np.zeros((some, subjects, 0)))
        else:
            order = generator.random((some, subjects)).argsort(axis=1)
            drawn = of_signs.choice(np.array([-1.0, 1.0]), size=(some, subjects))
            yield Relabelling(design.tested[order], design.covariates[order], drawn)


def permutation_p_value(observed: FloatArray | float, drawn: FloatArray) -> FloatArray:
    """Return the share of relabellings at least as extreme, the real labels counted as one of them.

    Parameters
    ----------
    observed : (...) array or float
        Statistics of the real labels, larger meaning more extreme.
    drawn : (P,) array
        The statistic, or its maximum over the surface, of each relabelling.

    Returns
    -------
    (...) array
        ``(b + 1) / (P + 1)``, never zero (Phipson and Smyth 2010).
    """
    ordered = np.sort(drawn)
    limit = lowered(np.asarray(observed, dtype=np.float64))
    beyond = len(ordered) - np.searchsorted(ordered, limit, side="left")
    return np.asarray((beyond + 1.0) / (len(ordered) + 1.0), np.float64)


def lowered(observed: FloatArray) -> FloatArray:
    """Return statistics made smaller by what rounding may change in them."""
    limit: FloatArray = observed - _ROUNDING * np.abs(observed)
    return limit


def _kinds(design: Design) -> IntArray:
    """Return the number of the kind of row that each subject has; rows of one kind are alike."""
    rows = np.round(np.hstack([design.tested, design.covariates]), 10)
    kinds: IntArray = np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
    return kinds


def _possible(design: Design) -> int:
    subjects = len(design.tested)
    if design.exchange is Exchange.SIGNS:
        return 1 << subjects
    counts = Counter(_kinds(design).tolist()).values()
    return factorial(subjects) // prod(factorial(count) for count in counts)


def _all_relabellings(design: Design, chunk: int) -> Iterator[Relabelling]:
    subjects = len(design.tested)
    if design.exchange is Exchange.SIGNS:
        numbers = np.arange(1, 2**subjects)
        signs = 1.0 - 2.0 * ((numbers[:, None] >> np.arange(subjects)) & 1)
        for start in range(0, len(signs), chunk):
            some = signs[start : start + chunk, :, None]
            yield Relabelling(some * design.tested, np.zeros((len(some), subjects, 0)))
        return
    kinds = _kinds(design)
    first_of = np.unique(kinds, return_index=True)[1]
    orders = np.array(
        [arrangement for arrangement in _arrangements(kinds.tolist()) if arrangement != kinds.tolist()]
    )
    for start in range(0, len(orders), chunk):
        rows = first_of[orders[start : start + chunk]]
        yield Relabelling(design.tested[rows], design.covariates[rows])


def _arrangements(kinds: list[int]) -> Iterator[list[int]]:
    """Yield each different order of the kinds once."""
    left = Counter(kinds)

    def grown(start: list[int]) -> Iterator[list[int]]:
        if len(start) == len(kinds):
            yield list(start)
            return
        for kind in sorted(left):
            if left[kind]:
                left[kind] -= 1
                start.append(kind)
                yield from grown(start)
                start.pop()
                left[kind] += 1

    return grown([])
