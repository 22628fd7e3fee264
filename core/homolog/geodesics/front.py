"""The front of all clusters of a batch, advanced and amended: launches of the front's kernels."""

from typing import Any

import warp as wp

from homolog.geodesics import front_amend_kernels as amending
from homolog.geodesics import front_kernels
from homolog.geodesics.lookup import LANES

__all__ = ["BYTES_PER_VERTEX", "advance", "amend", "make_amendments", "make_front"]

CREW = 256
"""Threads that share one cluster on a GPU: sixteen vertices at a time."""
BYTES_PER_VERTEX = 4 * 6 * LANES + 4 + 12
"""Scratch of a cluster for each vertex: u, bearings, trust, amendments, gains, words; queued, lists."""


def make_front(batch: int, n: int, lanes: int = LANES) -> Any:  # noqa: ANN401 - a wp.struct has no type
    """Return a front of so many clusters, vertices and lanes, on the current device."""
    front = front_kernels.Front()
    front.u = wp.empty((batch, n, lanes), dtype=wp.float32)
    front.queued = wp.empty((batch, n), dtype=wp.int32)
    front.lists = wp.empty((3, batch, n), dtype=wp.int32)
    front.counts = wp.empty((4, batch), dtype=wp.int32)
    return front


def make_amendments(batch: int, n: int, lanes: int = LANES) -> Any:  # noqa: ANN401
    """Return what `amend` needs for such a front, on the current device."""
    amends = amending.FrontAmendments()
    for name in ("bearing", "trust", "amendment", "gain"):
        setattr(amends, name, wp.empty((batch, n, lanes), dtype=wp.float32))
    amends.word = wp.empty((batch, n, lanes), dtype=wp.uint32)
    amends.filled = wp.empty((batch, int(amending.BINS)), dtype=wp.int32)
    amends.moved = wp.empty(batch, dtype=wp.int32)
    return amends


def advance(front: Any, sources: Any, clusters: range, element: int) -> None:  # noqa: ANN401
    """Advance some clusters until nothing changes; the front has what is to be done in step 1."""
    crew = _crew(front)
    inputs = [front, sources, clusters.start, element, crew]
    wp.launch(front_kernels.advance_front, (len(clusters), crew), inputs=inputs, block_dim=crew)


def amend(front: Any, amends: Any, sources: Any, turns: Any, clusters: range) -> None:  # noqa: ANN401
    """Amend the distances of some clusters whose front has come to rest."""
    crew = _crew(front)
    inputs = [front, amends, sources, turns, clusters.start, crew]
    wp.launch(amending.amend_front, (len(clusters), crew), inputs=inputs, block_dim=crew)


def _crew(front: Any) -> int:  # noqa: ANN401
    return 1 if front.u.device.is_cpu else CREW
