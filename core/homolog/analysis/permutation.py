"""Permutations under the null hypothesis, and p-values from them."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import factorial, prod

import numpy as np

from homolog.analysis.design import Design, Exchange
from homolog.arrays import FloatArray, IntArray
from homolog.progress import Tick, no_tick

__all__ = [
    "PermutedDesigns",
    "draw_permutations",
    "null_distribution",
    "permutation_count",
    "permutation_p_value",
    "subtract_rounding",
]

_ROUNDING = 1e-9
"""Statistics that differ by less than this part are equal: the same split computed in another order."""


@dataclass(frozen=True, slots=True, eq=False)
class PermutedDesigns:
    """Designs whose rows were exchanged, many at a time.

    Exchanging residuals among subjects and permuting the rows of the design inversely are
    equivalent; the latter leaves the data unchanged.

    Attributes
    ----------
    tested : (c, M, d) array
        The tested basis of each of c permutations.
    covariates : (c, M, q - 1) array
        The nuisance basis of each, without the intercept.
    signs : (c, M) array, optional
        A random sign for each subject, for what else a statistic draws at random.
    """

    tested: FloatArray
    covariates: FloatArray
    signs: FloatArray | None = None


def permutation_count(design: Design, count: int) -> tuple[int, bool]:
    """Return how many permutations `draw_permutations` yields, and whether these are all distinct ones.

    Small groups have fewer distinct permutations than requested. Each is then used once. The observed
    labels are not among them.
    """
    possible = _possible(design)
    return (possible - 1, True) if possible <= count else (count, False)


def draw_permutations(
    design: Design, count: int, *, chunk: int, seed: int, exhaustive: bool = True
) -> Iterator[PermutedDesigns]:
    """Yield random permutations in chunks, or each distinct one if there are no more than `count`.

    Parameters
    ----------
    design : Design
        Its rows, or signs, are exchanged.
    count : int
        Permutations in all.
    chunk : int
        Most permutations at a time.
    seed : int
        Same seed, same permutations, whatever the chunk.
    exhaustive : bool
        Take each different permutation once where there are no more than `count`; else draw always.
    """
    if exhaustive and permutation_count(design, count)[1]:
        yield from _all_permutations(design, chunk, seed)
        return
    generator, of_signs = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    subjects = len(design.tested)
    for start in range(0, count, chunk):
        some = min(chunk, count - start)
        if design.exchange is Exchange.SIGNS:
            signs = 2.0 * generator.integers(0, 2, size=(some, subjects, 1)) - 1.0
            yield PermutedDesigns(signs * design.tested, np.zeros((some, subjects, 0)))
        else:
            order = generator.random((some, subjects)).argsort(axis=1)
            yield PermutedDesigns(
                design.tested[order], design.covariates[order], _signs(of_signs, some, subjects)
            )


def null_distribution(
    statistic: Callable[[PermutedDesigns], FloatArray],
    design: Design,
    permutations: int,
    *,
    chunk: int,
    seed: int,
    tick: Tick = no_tick,
    message: str = "permutations",
) -> FloatArray:
    """Return a statistic of each permutation, shape (P,); as many as `permutation_count` says.

    Parameters
    ----------
    statistic : callable
        Returns its values (c,) for c permuted designs.
    design, permutations, chunk, seed
        See `draw_permutations`.
    tick : Tick
        Progress and cancelling.
    message : str
        What is told meanwhile.
    """
    count, _ = permutation_count(design, permutations)
    values, done = np.empty(count), 0
    for some in draw_permutations(design, permutations, chunk=chunk, seed=seed):
        tick(done / max(count, 1), message)
        values[done : done + len(some.tested)] = statistic(some)
        done += len(some.tested)
    return values


def permutation_p_value(observed: FloatArray | float, null_statistics: FloatArray) -> FloatArray:
    """Return the share of permutations at least as extreme, the including the observed labels.

    Parameters
    ----------
    observed : (...) array or float
        Statistics of the observed labels, larger meaning more extreme.
    null_statistics : (P,) array
        The statistic, or its maximum over the surface, of each permutation.

    Returns
    -------
    (...) array
        ``(b + 1) / (P + 1)``, never zero (Phipson and Smyth 2010).
    """
    ordered = np.sort(null_statistics)
    limit = subtract_rounding(np.asarray(observed, dtype=np.float64))
    beyond = len(ordered) - np.searchsorted(ordered, limit, side="left")
    return np.asarray((beyond + 1.0) / (len(ordered) + 1.0), np.float64)


def subtract_rounding(observed: FloatArray) -> FloatArray:
    """Return statistics reduced by their rounding error."""
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


def _signs(generator: np.random.Generator, count: int, subjects: int) -> FloatArray:
    return generator.choice(np.array([-1.0, 1.0]), size=(count, subjects))


def _all_permutations(design: Design, chunk: int, seed: int) -> Iterator[PermutedDesigns]:
    subjects = len(design.tested)
    if design.exchange is Exchange.SIGNS:
        numbers = np.arange(1, 2**subjects)
        signs = 1.0 - 2.0 * ((numbers[:, None] >> np.arange(subjects)) & 1)
        for start in range(0, len(signs), chunk):
            some = signs[start : start + chunk, :, None]
            yield PermutedDesigns(some * design.tested, np.zeros((len(some), subjects, 0)))
        return
    kinds = _kinds(design)
    first_of = np.unique(kinds, return_index=True)[1]
    orders = np.array(
        [arrangement for arrangement in _distinct_orders(kinds.tolist()) if arrangement != kinds.tolist()]
    )
    generator = np.random.default_rng([seed, 1])
    for start in range(0, len(orders), chunk):
        rows = first_of[orders[start : start + chunk]]
        signs = _signs(generator, len(rows), subjects)
        yield PermutedDesigns(design.tested[rows], design.covariates[rows], signs)


def _distinct_orders(kinds: list[int]) -> Iterator[list[int]]:
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
