"""Loops along the borders of a mesh."""

import numpy as np

from homolog.arrays import IntArray

__all__ = ["loops"]

_MOST_PATCHES = 200
"""Largest number of patches that meet at one border; more are a soup of loose faces."""


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
