"""Pairs of particles that are exchanged."""

import numpy as np

from homolog.arrays import IntArray
from homolog.geometry import fit_rotation
from homolog.inspection.indicators import distance_residuals, swap_log_ratios
from homolog.inspection.located_particles import LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood

__all__ = ["swapped_pairs"]

_BOTH, _EITHER = 0.5, 0.8
"""Largest ratio of residuals after and before an exchange: joint, and of each particle."""


def swapped_pairs(
    subject: int, candidates: IntArray, located: LocatedParticles, consensus: Neighbourhood
) -> list[IntArray]:
    """Return pairs of a subject's particles that fit much better when exchanged, the clearest first.

    Parameters
    ----------
    subject : int
        Index of the subject.
    candidates : (n,) int array
        Suspicious particles; each is in at most one pair.
    located : LocatedParticles
        Particles of all subjects.
    consensus : Neighbourhood
        The consensus of all subjects.
    """
    if len(candidates) < 2:
        return []
    now = distance_residuals(swap_log_ratios(candidates, candidates, subject, located, consensus))
    candidates, now = candidates[now > 0.0], now[now > 0.0]
    n = len(candidates)
    if n < 2:
        return []
    occupant, counterpart = (item.ravel() for item in np.meshgrid(candidates, candidates, indexing="ij"))
    fit = distance_residuals(swap_log_ratios(occupant, counterpart, subject, located, consensus)).reshape(
        n, n
    )
    left = (fit + fit.T) / (now[:, None] + now[None, :])
    left[np.maximum(fit / now[None, :], fit.T / now[:, None]) > _EITHER] = np.inf
    pairs = []
    taken: set[int] = set()
    for at in np.argsort(left, axis=None, kind="stable"):
        i, j = divmod(int(at), n)
        if left[i, j] > _BOTH:
            break
        pair = np.sort(candidates[[i, j]])
        if i < j and not taken & {i, j} and _is_reversed(subject, pair, located, consensus):
            taken |= {i, j}
            pairs.append(pair)
    return pairs


def _is_reversed(subject: int, pair: IntArray, located: LocatedParticles, consensus: Neighbourhood) -> bool:
    """Return whether the vector between two particles is reversed, relative to their neighbours.

    Only then does an exchange reduce their distances from their usual positions (u, v), for any common
    shift of their positions (a, b): |a - u|² + |b - v|² exceeds |b - u|² + |a - v|² by -2 (b - a)·(v - u).
    """
    near = np.setdiff1d(consensus.neighbours[pair], pair)
    expected, own = consensus.shape, located.world[subject]
    moved, still = (points[near] - points[near].mean(axis=0) for points in (own, expected))
    left, right, _ = fit_rotation(moved.T @ still)
    between = left @ right @ (expected[pair[1]] - expected[pair[0]])
    return bool(between @ (own[pair[1]] - own[pair[0]]) < 0.0)
