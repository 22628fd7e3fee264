"""Warp kernels that change the edges of a closed mesh sequentially, on the CPU.

A side of a face has the number ``3 * face + corner``. It starts at the vertex ``origins[side]``, and its twin
is the same edge in the neighbouring face. Sides of removed faces have the origin -1.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.surfaces.kernels.quadrics import collapsed

wp.set_module_options({"enable_backward": False})

__all__ = [
    "cost_of_edges",
    "excess_of_edges",
    "flip_edges",
    "length_of_edges",
    "merge_edges",
    "split_edges",
]

_SHARPEST = wp.constant(wp.float64(0.3))
"""Least cosine between a face's normals before and after a change."""
_FLATTEST = wp.constant(wp.float64(1.0e-3))
"""Least height of a face, relative to its longest side."""
_HALF = wp.constant(wp.float64(0.5))
_BARELY = wp.constant(wp.float64(1.0e-6))
"""Least excess of opposite angles over 180° for a flip [rad]."""


@wp.func
def _next(side: int) -> int:
    return wp.where(side % 3 == 2, side - 2, side + 1)


@wp.func
def _previous(side: int) -> int:
    return wp.where(side % 3 == 0, side + 2, side - 1)


@wp.func
def _around(side: int, twins: wp.array(dtype=int)) -> int:
    """Return the next side that starts at the same vertex."""
    return twins[_previous(side)]


@wp.func
def _valence(side: int, twins: wp.array(dtype=int)) -> int:
    count = int(1)
    other = int(_around(side, twins))
    while other != side:
        count += 1
        other = _around(other, twins)
    return count


@wp.kernel
def cost_of_edges(
    origins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    quadrics: wp.array2d(dtype=wp.float64),
    costs: wp.array(dtype=wp.float64),
):
    """Compute the cost of each edge's collapse, stored at one of its sides."""
    side = wp.tid()
    u = origins[side]
    costs[side] = wp.float64(wp.inf)
    if u >= 0:
        v = origins[_next(side)]
        if u < v:
            costs[side] = collapsed(u, v, vertices, quadrics)[3]


@wp.kernel
def length_of_edges(
    origins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    longest: wp.array(dtype=wp.float64),
    lengths: wp.array(dtype=wp.float64),
):
    """Compute each edge's length relative to the largest one at its ends, stored at one of its sides."""
    side = wp.tid()
    u = origins[side]
    lengths[side] = wp.float64(wp.inf)
    if u >= 0:
        v = origins[_next(side)]
        if u < v:
            lengths[side] = wp.length(vertices[u] - vertices[v]) / (_HALF * (longest[u] + longest[v]))


@wp.func
def _across(side: int, origins: wp.array(dtype=int), vertices: wp.array(dtype=wp.vec3d)) -> wp.vec3d:
    """Return the normal of a side's face, with twice the area as its length."""
    a = vertices[origins[side]]
    return wp.cross(vertices[origins[_next(side)]] - a, vertices[origins[_previous(side)]] - a)


@wp.func
def _angle(side: int, origins: wp.array(dtype=int), vertices: wp.array(dtype=wp.vec3d)) -> wp.float64:
    """Return the angle opposite a side in its face."""
    apex = vertices[origins[_previous(side)]]
    a = vertices[origins[side]] - apex
    b = vertices[origins[_next(side)]] - apex
    return wp.atan2(wp.length(wp.cross(a, b)), wp.dot(a, b))


@wp.kernel
def excess_of_edges(
    origins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    twins: wp.array(dtype=int),
    excess: wp.array(dtype=wp.float64),
):
    """Compute the excess of each edge's opposite angles over 180°, stored at one of its sides.

    It is 0 if the faces of the edge are not nearly coplanar.
    """
    side = wp.tid()
    u = origins[side]
    excess[side] = wp.float64(wp.inf)
    if u >= 0 and u < origins[_next(side)]:
        twin = twins[side]
        before, beyond = _across(side, origins, vertices), _across(twin, origins, vertices)
        flatness = wp.dot(before, beyond) / wp.max(
            wp.length(before) * wp.length(beyond), wp.float64(1.0e-300)
        )
        excess[side] = wp.float64(0.0)
        if flatness >= wp.float64(1.0) - wp.float64(2.0) * _SHARPEST:
            both = _angle(side, origins, vertices) + _angle(twin, origins, vertices)
            excess[side] = both - wp.float64(wp.PI) - _BARELY


@wp.func
def _join(side: int, origin: int, twin: int, origins: wp.array(dtype=int), twins: wp.array(dtype=int)):
    """Set the origin of a side, and connect it with its twin."""
    origins[side] = origin
    twins[side] = twin
    twins[twin] = side


@wp.kernel
def split_edges(
    candidates: wp.array(dtype=int),
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    n_vertices: int,
    n_faces: int,
    vertices: wp.array(dtype=wp.vec3d),
    longest: wp.array(dtype=wp.float64),
    changed: wp.array(dtype=wp.bool),
    done: wp.array(dtype=int),
):
    """Split edges in their order, at most one per face; new vertices and faces are appended."""
    count = int(0)
    for number in range(candidates.shape[0]):
        side = candidates[number]
        twin = twins[side]
        if changed[side / 3] or changed[twin / 3]:
            continue
        changed[side / 3] = True
        changed[twin / 3] = True
        u, v = int(origins[side]), int(origins[twin])
        middle = n_vertices + count
        vertices[middle] = _HALF * (vertices[u] + vertices[v])
        longest[middle] = _HALF * (longest[u] + longest[v])
        # in both faces, the part at the side's start is kept and the other part is new
        ahead = 3 * (n_faces + 2 * count)
        beyond = ahead + 3
        for half in range(2):
            old = wp.where(half == 0, side, twin)
            new = wp.where(half == 0, ahead, beyond)
            end = wp.where(half == 0, v, u)
            apex = int(origins[_previous(old)])
            outer = int(twins[_next(old)])
            _join(new + 1, end, outer, origins, twins)
            origins[new] = middle
            _join(new + 2, apex, _next(old), origins, twins)
            origins[_next(old)] = middle
        twins[side] = beyond
        twins[beyond] = side
        twins[twin] = ahead
        twins[ahead] = twin
        count += 1
    done[0] = count


@wp.func
def _are_joined(side: int, other: int, origins: wp.array(dtype=int), twins: wp.array(dtype=int)) -> bool:
    """Whether an edge connects a side's start vertex with another vertex."""
    joined = origins[_next(side)] == other
    step = int(_around(side, twins))
    while step != side and not joined:
        joined = origins[_next(step)] == other
        step = _around(step, twins)
    return joined


@wp.func
def _faces_alike(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, normal: wp.vec3d) -> bool:
    across = wp.cross(b - a, c - a)
    return wp.dot(across, normal) > wp.float64(2.0) * _SHARPEST * wp.length(across)


@wp.kernel
def flip_edges(
    candidates: wp.array(dtype=int),
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    changed: wp.array(dtype=wp.bool),
    done: wp.array(dtype=int),
):
    """Flip edges in their order, at most one per face, unless the new edge exists or a face flips over."""
    count = int(0)
    for number in range(candidates.shape[0]):
        side = candidates[number]
        twin = twins[side]
        if changed[side / 3] or changed[twin / 3]:
            continue
        ahead, behind = _next(side), _previous(side)
        beyond, before = _next(twin), _previous(twin)
        u, v = int(origins[side]), int(origins[twin])
        c, d = int(origins[behind]), int(origins[before])
        if c == d or _are_joined(behind, d, origins, twins):
            continue
        normal = wp.normalize(_across(side, origins, vertices))
        normal += wp.normalize(_across(twin, origins, vertices))
        a, b = vertices[u], vertices[v]
        if not _faces_alike(a, vertices[d], vertices[c], normal):
            continue
        if not _faces_alike(b, vertices[c], vertices[d], normal):
            continue
        from_c, from_v = int(twins[behind]), int(twins[ahead])
        from_d, from_u = int(twins[before]), int(twins[beyond])
        origins[side] = d
        origins[twin] = c
        _join(ahead, c, from_c, origins, twins)
        _join(behind, u, from_u, origins, twins)
        _join(beyond, d, from_d, origins, twins)
        _join(before, v, from_v, origins, twins)
        changed[side / 3] = True
        changed[twin / 3] = True
        count += 1
    done[0] = count


@wp.func
def _keeps_topology(
    side: int,
    stamp: int,
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    marks: wp.array(dtype=int),
) -> bool:
    """Whether the ends share only the two opposite vertices, and these have enough other neighbours."""
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
    """Whether moving a side's start vertex flips a face over, or makes it flat or too long."""
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
            squared = wp.length_sq(after)
            reach = wp.max(wp.length_sq(b - place), wp.length_sq(c - place))
            flattest = _FLATTEST * wp.max(reach, wp.length_sq(b - c))
            most = _HALF * (longest[u] + longest[origins[_next(other)]])
            spoils = (
                wp.dot(before, after) < _SHARPEST * wp.sqrt(wp.length_sq(before) * squared)
                or squared < flattest * flattest
                or reach > most * most
            )
        other = _around(other, twins)
    return spoils


@wp.func
def _close(gone: int, origins: wp.array(dtype=int), twins: wp.array(dtype=int)):
    """Remove a face, and connect the twins of its other two sides."""
    ahead = int(twins[_next(gone)])
    behind = int(twins[_previous(gone)])
    twins[ahead] = behind
    twins[behind] = ahead
    origins[gone] = -1
    origins[_next(gone)] = -1
    origins[_previous(gone)] = -1


@wp.func
def _merge(side: int, origins: wp.array(dtype=int), twins: wp.array(dtype=int)):
    """Move the sides of the second end to the first, and remove the two faces between them."""
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
    origins: wp.array(dtype=int),
    twins: wp.array(dtype=int),
    most: int,
    vertices: wp.array(dtype=wp.vec3d),
    quadrics: wp.array2d(dtype=wp.float64),
    longest: wp.array(dtype=wp.float64),
    marks: wp.array(dtype=int),
    merged: wp.array(dtype=wp.bool),
    changed: wp.array(dtype=wp.bool),
    done: wp.array(dtype=int),
):
    """Collapse edges in their order, each vertex once, where this preserves topology and shape."""
    count = int(0)
    for number in range(candidates.shape[0]):
        side = candidates[number]
        u = int(origins[side])
        if u < 0 or count >= most:
            continue
        v = int(origins[_next(side)])
        if merged[u] or merged[v] or not _keeps_topology(side, number + 1, origins, twins, marks):
            continue
        meeting = collapsed(u, v, vertices, quadrics)
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
        merged[u] = True
        merged[v] = True
        count += 1
    done[0] = count
