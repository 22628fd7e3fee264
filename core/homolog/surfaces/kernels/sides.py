"""Kernels that pair the sides of meshes; one thread processes a whole mesh.

Side 3f + k starts at corner k of face f. Faces and vertices are numbered consecutively over all meshes.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = [
    "Sides",
    "leaving_end",
    "next_side",
    "pair_sides",
    "sort_by_tail",
]


@wp.struct
class Sides:
    """The sides of some meshes, and their order by the vertices from which they start."""

    first_vertex: wp.array(dtype=wp.int32)  # (S + 1,) first vertex of each mesh, and the total number
    first_face: wp.array(dtype=wp.int32)  # (S + 1,)
    tail: wp.array(dtype=wp.int32)  # (3F,) start vertex of each side, numbered over all meshes
    twin: wp.array(dtype=wp.int32)  # (3F,) the same edge in the neighbouring face, -1 at a rim
    start: wp.array(dtype=wp.int32)  # (N,) first entry of each vertex in `leaving`
    leaving: wp.array(dtype=wp.int32)  # (3F,) sides by tail


@wp.func
def next_side(side: int) -> int:
    """Return the following side of the same face."""
    return wp.where(side % 3 == 2, side - 2, side + 1)


@wp.func
def leaving_end(sides: Sides, mesh: int, vertex: int) -> int:
    """Return the end of a vertex's entries in `leaving`."""
    if vertex + 1 < sides.first_vertex[mesh + 1]:
        return sides.start[vertex + 1]
    return 3 * sides.first_face[mesh + 1]


@wp.func
def sort_by_tail(sides: Sides, mesh: int):
    """Fill `start` and `leaving` of a mesh; the sides of a vertex are in ascending order."""
    begin = 3 * sides.first_face[mesh]
    end = 3 * sides.first_face[mesh + 1]
    for vertex in range(sides.first_vertex[mesh], sides.first_vertex[mesh + 1]):
        sides.start[vertex] = 0
    for side in range(begin, end):
        sides.start[sides.tail[side]] += 1
    total = begin
    for vertex in range(sides.first_vertex[mesh], sides.first_vertex[mesh + 1]):
        total += sides.start[vertex]
        sides.start[vertex] = total
    for back in range(begin, end):
        side = begin + end - 1 - back
        place = sides.start[sides.tail[side]] - 1
        sides.start[sides.tail[side]] = place
        sides.leaving[place] = side


@wp.kernel
def pair_sides(first: int, faces: wp.array(dtype=wp.int32), sides: Sides, is_paired: wp.array(dtype=bool)):
    """Find the twins of all sides; thread (mesh, counted from `first`).

    A mesh is edge-manifold and oriented if every side occurs once, and has at most one opposite side.
    """
    mesh = first + wp.tid()
    begin = 3 * sides.first_face[mesh]
    end = 3 * sides.first_face[mesh + 1]
    for side in range(begin, end):
        sides.tail[side] = faces[side] + sides.first_vertex[mesh]
    sort_by_tail(sides, mesh)
    paired = bool(True)
    for side in range(begin, end):
        head = sides.tail[next_side(side)]
        matches = int(0)
        sides.twin[side] = -1
        for k in range(sides.start[head], leaving_end(sides, mesh, head)):
            other = sides.leaving[k]
            if sides.tail[next_side(other)] == sides.tail[side]:
                sides.twin[side] = other
                matches += 1
        if matches == 0:  # at a rim, where the same side may occur twice
            for k in range(sides.start[sides.tail[side]], leaving_end(sides, mesh, sides.tail[side])):
                other = sides.leaving[k]
                if other != side and sides.tail[next_side(other)] == head:
                    paired = False
        if matches > 1 or head == sides.tail[side]:
            paired = False
    is_paired[mesh] = paired
