"""Kernels for intrinsic triangulations, whose edges are straight lines within the surface.

A triangulation is a set of arrays over *sides*: side 3f + k runs from corner k of face f to the next one.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.surfaces.kernels.sides import Sides, next_side

wp.set_module_options({"enable_backward": False})

FLAT = wp.constant(wp.float64(-1.0e-9))
"""Sum of cotangents from which an edge counts as Delaunay; edges of cocircular corners are not flipped."""
MOST_FLIPS = wp.constant(100)
"""Limit of flips per edge; a mesh needs about 0.2."""


@wp.func
def apex(length: wp.array(dtype=wp.float64), side: int) -> wp.vec2d:
    """Return the third corner of a side's face, the side laid from (0, 0) to (length, 0)."""
    ab = length[side]
    bc = length[next_side(side)]
    ca = length[next_side(next_side(side))]
    x = (ab * ab + ca * ca - bc * bc) / (wp.float64(2.0) * ab)
    return wp.vec2d(x, wp.sqrt(wp.max(ca * ca - x * x, wp.float64(0.0))))


@wp.func
def opposite_cotangent(length: wp.array(dtype=wp.float64), side: int) -> wp.float64:
    """Return the cotangent of the angle opposite to a side."""
    c = apex(length, side)
    across = length[side] - c[0]
    return (c[1] * c[1] - c[0] * across) / wp.max(c[1] * length[side], wp.float64(1.0e-300))


@wp.func
def swap_sides(sides: Sides, length: wp.array(dtype=wp.float64), i: int, j: int):
    """Exchange two sides' places in the arrays."""
    tail = sides.tail[i]
    sides.tail[i] = sides.tail[j]
    sides.tail[j] = tail
    kept = length[i]
    length[i] = length[j]
    length[j] = kept
    twin_i = sides.twin[i]
    twin_j = sides.twin[j]
    if twin_i != j:  # twins of each other stay twins
        sides.twin[i] = twin_j
        sides.twin[j] = twin_i
        if twin_j >= 0:
            sides.twin[twin_j] = i
        if twin_i >= 0:
            sides.twin[twin_i] = j


@wp.func
def flip(sides: Sides, length: wp.array(dtype=wp.float64), h: int):
    """Replace the edge h from a to b, faces abc and bad, by the other diagonal: faces cdb and dca."""
    t = sides.twin[h]
    h1 = next_side(h)
    h2 = next_side(h1)
    t1 = next_side(t)
    t2 = next_side(t1)
    c = apex(length, h)
    d = apex(length, t)
    dx = c[0] - (length[h] - d[0])
    dy = c[1] + d[1]
    length[h] = wp.sqrt(dx * dx + dy * dy)
    length[t] = length[h]
    sides.tail[h] = sides.tail[h2]
    sides.tail[t] = sides.tail[t2]
    # bc, ca, ad, db at h1, h2, t1, t2 become db, bc, ca, ad
    swap_sides(sides, length, t1, t2)
    swap_sides(sides, length, h2, t1)
    swap_sides(sides, length, h1, h2)


@wp.func
def push_edge(
    sides: Sides, side: int, queued: wp.array(dtype=wp.int32), stack: wp.array(dtype=wp.int32), n: int
) -> int:
    """Push the edge of a side unless it is on the stack or at a rim; return the height of the stack."""
    edge = wp.min(side, sides.twin[side])
    if edge < 0:
        return n
    if queued[edge] != 0:
        return n
    queued[edge] = 1
    stack[n] = edge
    return n + 1


@wp.kernel
def triangulate_meshes(
    first: int,
    sides: Sides,
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    rank: wp.array(dtype=wp.int32),
    queued: wp.array(dtype=wp.int32),
    stack: wp.array(dtype=wp.int32),
):
    """Flip edges until the angles opposite to each sum to at most 180 degrees; rank the sides of vertices.

    Ranks are counterclockwise, from the last side that starts at the vertex; at a rim, from 1 on the side
    that lies on it. Thread (mesh, from `first`).
    """
    mesh = first + wp.tid()
    begin = 3 * sides.first_face[mesh]
    end = 3 * sides.first_face[mesh + 1]
    n = begin
    for side in range(begin, end):
        length[side] = wp.length(position[sides.tail[next_side(side)]] - position[sides.tail[side]])
        n = push_edge(sides, side, queued, stack, n)
    flips_left = MOST_FLIPS * (n - begin)
    while n > begin and flips_left > 0:
        n -= 1
        h = stack[n]
        queued[h] = 0
        t = sides.twin[h]
        if t < 0 or h // 3 == t // 3:  # a flip may have left a side of the rim here
            continue
        if opposite_cotangent(length, h) + opposite_cotangent(length, t) < FLAT:
            flip(sides, length, h)
            flips_left -= 1
            n = push_edge(sides, next_side(h), queued, stack, n)
            n = push_edge(sides, next_side(next_side(h)), queued, stack, n)
            n = push_edge(sides, next_side(t), queued, stack, n)
            n = push_edge(sides, next_side(next_side(t)), queued, stack, n)
    for side in range(begin, end):
        sides.start[sides.tail[side]] = side  # the last one
    for side in range(begin, end):
        if sides.twin[side] < 0:
            sides.start[sides.tail[side]] = side
    for last in range(begin, end):
        side = int(last)
        if sides.start[sides.tail[side]] == side:
            number = int(wp.where(sides.twin[side] < 0, 1, 0))
            while side >= 0 and (side != last or number == 0 or sides.twin[side] < 0):
                rank[side] = number
                side = sides.twin[next_side(next_side(side))]
                number += 1
