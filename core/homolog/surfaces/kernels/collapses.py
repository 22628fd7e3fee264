"""Warp kernels that merge the ends of edges of a closed mesh, one edge after another, on the CPU.

A side of a face has the number ``3 * face + corner``. It leaves the vertex ``origins[side]``, and its twin is
the same edge in the face beyond. Sides of faces that are gone have the origin -1.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = ["cost_of_edges", "merge_edges"]

_SHARPEST = wp.constant(wp.float64(0.3))
"""Cosine between a face's normal before and after a change."""
_FLATTEST = wp.constant(wp.float64(1.0e-3))
"""Height of a face, in parts of its longest side."""
_TO_MIDDLE = wp.constant(wp.float64(1.0e-3))
"""Weight of the edge's own length: where the surface is flat, short edges go first."""
_HALF = wp.constant(wp.float64(0.5))


@wp.func
def _next(side: int) -> int:
    return wp.where(side % 3 == 2, side - 2, side + 1)


@wp.func
def _previous(side: int) -> int:
    return wp.where(side % 3 == 0, side + 2, side - 1)


@wp.func
def _around(side: int, twins: wp.array(dtype=int)) -> int:
    """Return the next side that leaves the same vertex."""
    return twins[_previous(side)]


@wp.func
def _valence(side: int, twins: wp.array(dtype=int)) -> int:
    count = int(1)
    other = int(_around(side, twins))
    while other != side:
        count += 1
        other = _around(other, twins)
    return count


@wp.func
def _merged(
    u: int, v: int, vertices: wp.array(dtype=wp.vec3d), quadrics: wp.array2d(dtype=wp.float64)
) -> wp.vec4d:
    """Where the ends of an edge meet, and what that costs: distance² to the planes of both, times areas.

    Rows of quadrics: xx, xy, xz, yy, yz, zz, then the linear terms and the constant one. Without quadrics the
    ends meet in the middle.
    """
    middle = _HALF * (vertices[u] + vertices[v])
    xx, xy = quadrics[u, 0] + quadrics[v, 0], quadrics[u, 1] + quadrics[v, 1]
    xz, yy = quadrics[u, 2] + quadrics[v, 2], quadrics[u, 3] + quadrics[v, 3]
    yz, zz = quadrics[u, 4] + quadrics[v, 4], quadrics[u, 5] + quadrics[v, 5]
    area = xx + yy + zz
    planes = wp.mat33d(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    linear = wp.vec3d(
        quadrics[u, 6] + quadrics[v, 6], quadrics[u, 7] + quadrics[v, 7], quadrics[u, 8] + quadrics[v, 8]
    )
    pull = _TO_MIDDLE * area
    place = middle
    if area > wp.float64(0.0):
        identity = wp.identity(n=3, dtype=wp.float64)
        place = wp.inverse(planes + pull * identity) * (pull * middle - linear)
    along = vertices[u] - vertices[v]
    cost = wp.dot(place, planes * place) + wp.float64(2.0) * wp.dot(linear, place)
    cost += quadrics[u, 9] + quadrics[v, 9] + pull * wp.dot(along, along)
    return wp.vec4d(place[0], place[1], place[2], cost)


@wp.kernel
def cost_of_edges(
    origins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    quadrics: wp.array2d(dtype=wp.float64),
    costs: wp.array(dtype=wp.float64),
):
    """Find what merging the ends of each edge costs; each edge counts at one of its sides."""
    side = wp.tid()
    u = origins[side]
    costs[side] = wp.float64(wp.inf)
    if u >= 0:
        v = origins[_next(side)]
        if u < v:
            costs[side] = _merged(u, v, vertices, quadrics)[3]


@wp.func
def _keeps_topology(
    side: int,
    stamp: int,
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    marks: wp.array(dtype=int),
) -> bool:
    """Whether the ends share just the two vertices opposite, which have other neighbours enough."""
    twin = twins[side]
    marks[origins[twin]] = stamp
    other = int(_around(side, twins))
    while other != side:
        marks[origins[_next(other)]] = stamp
        other = _around(other, twins)
    shared = int(0)
    other = _around(twin, twins)
    while other != twin:
        if marks[origins[_next(other)]] == stamp:
            shared += 1
        other = _around(other, twins)
    return shared == 2 and _valence(_previous(side), twins) > 3 and _valence(_previous(twin), twins) > 3


@wp.func
def _spoils(
    side: int,
    place: wp.vec3d,
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    longest: wp.array(dtype=wp.float64),
) -> bool:
    """Whether a face around the side's first vertex turns over, flattens or gets too long at a new place."""
    u = origins[side]
    twin = twins[side]
    spoils = bool(False)
    other = int(_around(side, twins))
    while other != side and not spoils:
        # The faces on both sides of the edge vanish.
        if other != _next(twin):
            b = vertices[origins[_next(other)]]
            c = vertices[origins[_previous(other)]]
            before = wp.cross(b - vertices[u], c - vertices[u])
            after = wp.cross(b - place, c - place)
            reach = wp.max(wp.length(b - place), wp.length(c - place))
            side_length = wp.max(reach, wp.length(b - c))
            spoils = (
                wp.dot(before, after) < _SHARPEST * wp.length(before) * wp.length(after)
                or wp.length(after) < _FLATTEST * side_length * side_length
                or reach > _HALF * (longest[u] + longest[origins[_next(other)]])
            )
        other = _around(other, twins)
    return spoils


@wp.func
def _close(gone: int, origins: wp.array(dtype=int), twins: wp.array(dtype=int)):
    """Remove a face, and join what its other two sides met."""
    ahead = int(twins[_next(gone)])
    behind = int(twins[_previous(gone)])
    twins[ahead] = behind
    twins[behind] = ahead
    origins[gone] = -1
    origins[_next(gone)] = -1
    origins[_previous(gone)] = -1


@wp.func
def _merge(side: int, origins: wp.array(dtype=int), twins: wp.array(dtype=int)):
    """Give the sides of the second end to the first, and close the two faces between."""
    u = int(origins[side])
    twin = int(twins[side])
    other = int(_around(twin, twins))
    origins[twin] = u
    while other != twin:
        origins[other] = u
        other = _around(other, twins)
    _close(side, origins, twins)
    _close(twin, origins, twins)


@wp.kernel
def merge_edges(
    candidates: wp.array(dtype=int),
    most: int,
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    quadrics: wp.array2d(dtype=wp.float64),
    longest: wp.array(dtype=wp.float64),
    marks: wp.array(dtype=int),
    changed: wp.array(dtype=wp.bool),
    merged: wp.array(dtype=int),
):
    """Merge the ends of edges in their order, each vertex once, where neither topology nor shape suffers."""
    count = int(0)
    for number in range(candidates.shape[0]):
        side = candidates[number]
        u = int(origins[side])
        if u < 0 or count >= most:
            continue
        v = int(origins[_next(side)])
        if changed[u] or changed[v] or not _keeps_topology(side, number + 1, origins, twins, marks):
            continue
        meeting = _merged(u, v, vertices, quadrics)
        place = wp.vec3d(meeting[0], meeting[1], meeting[2])
        if _spoils(side, place, origins, twins, vertices, longest):
            continue
        if _spoils(twins[side], place, origins, twins, vertices, longest):
            continue
        _merge(side, origins, twins)
        vertices[u] = place
        longest[u] = _HALF * (longest[u] + longest[v])
        for term in range(10):
            quadrics[u, term] = quadrics[u, term] + quadrics[v, term]
        changed[u] = True
        changed[v] = True
        count += 1
    merged[0] = count
