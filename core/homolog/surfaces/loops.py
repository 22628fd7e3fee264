"""Loops along the borders of a mesh, and the nearly flat part of a loop."""

import numpy as np

from homolog.arrays import FloatArray, IntArray

__all__ = ["apart", "loops", "straightened"]

_MOST_PATCHES = 200
"""Largest number of patches that meet at one border; more are a soup of loose faces."""
_ROUNDS = 20
_FEWEST = 12
"""Least number of sides of a loop whose notches are closed apart."""
_KEPT = 0.7
"""Least share of the straightened loop's length that belongs to the rim; the rest closes notches."""


def loops(sides: IntArray, patches: IntArray) -> list[IntArray]:
    """Divide the sides of one border into loops that visit each vertex once.

    A hole next to a rim, or a face that hangs by one corner, shares a vertex with it: the border then visits
    that vertex twice.

    Parameters
    ----------
    sides : (N, 2) int array
        Directed sides that share vertices.
    patches : (N,) int array
        Patch of each side; a loop belongs to one.

    Returns
    -------
    list of int arrays
        Indices of the sides of each loop, in order. Sides that form no loop are one item, in no order.
    """
    if len(np.unique(patches)) > _MOST_PATCHES:
        return [np.arange(len(sides))]
    closed: list[IntArray] = []
    loose: list[int] = []
    for patch in np.unique(patches):
        leaving: dict[int, list[int]] = {}
        for side in np.flatnonzero(patches == patch)[::-1].tolist():
            leaving.setdefault(int(sides[side, 0]), []).append(side)
        for start in sorted(leaving):
            walk: list[int] = []
            reached = {start: 0}  # number of steps of the walk after which each of its vertices was reached
            at = start
            while leaving.get(at):
                walk.append(leaving[at].pop())
                at = int(sides[walk[-1], 1])
                if at in reached:
                    loop = walk[reached[at] :]
                    del walk[reached[at] :]
                    for side in loop[:-1]:
                        del reached[int(sides[side, 1])]
                    closed.append(np.array(loop))
                    reached[at] = len(walk)
                else:
                    reached[at] = len(walk)
            loose += walk
    return [*closed, *([np.array(loose)] if loose else [])]


def straightened(points: FloatArray, flat: float, jagged: float) -> IntArray | None:
    """Return the vertices of a loop near its plane, if only notches and spikes lie outside.

    The plane is that of least absolute distances, weighted by the length of the sides.

    Parameters
    ----------
    points : (N, 3) array
        Vertices in their order.
    flat, jagged : float
        Largest distance from the plane relative to the width; and if it is less than the median side.

    Returns
    -------
    (M,) int array or None
        Indices of the vertices near the plane; None if sides between them are too small a part of the loop.
    """
    if len(points) < _FEWEST:
        return None
    lengths = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    share = 0.5 * (lengths + np.roll(lengths, 1))
    weights = share.copy()
    for _ in range(_ROUNDS):
        middle = weights @ points / weights.sum()
        arms = points - middle
        normal = np.linalg.eigh((arms * weights[:, None]).T @ arms)[1][:, 0]
        off = np.abs(arms @ normal)
        width = 2.0 * float(np.linalg.norm(arms[off <= np.median(off)], axis=1).max())
        weights = share / np.maximum(off, 1e-3 * width)
    near = np.flatnonzero(off <= max(flat * width, min(jagged * width, float(np.median(lengths)))))
    if len(near) < 3:
        return None
    own = lengths[near[np.append(np.diff(near) == 1, near[0] + len(points) - near[-1] == 1)]].sum()
    around = np.linalg.norm(np.roll(points[near], -1, axis=0) - points[near], axis=1).sum()
    return near if own >= _KEPT * around else None


def apart(loop: IntArray, near: IntArray) -> list[IntArray]:
    """Return the loops (vertices in order) of the notches that straightening cuts off.

    Parameters
    ----------
    loop : (N,) int array
        Vertices of the whole loop in order.
    near : (M,) int array
        Indices into it of the vertices that remain, ascending.
    """
    ends = np.append(near[1:], near[0] + len(loop))
    return [
        loop[np.arange(start, end + 1) % len(loop)]
        for start, end in zip(near, ends, strict=True)
        if end > start + 1
    ]
