"""Relabellings under the null hypothesis, and the p-values counted over them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from homolog.analysis.design import Design, Exchange
from homolog.arrays import FloatArray

__all__ = ["Relabelling", "counted_p", "relabellings"]

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
    """

    tested: FloatArray
    covariates: FloatArray


def relabellings(design: Design, count: int, *, chunk: int, seed: int) -> Iterator[Relabelling]:
    """Yield so many random relabellings in chunks.

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
    """
    generator = np.random.default_rng(seed)
    subjects = len(design.tested)
    for start in range(0, count, chunk):
        some = min(chunk, count - start)
        if design.exchange is Exchange.SIGNS:
            signs = 2.0 * generator.integers(0, 2, size=(some, subjects, 1)) - 1.0
            yield Relabelling(signs * design.tested, np.zeros((some, subjects, 0)))
        else:
            order = generator.random((some, subjects)).argsort(axis=1)
            yield Relabelling(design.tested[order], design.covariates[order])


def counted_p(observed: FloatArray | float, drawn: FloatArray) -> FloatArray:
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
    limit = np.asarray(observed, dtype=np.float64)
    limit = limit - _ROUNDING * np.abs(limit)
    beyond = len(ordered) - np.searchsorted(ordered, limit, side="left")
    return np.asarray((beyond + 1.0) / (len(ordered) + 1.0), np.float64)
