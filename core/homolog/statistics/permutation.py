"""Permutations under the null hypothesis, and p-values from them."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import factorial, prod

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.progress import Tick, no_tick
from homolog.statistics.design import Design, Exchange

__all__ = [
    "PermutedDesigns",
    "draw_permutations",
    "mean_draws",
    "null_distribution",
    "permutation_count",
    "permutation_p_value",
    "subtract_rounding",
]

_ROUNDING = 1e-9
"""Statistics with a smaller relative difference are equal: rounding depends on the order of subjects."""
_MOST_DRAWS = 10
"""All permutations are used if their number, with all means (see `mean_draws`), is at most this many times
the requested number."""


@dataclass(frozen=True, slots=True, eq=False)
class PermutedDesigns:
    """Several designs whose rows were exchanged.

    Exchanging residuals among subjects and permuting the rows of the design inversely are
    equivalent; the latter leaves the data unchanged.

    Attributes
    ----------
    tested : (c, M, d) array
        The tested basis of each of c permutations.
    covariates : (c, M, q - 1) array
        The nuisance basis of each permutation, without the intercept.
    signs : (c, M) array, optional
        A weight for each subject, of mean square 1: a random sign, or a weight of `mean_draws`.
    """

    tested: FloatArray
    covariates: FloatArray
    signs: FloatArray | None = None


def permutation_count(design: Design, count: int) -> tuple[int, bool]:
    """Return the number of permutations from `draw_permutations`, and whether these are all distinct ones.

    Small groups have fewer distinct permutations than requested. Each is then used once. The observed
    labels are not among them.
    """
    possible = _possible(design)
    most = count * min(mean_draws(design), _MOST_DRAWS)
    exact = possible <= count and possible * mean_draws(design) <= most
    return (possible - 1, True) if exact else (count, False)


def mean_draws(design: Design) -> int:
    """Return the number of means with which each of all permutations is used, if a statistic uses means.

    The mean that equalizing subtracted (`homolog.statistics.statistics`) is replaced by the values of each
    subject in turn, with both signs. It thus has the covariance of the data without randomness.
    """
    return 1 if design.exchange is Exchange.SIGNS else 2 * len(design.tested)


def draw_permutations(
    design: Design, count: int, *, chunk: int, seed: int, exhaustive: bool = True, means: bool = False
) -> Iterator[PermutedDesigns]:
    """Yield random permutations in chunks, or each distinct one if there are no more than `count`.

    Parameters
    ----------
    design : Design
        The design whose rows, or signs, are exchanged.
    count : int
        Total number of permutations.
    chunk : int
        Largest number of permutations per chunk.
    seed : int
        Same seed, same permutations, for any size of the chunks.
    exhaustive : bool
        Whether to yield each distinct permutation once if there are no more than `count`; otherwise
        permutations are always drawn.
    means : bool
        Whether to combine each of all permutations with each of its means, one after another.
    """
    if exhaustive and permutation_count(design, count)[1]:
        yield from _all_permutations(design, chunk, means=means)
        return
    generator, of_signs = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    subjects = len(design.tested)
    for start in range(0, count, chunk):
        size = min(chunk, count - start)
        if design.exchange is Exchange.SIGNS:
            signs = 2.0 * generator.integers(0, 2, size=(size, subjects, 1)) - 1.0
            yield PermutedDesigns(signs * design.tested, np.zeros((size, subjects, 0)))
        else:
            order = generator.random((size, subjects)).argsort(axis=1)
            yield PermutedDesigns(
                design.tested[order], design.covariates[order], _signs(of_signs, size, subjects)
            )


def null_distribution(
    statistic: Callable[[PermutedDesigns], FloatArray],
    design: Design,
    permutations: int,
    *,
    chunk: int,
    seed: int,
    means: bool = False,
    tick: Tick = no_tick,
    message: str = "permutations",
) -> FloatArray:
    """Return a statistic of each permutation, shape (P,); their number is that of `permutation_count`.

    If all permutations are combined with means (`mean_draws`), it has a value for each combination.

    Parameters
    ----------
    statistic : callable
        Returns its values (c,) for c permuted designs.
    design, permutations, chunk, seed, means
        See `draw_permutations`.
    tick : Tick
        Progress and cancellation.
    message : str
        Progress message.
    """
    count, exact = permutation_count(design, permutations)
    count *= mean_draws(design) if exact and means else 1
    values, done = np.empty(count), 0
    for draws in draw_permutations(design, permutations, chunk=chunk, seed=seed, means=means):
        tick(done / max(count, 1), message)
        values[done : done + len(draws.tested)] = statistic(draws)
        done += len(draws.tested)
    return values


def permutation_p_value(
    observed: FloatArray | float, null_statistics: FloatArray, permutations: int | None = None
) -> FloatArray:
    """Return the share of permutations at least as extreme, including the observed labels.

    Parameters
    ----------
    observed : (...) array or float
        Statistics of the observed labels, larger meaning more extreme.
    null_statistics : (P,) array
        The statistic, or its maximum over the surface, of each permutation.
    permutations : int, optional
        Number of permutations, if there are several statistics of each.

    Returns
    -------
    (...) array
        ``(b + 1) / (P + 1)``, never zero (Phipson and Smyth 2010).
    """
    count = len(null_statistics) if permutations is None else permutations
    ordered = np.sort(null_statistics)
    limit = subtract_rounding(np.asarray(observed, dtype=np.float64))
    beyond = len(ordered) - np.searchsorted(ordered, limit, side="left")
    return np.asarray((beyond * (count / max(len(ordered), 1)) + 1.0) / (count + 1.0), np.float64)


def subtract_rounding(observed: FloatArray) -> FloatArray:
    """Return statistics reduced by their rounding error."""
    limit: FloatArray = observed - _ROUNDING * np.abs(observed)
    return limit


def _kinds(design: Design) -> IntArray:
    """Return the kind of each subject's row; rows of one kind are equal."""
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


def _all_permutations(design: Design, chunk: int, *, means: bool) -> Iterator[PermutedDesigns]:
    subjects = len(design.tested)
    if design.exchange is Exchange.SIGNS:
        numbers = np.arange(1, 2**subjects)
        signs = 1.0 - 2.0 * ((numbers[:, None] >> np.arange(subjects)) & 1)
        for start in range(0, len(signs), chunk):
            part = signs[start : start + chunk, :, None]
            yield PermutedDesigns(part * design.tested, np.zeros((len(part), subjects, 0)))
        return
    kinds = _kinds(design)
    first_of = np.unique(kinds, return_index=True)[1]
    orders = np.array(
        [arrangement for arrangement in _distinct_orders(kinds.tolist()) if arrangement != kinds.tolist()]
    )
    draws = mean_draws(design) if means else 1
    each: FloatArray = np.concatenate([np.eye(subjects), -np.eye(subjects)]) * subjects**0.5
    for start in range(0, draws * len(orders), chunk):
        which = np.arange(start, min(start + chunk, draws * len(orders)))
        rows = first_of[orders[which // draws]]
        own = each[which % draws] if means else None
        yield PermutedDesigns(design.tested[rows], design.covariates[rows], own)


def _distinct_orders(kinds: list[int]) -> Iterator[list[int]]:
    """Yield each distinct order of the kinds once."""
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
