"""Kernels that pair the sides of meshes; one thread processes a whole mesh.

Side 3f + k starts at corner k of face f. Faces and vertices are numbered consecutively over all meshes.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = [
    "Sides",
    "check_meshes",
    "find_reach",
    "leaving_end",
    "measure_areas",
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


@wp.func
def has_area(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, flattest: wp.float64) -> bool:
    """Return whether a face's height exceeds a fraction of its longest side."""
    longest = wp.max(wp.max(wp.length_sq(b - a), wp.length_sq(c - b)), wp.length_sq(a - c))
    return wp.length(wp.cross(b - a, c - a)) > flattest * longest


@wp.kernel
def check_meshes(
    first: int,
    sides: Sides,
    position: wp.array(dtype=wp.vec3d),
    flattest: wp.float64,
    is_sound: wp.array(dtype=bool),
):
    """Check faces and fans of vertices of meshes; thread (mesh, counted from `first`)."""
    mesh = first + wp.tid()
    if not is_sound[mesh]:
        return
    sound = bool(True)
    for face in range(sides.first_face[mesh], sides.first_face[mesh + 1]):
        a = position[sides.tail[3 * face]]
        b = position[sides.tail[3 * face + 1]]
        c = position[sides.tail[3 * face + 2]]
        if not has_area(a, b, c, flattest):
            sound = False
    for vertex in range(sides.first_vertex[mesh], sides.first_vertex[mesh + 1]):
        degree = leaving_end(sides, mesh, vertex) - sides.start[vertex]
        if degree == 0:
            sound = False
        else:
            begin = int(sides.leaving[sides.start[vertex]])
            for k in range(sides.start[vertex], leaving_end(sides, mesh, vertex)):
                if sides.twin[sides.leaving[k]] < 0:
                    begin = sides.leaving[k]
            side = int(begin)
            turned = int(0)
            while side >= 0 and (turned == 0 or side != begin) and turned <= degree:
                side = sides.twin[next_side(next_side(side))]
                turned += 1
            if turned != degree:
                sound = False
    is_sound[mesh] = sound


@wp.kernel
def measure_areas(
    first: int, sides: Sides, position: wp.array(dtype=wp.vec3d), area: wp.array(dtype=wp.float64)
):
    """Sum the areas of the faces; thread (mesh, counted from `first`)."""
    mesh = first + wp.tid()
    total = wp.float64(0.0)
    for face in range(sides.first_face[mesh], sides.first_face[mesh + 1]):
        a = position[sides.tail[3 * face]]
        b = position[sides.tail[3 * face + 1]]
        total += wp.length(wp.cross(b - a, position[sides.tail[3 * face + 2]] - a))
    area[mesh] = wp.float64(0.5) * total


@wp.kernel
def find_reach(
    first: int,
    sides: Sides,
    position: wp.array(dtype=wp.vec3d),
    waiting: wp.array(dtype=wp.int32),
    queue: wp.array(dtype=wp.int32),
    distance: wp.array(dtype=wp.float64),
    reach: wp.array(dtype=wp.float64),
):
    """Find the longest of all shortest paths along edges from the first vertex of each piece.

    Thread (mesh, from `first`).

    The Bellman-Ford algorithm with a queue that contains each vertex at most once.
    """
    mesh = first + wp.tid()
    begin = sides.first_vertex[mesh]
    n = sides.first_vertex[mesh + 1] - begin
    for vertex in range(begin, begin + n):
        distance[vertex] = wp.float64(1.0e300)
        waiting[vertex] = 0
    head = int(0)
    length = int(0)
    for seed in range(begin, begin + n):
        if distance[seed] == wp.float64(1.0e300):
            distance[seed] = wp.float64(0.0)
            queue[begin] = seed
            waiting[seed] = 1
            head = int(0)
            length = int(1)
            while length > 0:
                vertex = queue[begin + head]
                head = wp.where(head + 1 == n, 0, head + 1)
                length -= 1
                waiting[vertex] = 0
                for k in range(sides.start[vertex], leaving_end(sides, mesh, vertex)):
                    other = sides.tail[next_side(sides.leaving[k])]
                    there = distance[vertex] + wp.length(position[vertex] - position[other])
                    if there < distance[other]:
                        distance[other] = there
                        if waiting[other] == 0:
                            waiting[other] = 1
                            queue[begin + (head + length) % n] = other
                            length += 1
    farthest = wp.float64(0.0)
    for vertex in range(begin, begin + n):
        farthest = wp.max(farthest, distance[vertex])
    reach[mesh] = farthest
