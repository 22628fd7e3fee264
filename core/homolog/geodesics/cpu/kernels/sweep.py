"""The fast iterative method for one cluster on one CPU core: sweeps from near to far.

Distances from the cluster's sources are solved together, one source in each SIMD lane; see docs/geodesics.md.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cpu.kernels.patch import (
    FLAGS_PER_WORD,
    Lanes,
    Scratch,
    any_flag_in_word,
    build_patch,
    clear_patch,
    load_flag,
    load_float,
    load_lanes,
    or_flag,
    set_flag,
    store_lanes,
)
from homolog.geodesics.kernels.fans import Fans, Groups
from homolog.geodesics.kernels.local_solver import (
    DECREASE_TOLERANCE,
    UNREACHED,
    DistanceLimits,
    corner_b,
    straight_path_squared,
)
from homolog.geodesics.kernels.lookup import LANES
from homolog.geodesics.kernels.memory import load_int

# Lane loops must not be unrolled by Warp: the compiler then vectorizes them.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BAND = wp.constant(128)
"""Vertices, in patch order, that converge together: a multiple of FLAGS_PER_WORD."""


@wp.func
def triangle_updates(u: wp.array(dtype=Lanes), v: int, fans: Fans) -> Lanes:
    """Return the shortest distances at v through its triangles, in all lanes."""
    best = Lanes(UNREACHED)
    squared = Lanes(UNREACHED * UNREACHED)
    end = load_int(fans.start, v + 1)
    da = load_lanes(u, corner_b(fans.corners, end - 1))
    k = load_int(fans.start, v)
    while k < end:  # a range loop takes three times the instructions
        corner = fans.corners[k]
        k += 1
        db = load_lanes(u, corner.b)
        # This comparison takes one instruction; wp.min takes three.
        for lane in range(LANES):
            via_edge = db[lane] + corner.bc
            best[lane] = wp.where(via_edge < best[lane], via_edge, best[lane])
            straight = straight_path_squared(corner, da[lane], db[lane])
            squared[lane] = wp.where(straight < squared[lane], straight, squared[lane])
        da = db  # the next triangle's
    for lane in range(LANES):
        via_edge = wp.sqrt(squared[lane])
        best[lane] = wp.where(via_edge < best[lane], via_edge, best[lane])
    return best


@wp.func
def relax_vertex(scratch: Scratch, v: int, fans: Fans, limits: DistanceLimits):
    """Update a vertex; if it decreases, activate the neighbours that may follow (see `find_margins`)."""
    old = load_lanes(scratch.u, v)
    new = triangle_updates(scratch.u, v, fans)
    announced = Lanes()
    # Flags are combined by "or": a sum would not be vectorized.
    any_decrease = int(0)
    any_in_range = int(0)
    for lane in range(LANES):
        is_decrease = DECREASE_TOLERANCE * new[lane] < old[lane]
        is_decrease_in_range = is_decrease and new[lane] <= limits.propagation_limit
        any_decrease |= wp.where(is_decrease, 1, 0)
        any_in_range |= wp.where(is_decrease_in_range, 1, 0)
        announced[lane] = wp.where(is_decrease_in_range, new[lane], UNREACHED)
        new[lane] = wp.where(is_decrease, new[lane], old[lane])
    if any_in_range != 0:
        k = load_int(fans.start, v)
        end = load_int(fans.start, v + 1)
        while k < end:
            b = corner_b(fans.corners, k)
            there = load_lanes(scratch.u, b)
            margin = load_float(fans.margin, k)
            k += 1
            may_decrease = int(0)
            for lane in range(LANES):
                may_decrease |= wp.where(there[lane] > announced[lane] - margin, 1, 0)
            or_flag(scratch.active, load_int(scratch.patch_index, b), may_decrease)
    if any_decrease != 0:
        store_lanes(scratch.u, v, new)


@wp.kernel
def sweep_cluster(scratch: Scratch, fans: Fans, limits: DistanceLimits, groups: Groups, cluster: int):
    """Solve the distances from one cluster's sources: sweeps over active vertices, near to far."""
    clear_patch(scratch)
    build_patch(scratch, fans.position, groups, cluster, limits.propagation_limit)
    size = scratch.size[0]
    for lane in range(LANES):
        m = groups.members[cluster, lane]
        if m >= 0:
            value = scratch.u[m]
            value[lane] = 0.0
            scratch.u[m] = value
            for k in range(fans.start[m], fans.start[m + 1]):
                set_flag(scratch.active, scratch.patch_index[fans.corners[k].b], 1)

    # Each band converges before the next one, which would otherwise start from values that still decrease.
    changed = int(1)
    while changed != 0:
        changed = int(0)
        for first in range(0, size, BAND):
            band_changed = int(1)
            while band_changed != 0:
                band_changed = int(0)
                for word in range(first, wp.min(first + BAND, size), FLAGS_PER_WORD):
                    if any_flag_in_word(scratch.active, word):
                        band_changed = int(1)
                        changed = int(1)
                        for p in range(word, word + FLAGS_PER_WORD):
                            if load_flag(scratch.active, p) != 0:
                                set_flag(scratch.active, p, 0)
                                v = load_int(scratch.patch, p)
                                relax_vertex(scratch, v, fans, limits)
