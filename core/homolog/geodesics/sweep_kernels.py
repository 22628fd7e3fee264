"""The fast iterative method for one cluster on one CPU core: sweeps from near to far.

Distances from the sources of a cluster are solved side by side, one source a lane; see docs/geodesics.md.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import FALL, FAR, Corner, Reach, plane_front, straight_squared
from homolog.geodesics.lookup import LANES
from homolog.geodesics.memory_kernels import b_of, int_at
from homolog.geodesics.patch_kernels import (
    TOGETHER,
    Groups,
    Lanes,
    Scratch,
    add_flag,
    any_of_eight,
    clear_patch,
    flag_at,
    float_at,
    lanes_at,
    lay_patch,
    put_lanes,
    set_flag,
)

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

BAND = wp.constant(128)
"""Vertices, in the order of the patch, that are settled together: a multiple of TOGETHER."""


@wp.func
def update(
    u: wp.array(dtype=Lanes),
    v: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    element: int,
) -> Lanes:
    """Return the distances at v that its triangles yield."""
    best = Lanes(FAR)
    squared = Lanes(FAR * FAR)
    end = int_at(fan, v + 1)
    da = lanes_at(u, b_of(corners, end - 1))
    k = int_at(fan, v)
    while k < end:  # a range takes three times the instructions
        corner = corners[k]
        k += 1
        db = lanes_at(u, corner.b)
        if element == 0:
            # compared so that it takes one instruction; wp.min takes three
            for lane in range(LANES):
                way = db[lane] + corner.bc
                best[lane] = wp.where(way < best[lane], way, best[lane])
                straight = straight_squared(corner, da[lane], db[lane])
                squared[lane] = wp.where(straight < squared[lane], straight, squared[lane])
        else:
            for lane in range(LANES):
                best[lane] = wp.min(best[lane], plane_front(corner, da[lane], db[lane]))
        da = db  # the next triangle's
    for lane in range(LANES):
        way = wp.sqrt(squared[lane])
        best[lane] = wp.where(way < best[lane], way, best[lane])
    return best


@wp.func
def lower(
    scratch: Scratch,
    v: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    margins: wp.array(dtype=wp.float32),
    reach: Reach,
    element: int,
):
    """Update a vertex, and mark those neighbours that may follow if it fell (see `find_margins`)."""
    old = lanes_at(scratch.u, v)
    new = update(scratch.u, v, fan, corners, element)
    told = Lanes()
    # flags joined by "or": counts would not be reduced by vector instructions
    fell = int(0)
    near = int(0)
    for lane in range(LANES):
        falls = FALL * new[lane] < old[lane]
        tells = falls and new[lane] <= reach.limit
        fell |= wp.where(falls, 1, 0)
        near |= wp.where(tells, 1, 0)
        told[lane] = wp.where(tells, new[lane], FAR)
        new[lane] = wp.where(falls, new[lane], old[lane])
    if near != 0:
        k = int_at(fan, v)
        end = int_at(fan, v + 1)
        while k < end:
            b = b_of(corners, k)
            there = lanes_at(scratch.u, b)
            margin = float_at(margins, k)
            k += 1
            follows = int(0)
            for lane in range(LANES):
                follows |= wp.where(there[lane] > told[lane] - margin, 1, 0)
            add_flag(scratch.dirty, int_at(scratch.place, b), follows)
    if fell != 0:
        put_lanes(scratch.u, v, new)


@wp.kernel
def sweep_cluster(
    scratch: Scratch,
    position: wp.array(dtype=wp.vec3),
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    margins: wp.array(dtype=wp.float32),
    reach: Reach,
    groups: Groups,
    element: int,
    cluster: int,
):
    """Solve the distances from one cluster's sources: sweeps over dirty vertices, near to far."""
    clear_patch(scratch)
    lay_patch(scratch, position, groups, cluster, reach.limit)
    size = scratch.size[0]
    for lane in range(LANES):
        m = groups.members[cluster, lane]
        if m >= 0:
            value = scratch.u[m]
            value[lane] = 0.0
            scratch.u[m] = value
            for k in range(fan[m], fan[m + 1]):
                set_flag(scratch.dirty, scratch.place[corners[k].b], 1)

    # A band is settled before the next: what lies beyond is not computed from values that still fall.
    pending = int(1)
    while pending != 0:
        pending = int(0)
        for first in range(0, size, BAND):
            moving = int(1)
            while moving != 0:
                moving = int(0)
                for eight in range(first, wp.min(first + BAND, size), TOGETHER):
                    if any_of_eight(scratch.dirty, eight):
                        moving = int(1)
                        pending = int(1)
                        for p in range(eight, eight + TOGETHER):
                            if flag_at(scratch.dirty, p) != 0:
                                set_flag(scratch.dirty, p, 0)
                                v = int_at(scratch.patch, p)
                                lower(scratch, v, fan, corners, margins, reach, element)
