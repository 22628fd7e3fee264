"""The front of a batch of clusters: its allocation and the launches that advance it."""

from typing import Any

import warp as wp

from homolog.geodesics.cuda.kernels import block as block_kernels
from homolog.geodesics.cuda.kernels import front as front_kernels
from homolog.geodesics.kernels.local_solver import UNREACHED
from homolog.geodesics.kernels.lookup import LANES

__all__ = ["advance", "clear", "make_front", "start"]


def make_front(batch: int, n: int, lanes: int = LANES) -> Any:  # noqa: ANN401
    """Allocate a front on the current device for `batch` clusters of meshes of at most `n` vertices."""
    front = block_kernels.Front()
    front.u = wp.empty((batch, n, lanes), dtype=wp.float32)
    front.active = wp.empty((batch, n), dtype=wp.int32)
    front.patch = wp.empty((batch, n), dtype=wp.int32)
    front.size = wp.empty(batch, dtype=wp.int32)
    front.bucket_count = wp.empty((batch, int(block_kernels.N_BUCKETS)), dtype=wp.int32)
    front.active_vertex = wp.empty((batch, int(block_kernels.BAND_SIZE)), dtype=wp.int32)
    return front


def clear(front: Any) -> None:  # noqa: ANN401
    """Reset all distances to UNREACHED."""
    front.u.fill_(float(UNREACHED))
    front.active.zero_()


def start(front: Any, sources: Any, clusters: range) -> None:  # noqa: ANN401
    """Build the patches of some clusters; distances are 0 at their sources and UNREACHED elsewhere."""
    clear(front)
    _launch(front_kernels.build_patches, front, sources, clusters)


def advance(front: Any, sources: Any, clusters: range) -> None:  # noqa: ANN401
    """Advance some clusters to convergence, from the patches and active vertices of the front."""
    _launch(front_kernels.advance_front, front, sources, clusters)


def _launch(kernel: Any, front: Any, sources: Any, clusters: range) -> None:  # noqa: ANN401
    block_dim = 1 if front.u.device.is_cpu else block_kernels.BLOCK_DIM
    inputs = [front, sources, clusters.start, block_dim]
    wp.launch(kernel, (len(clusters), block_dim), inputs=inputs, block_dim=block_dim)
