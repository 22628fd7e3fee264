"""The patch of a cluster on one CPU core: its state, memory access, and the order of its vertices."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.fans import Groups
from homolog.geodesics.kernels.local_solver import UNREACHED
from homolog.geodesics.kernels.lookup import LANES
from homolog.geodesics.kernels.memory import load_int

# Lane loops must not be unrolled by Warp: the compiler then vectorizes them.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

N_BUCKETS = wp.constant(256)
FLAGS_PER_WORD = 8
"""Flags that are tested together, as one 64-bit word."""
Lanes = wp.types.vector(length=LANES, dtype=wp.float32)
LaneCodes = wp.types.vector(length=LANES, dtype=wp.uint16)
LaneCounts = wp.types.vector(length=LANES, dtype=wp.int32)


@wp.struct
class Scratch:
    """State of one cluster; each thread has one and reuses it."""

    u: wp.array(dtype=Lanes)  # (V,) distances, UNREACHED outside the patch
    patch_index: wp.array(dtype=wp.int32)  # (V,) position in the patch; the last entry of active outside it
    active: wp.array(dtype=wp.uint8)  # (V + 2 * FLAGS_PER_WORD,) in patch order: 1 awaits an update
    patch: wp.array(dtype=wp.int32)  # (V,) vertices of the patch, near to far
    by_cluster: wp.array(dtype=wp.int32)  # (V,) the same, cluster by cluster
    bucket_index: wp.array(dtype=wp.int32)  # (V,) bucket of each vertex in an unsorted list
    bucket: wp.array(dtype=wp.int32)  # (N_BUCKETS + 1,) counts, then ends
    size: wp.array(dtype=wp.int32)  # (1,) vertices in the patch


# Direct memory access: Warp's indexing, which supports strides and negative indices, takes as many
# instructions as the arithmetic.
@wp.func_native("return values.data[index];")
def load_lanes(values: wp.array(dtype=Lanes), index: int) -> Lanes:
    """Return a vertex's value in all lanes."""
    ...


@wp.func_native("values.data[index] = value;")
def store_lanes(values: wp.array(dtype=Lanes), index: int, value: Lanes):
    """Set a vertex's value in all lanes."""
    ...


@wp.func_native("return values.data[index];")
def load_float(values: wp.array(dtype=wp.float32), index: int) -> float:
    """Return a number of a list."""
    ...


@wp.func_native("return blocks.data[index].c[lane];")
def load_code(blocks: wp.array(dtype=LaneCodes), index: int, lane: int) -> int:
    """Return a code of a row."""
    ...


@wp.func_native("return flags.data[index];")
def load_flag(flags: wp.array(dtype=wp.uint8), index: int) -> int:
    """Return one of the flags."""
    ...


@wp.func_native("""
    wp::uint64 word;
    memcpy(&word, flags.data + index, sizeof(word));
    return word != 0;
""")
def any_flag_in_word(flags: wp.array(dtype=wp.uint8), index: int) -> bool:
    """Return whether any of eight flags is set."""
    ...


@wp.func_native("flags.data[index] = value;")
def set_flag(flags: wp.array(dtype=wp.uint8), index: int, value: int):
    """Set one of the flags."""
    ...


@wp.func_native("flags.data[index] |= value;")
def or_flag(flags: wp.array(dtype=wp.uint8), index: int, value: int):
    """Set one of the flags if the value is 1."""
    ...


@wp.func
def clear_patch(scratch: Scratch):
    """Reset the state of the previous cluster's patch."""
    outside = scratch.active.shape[0] - 1
    for p in range(scratch.size[0]):
        v = load_int(scratch.patch, p)
        scratch.u[v] = Lanes(UNREACHED)
        scratch.patch_index[v] = outside


@wp.func
def sort_into_buckets(
    scratch: Scratch, n: int, unsorted: wp.array(dtype=wp.int32), order: wp.array(dtype=wp.int32)
):
    """Sort n vertices by their buckets (counting sort); entry k + 1 holds the count of bucket k."""
    for k in range(N_BUCKETS):
        scratch.bucket[k + 1] += scratch.bucket[k]
    for k in range(n):
        index = load_int(scratch.bucket_index, k)
        p = load_int(scratch.bucket, index)
        scratch.bucket[index] = p + 1
        order[p] = load_int(unsorted, k)


@wp.func
def build_patch(
    scratch: Scratch, position: wp.array(dtype=wp.vec3), groups: Groups, cluster: int, max_distance: float
):
    """List the vertices that may be within max_distance of a cluster, near to far."""
    for k in range(N_BUCKETS + 1):
        scratch.bucket[k] = 0
    centre = groups.centre[cluster]
    radius = groups.radius[cluster] + max_distance
    scale = 0.9999 * float(N_BUCKETS) / radius
    n = int(0)
    for other in range(groups.centre.shape[0]):
        if wp.length(groups.centre[other] - centre) > radius + groups.radius[other]:
            continue
        for lane in range(LANES):
            v = groups.members[other, lane]
            if v >= 0:
                distance = wp.length(position[v] - centre)
                if distance <= radius:
                    k = int(distance * scale)
                    scratch.by_cluster[n] = v
                    scratch.bucket_index[n] = k
                    scratch.bucket[k + 1] += 1
                    n += 1
    sort_into_buckets(scratch, n, scratch.by_cluster, scratch.patch)
    for p in range(n):
        scratch.patch_index[scratch.patch[p]] = p
    scratch.size[0] = n
