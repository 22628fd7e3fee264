"""The patch of a cluster, on one CPU core: scratch, how it is read, and the order that it is swept in."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import FAR
from homolog.geodesics.lookup import LANES
from homolog.geodesics.memory_kernels import int_at

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BUCKETS = wp.constant(256)
TOGETHER = 8
"""Flags that are looked at together."""
Lanes = wp.types.vector(length=LANES, dtype=wp.float32)
Codes = wp.types.vector(length=LANES, dtype=wp.uint16)
Counts = wp.types.vector(length=LANES, dtype=wp.int32)


@wp.struct
class Groups:
    """All clusters of a mesh."""

    members: wp.array2d(dtype=wp.int32)  # (C, LANES) vertices, -1 in lanes without one
    centre: wp.array(dtype=wp.vec3)  # (C,)
    radius: wp.array(dtype=wp.float32)  # (C,) distance of the farthest member from the centre


@wp.struct
class Scratch:
    """What one thread needs to solve one cluster after another."""

    u: wp.array(dtype=Lanes)  # (V,) distances, FAR outside the patch
    place: wp.array(dtype=wp.int32)  # (V,) in the patch; outside it, the place after all others
    dirty: wp.array(dtype=wp.uint8)  # (V + 2 * TOGETHER,) by place: 1 if the vertex awaits an update
    patch: wp.array(dtype=wp.int32)  # (V,) vertices of the patch, near to far
    found: wp.array(dtype=wp.int32)  # (V,) the same, cluster by cluster
    bin: wp.array(dtype=wp.int32)  # (V,) bucket of each vertex in a list that is to be sorted
    bucket: wp.array(dtype=wp.int32)  # (BUCKETS + 1,)
    size: wp.array(dtype=wp.int32)  # (1,) vertices in the patch


# Arrays are read as they lie in memory: Warp's own indexing, which allows for any strides and negative
# indices, takes as many instructions as what is computed from the values.
@wp.func_native("return values.data[at];")
def lanes_at(values: wp.array(dtype=Lanes), at: int) -> Lanes:
    """Return a vertex' lanes."""
    ...


@wp.func_native("values.data[at] = value;")
def put_lanes(values: wp.array(dtype=Lanes), at: int, value: Lanes):
    """Set a vertex' lanes."""
    ...


@wp.func_native("return values.data[at];")
def float_at(values: wp.array(dtype=wp.float32), at: int) -> float:
    """Return one of the numbers."""
    ...


@wp.func_native("return blocks.data[at].c[lane];")
def code_at(blocks: wp.array(dtype=Codes), at: int, lane: int) -> int:
    """Return a code of a row."""
    ...


@wp.func_native("return flags.data[at];")
def flag_at(flags: wp.array(dtype=wp.uint8), at: int) -> int:
    """Return one of the flags."""
    ...


@wp.func_native("""
    wp::uint64 eight;
    memcpy(&eight, flags.data + at, sizeof(eight));
    return eight != 0;
""")
def any_of_eight(flags: wp.array(dtype=wp.uint8), at: int) -> bool:
    """Return whether any of eight flags is set."""
    ...


@wp.func_native("flags.data[at] = value;")
def set_flag(flags: wp.array(dtype=wp.uint8), at: int, value: int):
    """Set one of the flags."""
    ...


@wp.func_native("flags.data[at] |= value;")
def add_flag(flags: wp.array(dtype=wp.uint8), at: int, value: int):
    """Set one of the flags if the value is 1."""
    ...


@wp.func
def clear_patch(scratch: Scratch):
    """Forget the patch of the cluster before."""
    outside = scratch.dirty.shape[0] - 1
    for p in range(scratch.size[0]):
        v = int_at(scratch.patch, p)
        scratch.u[v] = Lanes(FAR)
        scratch.place[v] = outside


@wp.func
def sort_into_buckets(
    scratch: Scratch, n: int, found: wp.array(dtype=wp.int32), order: wp.array(dtype=wp.int32)
):
    """Sort the n vertices found by their buckets, which have been counted from 1."""
    for k in range(BUCKETS):
        scratch.bucket[k + 1] += scratch.bucket[k]
    for k in range(n):
        at = int_at(scratch.bin, k)
        p = int_at(scratch.bucket, at)
        scratch.bucket[at] = p + 1
        order[p] = int_at(found, k)


@wp.func
def lay_patch(
    scratch: Scratch, position: wp.array(dtype=wp.vec3), groups: Groups, cluster: int, reach: float
):
    """List the vertices that may be in reach of a cluster, near to far."""
    for k in range(BUCKETS + 1):
        scratch.bucket[k] = 0
    centre = groups.centre[cluster]
    radius = groups.radius[cluster] + reach
    scale = 0.9999 * float(BUCKETS) / radius
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
                    scratch.found[n] = v
                    scratch.bin[n] = k
                    scratch.bucket[k + 1] += 1
                    n += 1
    sort_into_buckets(scratch, n, scratch.found, scratch.patch)
    for p in range(n):
        scratch.place[scratch.patch[p]] = p
    scratch.size[0] = n
