"""The front of all clusters of a batch, advanced and amended: launches of the front's kernels."""

from typing import Any

import warp as wp

from homolog.geodesics import crew_kernels, front_kernels
from homolog.geodesics import front_amend_kernels as amending
from homolog.geodesics import front_bearing_kernels as bearings
from homolog.geodesics.kernels import FAR
from homolog.geodesics.lookup import LANES

__all__ = [
    "advance",
    "amend",
    "clear",
    "largest_batch",
    "largest_patch",
    "make_amendments",
    "make_front",
    "start",
]

_LAST_INT = 2**31 - 1
"""Kernels count places in memory in 32 bits."""


def largest_batch(n: int, capacity: int, scratch: int) -> int:
    """Return for how many clusters there is room in so many bytes, one at least.

    Parameters
    ----------
    n : int
        Vertices of the largest mesh.
    capacity : int
        Vertices of the largest patch.
    """
    kept = int(bearings.KEPT)
    for_vertex = 4 * 4 * LANES + 4  # u, bearing, trust, amendment; dirty
    for_place = 4 * 2 * kept * LANES + 4 * 2  # gains, words; patch, order
    fitting = scratch // (for_vertex * n + for_place * capacity)
    return max(1, min(fitting, _LAST_INT // (LANES * max(n, kept * capacity))))


def largest_patch(sources: Any, n_clusters: int, skin: float) -> int:  # noqa: ANN401 - a wp.struct has no type
    """Return how many vertices the largest patch of all clusters has, with the skin around it."""
    size = wp.zeros(n_clusters, dtype=wp.int32)
    crew = crew_kernels.CREW
    wp.launch(front_kernels.measure_patches, (n_clusters, crew), [sources, skin, crew, size], block_dim=crew)
    return int(size.numpy().max())


def make_front(batch: int, n: int, capacity: int, lanes: int = LANES) -> Any:  # noqa: ANN401
    """Return a front of so many clusters, vertices, vertices a patch and lanes on the current device."""
    front = crew_kernels.Front()
    front.u = wp.empty((batch, n, lanes), dtype=wp.float32)
    front.dirty = wp.empty((batch, n), dtype=wp.int32)
    front.patch = wp.empty((batch, capacity), dtype=wp.int32)
    front.size = wp.empty(batch, dtype=wp.int32)
    front.filled = wp.empty((batch, int(crew_kernels.BINS)), dtype=wp.int32)
    for name in ("listed", "news"):
        setattr(front, name, wp.empty(batch * int(crew_kernels.CREW_BAND), dtype=wp.int32))
    return front


def make_amendments(batch: int, n: int, capacity: int, lanes: int = LANES) -> Any:  # noqa: ANN401
    """Return what `amend` needs for such a front, on the current device."""
    amends = bearings.FrontAmendments()
    for name in ("bearing", "trust", "amendment"):
        setattr(amends, name, wp.empty((batch, n, lanes), dtype=wp.float32))
    kept = int(bearings.KEPT)
    amends.gain = wp.empty((batch, capacity, kept * lanes), dtype=wp.float32)
    amends.word = wp.empty((batch, capacity, kept * lanes), dtype=wp.uint32)
    amends.order = wp.empty((batch, capacity), dtype=wp.int32)
    amends.reached = wp.empty(batch, dtype=wp.int32)
    return amends


def clear(front: Any) -> None:  # noqa: ANN401
    """Forget all distances."""
    front.u.fill_(float(FAR))
    front.dirty.zero_()


def start(front: Any, sources: Any, clusters: range, skin: float) -> None:  # noqa: ANN401
    """Lay the patches of some clusters, all distances FAR but those of their sources to themselves.

    Parameters
    ----------
    skin : float
        How far [mm] beyond its patch a cluster's distances are read: the longest edge.
    """
    crew = _crew(front)
    inputs = [front, sources, clusters.start, skin, crew]
    wp.launch(front_kernels.lay_patches, (len(clusters), crew), inputs=inputs, block_dim=crew)


def advance(front: Any, sources: Any, clusters: range, element: int) -> None:  # noqa: ANN401
    """Advance some clusters until nothing changes; the front knows their patches and what is dirty."""
    crew = _crew(front)
    inputs = [front, sources, clusters.start, element, crew]
    wp.launch(front_kernels.advance_front, (len(clusters), crew), inputs=inputs, block_dim=crew)


def amend(front: Any, amends: Any, sources: Any, turns: Any, clusters: range) -> None:  # noqa: ANN401
    """Amend the distances of some clusters whose front has come to rest."""
    crew = _crew(front)
    dim = (len(clusters), crew)
    order = [front, amends, sources, clusters.start, crew]
    wp.launch(bearings.order_front, dim, order, block_dim=crew)
    inputs = [front, amends, sources, turns, clusters.start, crew]
    for kernel in (bearings.find_front_bearings, amending.settle_front):
        wp.launch(kernel, dim, inputs=inputs, block_dim=crew)


def _crew(front: Any) -> int:  # noqa: ANN401
    return 1 if front.u.device.is_cpu else crew_kernels.CREW
