"""Encode the distances of a batch of clusters into tables, on CUDA."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.local_solver import UNREACHED, DistanceLimits, encode, mean_code
from homolog.geodesics.kernels.lookup import LANES, MISSING

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.kernel
def mark_reached(
    u: wp.array3d(dtype=wp.float32),
    patch: wp.array2d(dtype=wp.int32),
    size: wp.array(dtype=wp.int32),
    limits: DistanceLimits,
    is_reached: wp.array2d(dtype=wp.int32),
):
    """Mark the vertices of each patch that any source reaches; thread (cluster, position)."""
    b, k = wp.tid()
    nearest = float(UNREACHED)
    if k < size[b]:
        for lane in range(LANES):
            nearest = wp.min(nearest, u[b, patch[b, k], lane])
    is_reached[b, k] = wp.where(nearest <= limits.max_encoded, 1, 0)


@wp.kernel
def store_front_blocks(
    u: wp.array3d(dtype=wp.float32),
    patch: wp.array2d(dtype=wp.int32),
    limits: DistanceLimits,
    running_count: wp.array2d(dtype=wp.int32),
    offset: int,
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    blocks: wp.array2d(dtype=wp.uint16),
):
    """Encode the blocks of some clusters; `running_count` is the inclusive scan of `is_reached`."""
    b, k = wp.tid()
    before = int(0)
    if b > 0:
        before = running_count[b - 1, running_count.shape[1] - 1]
    if k == 0:
        start[b] = offset + before
    previous = before
    if k > 0:
        previous = running_count[b, k - 1]
    if running_count[b, k] > previous:
        v = patch[b, k]
        row[b, v] = wp.uint16(previous - before)
        for lane in range(LANES):
            blocks[previous, lane] = encode(u[b, v, lane], limits)


@wp.kernel
def symmetrize_blocks(
    members: wp.array2d(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    blocks: wp.array2d(dtype=wp.uint16),
):
    """Replace both directions of every pair by their mean; thread (cluster, other cluster, member of that).

    The thread of the later cluster writes both directions. A distance that only one direction reaches is
    dropped by the thread of that direction.
    """
    cluster, other, back_lane = wp.tid()
    v = members[other, back_lane]
    if v < 0:
        return
    here = int(row[cluster, v])
    if here == MISSING:
        return
    k = start[cluster] + here
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            back_row = int(row[other, m])
            if back_row == MISSING:
                blocks[k, lane] = wp.uint16(MISSING)
            elif other < cluster or (other == cluster and m < v):
                back_k = start[other] + back_row
                mean = mean_code(int(blocks[k, lane]), int(blocks[back_k, back_lane]))
                blocks[k, lane] = mean
                blocks[back_k, back_lane] = mean
