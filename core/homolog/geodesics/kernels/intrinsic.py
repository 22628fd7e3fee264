"""Kernels for intrinsic triangulations, whose edges are straight lines within the surface.

A triangulation is a set of arrays over *sides*: side 3f + k runs from corner k of face f to the next one.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.surfaces.kernels.sides import next_side

wp.set_module_options({"enable_backward": False})

FLAT = wp.constant(wp.float64(-1.0e-9))
"""Sum of cotangents from which an edge counts as Delaunay; edges of cocircular corners are not flipped."""
MOST_FLIPS = wp.constant(100)
"""Limit of flips per edge; a mesh needs about 0.2."""


@wp.struct
class Sides:
    """Triangulations of several shapes, one after another."""

    tail: wp.array(dtype=wp.int32)  # (3F,) vertex that a side starts from, counted through all shapes
    twin: wp.array(dtype=wp.int32)  # (3F,) the same edge in the neighbouring face
    length: wp.array(dtype=wp.float64)  # (3F,)
    rank: wp.array(dtype=wp.int32)  # (3F,) number of the side among those that leave its tail


@wp.func
def apex(sides: Sides, side: int) -> wp.vec2d:
    """Return the third corner of a side's face, the side laid from (0, 0) to (length, 0)."""
    ab = sides.length[side]
    bc = sides.length[next_side(side)]
    ca = sides.length[next_side(next_side(side))]
    x = (ab * ab + ca * ca - bc * bc) / (wp.float64(2.0) * ab)
    return wp.vec2d(x, wp.sqrt(wp.max(ca * ca - x * x, wp.float64(0.0))))


@wp.func
def opposite_cotangent(sides: Sides, side: int) -> wp.float64:
    """Return the cotangent of the angle opposite to a side."""
    c = apex(sides, side)
    across = sides.length[side] - c[0]
    return (c[1] * c[1] - c[0] * across) / wp.max(c[1] * sides.length[side], wp.float64(1.0e-300))


@wp.func
def set_side(sides: Sides, side: int, tail: int, twin: int, length: wp.float64):
    """Set a side, and the twin of its twin."""
    sides.tail[side] = tail
    sides.length[side] = length
    sides.twin[side] = twin
    sides.twin[twin] = side


@wp.func
def side_after_flip(side: int, h1: int, h2: int, t1: int, t2: int) -> int:
    """Return the index of a side after a flip."""
    return wp.where(
        side == t2, h1, wp.where(side == h1, h2, wp.where(side == h2, t1, wp.where(side == t1, t2, side)))
    )


@wp.func
def flip(sides: Sides, h: int):
    """Replace the edge h from a to b, faces abc and bad, by the other diagonal: faces cdb and dca."""
    t = sides.twin[h]
    h1 = next_side(h)
    h2 = next_side(h1)
    t1 = next_side(t)
    t2 = next_side(t1)
    c = apex(sides, h)
    d = apex(sides, t)
    dx = c[0] - (sides.length[h] - d[0])
    dy = c[1] + d[1]
    diagonal = wp.sqrt(dx * dx + dy * dy)
    a = sides.tail[h]
    b = sides.tail[t]
    tail_c = sides.tail[h2]
    tail_d = sides.tail[t2]
    twin_bc = side_after_flip(sides.twin[h1], h1, h2, t1, t2)
    twin_ca = side_after_flip(sides.twin[h2], h1, h2, t1, t2)
    twin_ad = side_after_flip(sides.twin[t1], h1, h2, t1, t2)
    twin_db = side_after_flip(sides.twin[t2], h1, h2, t1, t2)
    bc = sides.length[h1]
    ca = sides.length[h2]
    ad = sides.length[t1]
    db = sides.length[t2]
    set_side(sides, h, tail_c, t, diagonal)
    set_side(sides, t, tail_d, h, diagonal)
    set_side(sides, h1, tail_d, twin_db, db)
    set_side(sides, h2, b, twin_bc, bc)
    set_side(sides, t1, tail_c, twin_ca, ca)
    set_side(sides, t2, a, twin_ad, ad)


@wp.func
def push_edge(
    sides: Sides, side: int, queued: wp.array(dtype=wp.int32), stack: wp.array(dtype=wp.int32), n: int
) -> int:
    """Push the edge of a side unless it is on the stack; return the height of the stack."""
    edge = wp.min(side, sides.twin[side])
    if queued[edge] != 0:
        return n
    queued[edge] = 1
    stack[n] = edge
    return n + 1


@wp.func
def flip_to_delaunay(
    sides: Sides, begin: int, end: int, queued: wp.array(dtype=wp.int32), stack: wp.array(dtype=wp.int32)
):
    """Flip edges until the two angles opposite to each sum to at most 180 degrees."""
    n = begin
    for side in range(begin, end):
        n = push_edge(sides, side, queued, stack, n)
    flips_left = MOST_FLIPS * (n - begin)
    while n > begin and flips_left > 0:
        n -= 1
        h = stack[n]
        queued[h] = 0
        t = sides.twin[h]
        if h // 3 != t // 3 and opposite_cotangent(sides, h) + opposite_cotangent(sides, t) < FLAT:
            flip(sides, h)
            flips_left -= 1
            n = push_edge(sides, next_side(h), queued, stack, n)
            n = push_edge(sides, next_side(next_side(h)), queued, stack, n)
            n = push_edge(sides, next_side(t), queued, stack, n)
            n = push_edge(sides, next_side(next_side(t)), queued, stack, n)


@wp.kernel
def triangulate_meshes(
    first: int,
    first_face: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3d),
    sides: Sides,
    queued: wp.array(dtype=wp.int32),
    stack: wp.array(dtype=wp.int32),
    leaving: wp.array(dtype=wp.int32),
):
    """Triangulate meshes and rank the sides of each vertex; thread (mesh, counted from `first`).

    Ranks are counterclockwise, from the last side that starts at the vertex.
    """
    mesh = first + wp.tid()
    begin = 3 * first_face[mesh]
    end = 3 * first_face[mesh + 1]
    for side in range(begin, end):
        sides.length[side] = wp.length(position[sides.tail[next_side(side)]] - position[sides.tail[side]])
    flip_to_delaunay(sides, begin, end, queued, stack)
    for side in range(begin, end):
        leaving[sides.tail[side]] = side
    for last in range(begin, end):
        side = int(last)
        if leaving[sides.tail[side]] == side:
            rank = int(0)
            while side != last or rank == 0:
                sides.rank[side] = rank
                side = sides.twin[next_side(next_side(side))]
                rank += 1
