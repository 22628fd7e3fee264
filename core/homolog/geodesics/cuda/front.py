"""The front of a batch of clusters: allocation, and launches of the kernels that advance it."""

from typing import Any

import warp as wp

from homolog.geodesics.cuda.kernels import block as block_kernels
from homolog.geodesics.cuda.kernels import front as front_kernels
from homolog.geodesics.kernels.local_solver import UNREACHED
from homolog.geodesics.kernels.lookup import LANES

__all__ = [
    "advance",
    "clear",
    "largest_batch",
    "largest_patch",
    "make_front",
    "start",
]

_LAST_INT = 2**31 - 1
"""Kernels index memory with 32-bit integers."""


def largest_batch(n: int, capacity: int, scratch: int) -> int:
    """Return the number of clusters whose state fits into `scratch` bytes; at least one.

    Parameters
    ----------
    n : int
        Vertices of the largest mesh.
    capacity : int
        Vertices of the largest patch.
    """
    bytes_per_vertex = 4 * LANES + 4  # u; pending
    bytes_per_item = 4  # patch
    fitting = scratch // (bytes_per_vertex * n + bytes_per_item * capacity)
    return max(1, min(fitting, _LAST_INT // (LANES * n)))


def largest_patch(sources: Any, n_clusters: int, halo: float) -> int:  # noqa: ANN401 - a wp.struct has no type
    """Return the number of vertices in the largest patch, halo included."""
    size = wp.zeros(n_clusters, dtype=wp.int32)
    block_dim = block_kernels.BLOCK_DIM
    wp.launch(
        front_kernels.count_patch_vertices,
        (n_clusters, block_dim),
        [sources, halo, block_dim, size],
        block_dim=block_dim,
    )
    return int(size.numpy().max())


def make_front(batch: int, n: int, capacity: int, lanes: int = LANES) -> Any:  # noqa: ANN401
    """Allocate a front on the current device: `batch` clusters, `n` vertices, patches of `capacity`."""
    front = block_kernels.Front()
    front.u = wp.empty((batch, n, lanes), dtype=wp.float32)
    front.pending = wp.empty((batch, n), dtype=wp.int32)
    front.patch = wp.empty((batch, capacity), dtype=wp.int32)
    front.size = wp.empty(batch, dtype=wp.int32)
    front.bucket_count = wp.empty((batch, int(block_kernels.N_BUCKETS)), dtype=wp.int32)
    for name in ("active_item", "active_pending"):
        setattr(front, name, wp.empty(batch * int(block_kernels.BAND_SIZE), dtype=wp.int32))
    return front


def clear(front: Any) -> None:  # noqa: ANN401
    """Reset all distances to UNREACHED."""
    front.u.fill_(float(UNREACHED))
    front.pending.zero_()


def start(front: Any, sources: Any, clusters: range, halo: float) -> None:  # noqa: ANN401
    """Build the patches of some clusters; distances are 0 at their sources and UNREACHED elsewhere.

    Parameters
    ----------
    halo : float
        How far [mm] beyond its patch a cluster's distances are read: the longest edge.
    """
    block_dim = _block_dim(front)
    inputs = [front, sources, clusters.start, halo, block_dim]
    wp.launch(front_kernels.build_patches, (len(clusters), block_dim), inputs=inputs, block_dim=block_dim)


def advance(front: Any, sources: Any, clusters: range) -> None:  # noqa: ANN401
    """Advance some clusters to convergence, from the patches and pending triangles of the front."""
    block_dim = _block_dim(front)
    inputs = [front, sources, clusters.start, block_dim]
    wp.launch(front_kernels.advance_front, (len(clusters), block_dim), inputs=inputs, block_dim=block_dim)


def _block_dim(front: Any) -> int:  # noqa: ANN401
    return 1 if front.u.device.is_cpu else block_kernels.BLOCK_DIM
