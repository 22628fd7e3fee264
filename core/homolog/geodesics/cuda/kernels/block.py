"""The state that a thread block shares for one cluster: distances and active vertices.

On CUDA one thread block solves one cluster; on a CPU the block is one thread. A vertex is active if a
neighbour's distance decreased since its last update. Each pass compacts and clears the active vertices of a
band and distributes them over the block's threads. A vertex that decreases writes its distance and then
activates its neighbours. Distances only ever decrease, so that reading one while another thread lowers it is
harmless.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.fans import Fans, Groups
from homolog.geodesics.kernels.local_solver import DistanceLimits

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})

N_BUCKETS = wp.constant(256)
"""Buckets of the radix sort that orders vertices by distance."""
BLOCK_DIM = 256
"""Threads that share one cluster on a GPU: sixteen vertices at a time."""
BAND_SIZE = wp.constant(512)
"""Vertices, in patch order, that converge together; a multiple of BLOCK_DIM."""


@wp.struct
class Front:
    """The state of a batch of clusters."""

    u: wp.array3d(dtype=wp.float32)  # (B, V, L) distances, UNREACHED where there are none yet
    active: wp.array2d(dtype=wp.int32)  # (B, V) 1 for a vertex that awaits an update
    patch: wp.array2d(dtype=wp.int32)  # (B, P) vertices, near to far
    size: wp.array(dtype=wp.int32)  # (B,) vertices in the patch
    bucket_count: wp.array2d(dtype=wp.int32)  # (B, N_BUCKETS) vertices in each bucket; then its end
    active_vertex: wp.array2d(dtype=wp.int32)  # (B, BAND_SIZE) active vertices of the current band


@wp.struct
class Sources:
    """All clusters of a cohort and their meshes."""

    groups: Groups
    shape: wp.array(dtype=wp.int32)  # (C,) of each cluster
    first: wp.array(dtype=wp.int32)  # (S + 1,) first vertex of each shape
    limits: wp.array(dtype=DistanceLimits)  # (S,)
    fans: Fans


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def block_sync():
    """Wait for all threads of the block; their writes are visible afterwards."""
    ...


@wp.func_native("""
    int* active = front.active.data + b * front.active.shape[1];
    const int* patch = front.patch.data + b * front.patch.shape[1];
    int* vertices = front.active_vertex.data + b * front.active_vertex.shape[1];
#if defined(__CUDA_ARCH__)
    // Stream compaction in order: ballot per warp, scan of the counts, scatter. An unordered list would need
    // a fifth more updates.
    constexpr int PIECES_PER_WARP = 2;
    __shared__ int counts[32];
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    int flags[PIECES_PER_WARP];
    unsigned votes[PIECES_PER_WARP];
    #pragma unroll
    for (int i = 0; i < PIECES_PER_WARP; ++i) {
        const int piece = warp + i * warps, k = first + 32 * piece + lane;
        flags[i] = k < end ? active[patch[k]] : 0;
        votes[i] = __ballot_sync(0xffffffffu, flags[i]);
        if (lane == 0 && piece < 32)
            counts[piece] = __popc(votes[i]);
    }
    __syncthreads();
    int upto = lane < PIECES_PER_WARP * warps ? counts[lane] : 0;
    for (int step = 1; step < 32; step *= 2) {
        const int before = __shfl_up_sync(0xffffffffu, upto, step);
        upto += lane < step ? 0 : before;
    }
    const int n = __shfl_sync(0xffffffffu, upto, 31);
    #pragma unroll
    for (int i = 0; i < PIECES_PER_WARP; ++i) {
        const int piece = warp + i * warps, k = first + 32 * piece + lane;
        const int before = __shfl_sync(0xffffffffu, upto, piece - 1 & 31);
        if (flags[i]) {
            const int at = (piece ? before : 0) + __popc(votes[i] & ((1u << lane) - 1u));
            active[patch[k]] = 0;
            vertices[at] = patch[k];
        }
    }
    __syncthreads();
    return n;
#else
    int n = 0;
    for (int k = first; k < end; ++k) {
        if (active[patch[k]]) {
            vertices[n++] = patch[k];
            active[patch[k]] = 0;
        }
    }
    return n;
#endif
""")
def compact_active(front: Front, b: int, first: int, end: int) -> int:
    """List the active vertices among positions first … end of a patch, and clear them; return their number.

    On CUDA a thread handles at most two positions. The block must synchronize before the next call.
    """
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __threadfence_block();
#endif
""")
def memory_fence():
    """Order this thread's earlier writes before its later reads, as seen by the block."""
    ...


@wp.func
def scan_buckets(front: Front, b: int, thread: int):
    """Replace the number of vertices in each bucket by the bucket's start (exclusive scan)."""
    block_sync()
    if thread == 0:
        total = int(0)
        for bucket in range(N_BUCKETS):
            n = front.bucket_count[b, bucket]
            front.bucket_count[b, bucket] = total
            total += n
    block_sync()
