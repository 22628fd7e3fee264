"""Warp kernels on regular grids: the fast iterative method and sub-voxel distances next to a zero level.

All lengths are in voxels; grids are indexed ``[i, j, k]``.
"""

from typing import Any

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

FAR = 1.0e6
_FAR = wp.constant(FAR)
_ACCURACY = wp.constant(1.2)
"""Winding numbers: distance in radii of a group of faces from which on it is treated as a dipole."""
_TRIALS = wp.constant(10)
_FREE_TURNS = wp.constant(500)


@wp.func
def _at(grid: wp.array3d(dtype=Any), i: int, j: int, k: int) -> Any:
    """Value at a node, clamped at the border."""
    return grid[
        wp.clamp(i, 0, grid.shape[0] - 1),
        wp.clamp(j, 0, grid.shape[1] - 1),
        wp.clamp(k, 0, grid.shape[2] - 1),
    ]


@wp.func
def _sample(grid: wp.array3d(dtype=Any), x: wp.vec3) -> Any:
    """Trilinear interpolant at a point."""
    i, j, k = int(wp.floor(x[0])), int(wp.floor(x[1])), int(wp.floor(x[2]))
    a, b, c = x[0] - float(i), x[1] - float(j), x[2] - float(k)
    v00 = wp.lerp(_at(grid, i, j, k), _at(grid, i + 1, j, k), a)
    v01 = wp.lerp(_at(grid, i, j, k + 1), _at(grid, i + 1, j, k + 1), a)
    v10 = wp.lerp(_at(grid, i, j + 1, k), _at(grid, i + 1, j + 1, k), a)
    v11 = wp.lerp(_at(grid, i, j + 1, k + 1), _at(grid, i + 1, j + 1, k + 1), a)
    return wp.lerp(wp.lerp(v00, v10, b), wp.lerp(v01, v11, b), c)


@wp.func
def _crossing(here: float, there: float) -> float:
    """Distance from a node to the zero between it and a neighbour; far if there is none."""
    if (here < 0.0) == (there < 0.0):
        return _FAR
    return here / (here - there)


@wp.func
def _crossings(level: wp.array3d(dtype=wp.float32), i: int, j: int, k: int) -> float:
    """Distance to the plane through the zeros on the three grid lines of a node, at least one of them."""
    here = level[i, j, k]
    x = wp.min(_crossing(here, _at(level, i + 1, j, k)), _crossing(here, _at(level, i - 1, j, k)))
    y = wp.min(_crossing(here, _at(level, i, j + 1, k)), _crossing(here, _at(level, i, j - 1, k)))
    z = wp.min(_crossing(here, _at(level, i, j, k + 1)), _crossing(here, _at(level, i, j, k - 1)))
    tiny = float(1.0e-6)
    x, y, z = wp.max(x, tiny), wp.max(y, tiny), wp.max(z, tiny)
    return 1.0 / wp.sqrt(1.0 / (x * x) + 1.0 / (y * y) + 1.0 / (z * z))


@wp.kernel
def find_gradient(level: wp.array3d(dtype=wp.float32), gradient: wp.array3d(dtype=wp.vec3)) -> None:
    """Central differences at every node, one-sided at the border."""
    i, j, k = wp.tid()
    slope = wp.vec3()
    for axis in range(3):
        low, high = wp.vec3i(i, j, k), wp.vec3i(i, j, k)
        low[axis] = wp.max(low[axis] - 1, 0)
        high[axis] = wp.min(high[axis] + 1, level.shape[axis] - 1)
        change = level[high[0], high[1], high[2]] - level[low[0], low[1], low[2]]
        slope[axis] = change / float(high[axis] - low[axis])
    gradient[i, j, k] = slope


@wp.kernel
def start_band(
    border: wp.array(dtype=wp.vec3i),
    level: wp.array3d(dtype=wp.float32),
    gradient: wp.array3d(dtype=wp.vec3),
    field: wp.array3d(dtype=wp.float32),
) -> None:
    """Compute the distance of the nodes with a neighbour on the other side.

    The closest point on the interpolated zero level is found by alternating steps onto the level and along it
    towards the node (Chopp, SIAM J. Sci. Comput. 23, 2001). If this does not converge near the node, the
    distance follows from the crossings of the three grid lines through it.
    """
    i, j, k = border[wp.tid()][0], border[wp.tid()][1], border[wp.tid()][2]
    side = wp.where(level[i, j, k] < 0.0, -1.0, 1.0)
    field[i, j, k] = side * _crossings(level, i, j, k)
    node = wp.vec3(float(i), float(j), float(k))
    foot = node
    moved = float(1.0)
    for _ in range(_TRIALS):
        if moved < 1.0e-4:
            break
        slope = _sample(gradient, foot)
        squared = wp.max(wp.dot(slope, slope), 1.0e-6)
        onto = -_sample(level, foot) / squared * slope
        apart = node - foot
        along = apart - wp.dot(apart, slope) / squared * slope
        foot += onto + along
        moved = wp.length(onto) + wp.length(along)
    reach = wp.length(node - foot)
    # in the middle of a thin wall the gradient vanishes and the point does not move
    on_level = wp.abs(_sample(level, foot)) < 0.1 * wp.abs(level[i, j, k])
    if moved < 0.01 and reach < 1.5 and on_level:
        field[i, j, k] = side * reach


@wp.func
def _upwind(near: float, behind: float, second_order: bool) -> wp.vec2:
    """Value and weight of an axis, from the nearer neighbour and the one behind it."""
    if second_order and near < _FAR and behind < near:
        return wp.vec2((4.0 * near - behind) / 3.0, 2.25)
    return wp.vec2(near, 1.0)


@wp.func
def _solve(
    field: wp.array3d(dtype=wp.float32), i: int, j: int, k: int, side: float, second_order: bool
) -> float:
    """Distance at a node from its six neighbours: Godunov's upwind scheme, optionally of second order."""
    below, above = side * _at(field, i - 1, j, k), side * _at(field, i + 1, j, k)
    step = wp.where(above < below, 2, -2)
    x = _upwind(wp.min(below, above), side * _at(field, i + step, j, k), second_order)
    below, above = side * _at(field, i, j - 1, k), side * _at(field, i, j + 1, k)
    step = wp.where(above < below, 2, -2)
    y = _upwind(wp.min(below, above), side * _at(field, i, j + step, k), second_order)
    below, above = side * _at(field, i, j, k - 1), side * _at(field, i, j, k + 1)
    step = wp.where(above < below, 2, -2)
    z = _upwind(wp.min(below, above), side * _at(field, i, j, k + step), second_order)
    return _quadratic(x, y, z)


@wp.func
def _quadratic(x: wp.vec2, y: wp.vec2, z: wp.vec2) -> float:
    """Largest u with sum of weight (u - value)² = 1 over the axes (value, weight) with value < u."""
    if y[0] < x[0]:
        x, y = y, x
    if z[0] < y[0]:
        y, z = z, y
    if y[0] < x[0]:
        x, y = y, x
    result = x[0] + 1.0 / wp.sqrt(x[1])
    a, b, c = x[1], x[1] * x[0], x[1] * x[0] * x[0] - 1.0
    if y[0] < result:
        a, b, c = a + y[1], b + y[1] * y[0], c + y[1] * y[0] * y[0]
        if b * b < a * c:
            return result
        result = (b + wp.sqrt(b * b - a * c)) / a
    if z[0] < result:
        a, b, c = a + z[1], b + z[1] * z[0], c + z[1] * z[0] * z[0]
        if b * b < a * c:
            return result
        result = (b + wp.sqrt(b * b - a * c)) / a
    return wp.min(result, _FAR)


@wp.kernel
def relax(
    field: wp.array3d(dtype=wp.float32),
    state: wp.array3d(dtype=wp.int32),
    turns: wp.array3d(dtype=wp.int32),
    active: wp.array(dtype=wp.vec3i),
    following: wp.array(dtype=wp.vec3i),
    n_following: wp.array(dtype=wp.int32),
    reach: float,
    tolerance: float,
    second_order: bool,
) -> None:
    """One round of the fast iterative method (Jeong and Whitaker 2008, algorithm 2.1).

    A node of the active list is updated from its neighbours. When its value has converged, it leaves the list
    (state 0) and activates those neighbours within reach that it improves (state 1); no node nearer to the
    zero level depends on it. With second differences values can oscillate where fronts meet: after many
    updates a node may only decrease. (Few updates suffice on a CPU; a GPU, which updates neighbours
    simultaneously, would stop while values still increase.)
    """
    node = active[wp.tid()]
    i, j, k = node[0], node[1], node[2]
    side = wp.where(field[i, j, k] < 0.0, -1.0, 1.0)
    old = side * field[i, j, k]
    new = _solve(field, i, j, k, side, second_order)
    turns[i, j, k] += 1
    if turns[i, j, k] > _FREE_TURNS:
        new = wp.min(new, old)
    field[i, j, k] = side * new
    if wp.abs(new - old) > tolerance:
        following[wp.atomic_add(n_following, 0, 1)] = node
        return
    state[i, j, k] = 0
    for neighbour in range(6):
        axis = neighbour / 2
        step = 2 * (neighbour % 2) - 1
        a = i + wp.where(axis == 0, step, 0)
        b = j + wp.where(axis == 1, step, 0)
        c = k + wp.where(axis == 2, step, 0)
        outside = a < 0 or b < 0 or c < 0 or a >= field.shape[0] or b >= field.shape[1] or c >= field.shape[2]
        if outside or state[a, b, c] != 0:
            continue
        beyond = wp.where(field[a, b, c] < 0.0, -1.0, 1.0)
        if beyond * field[a, b, c] <= new:
            continue
        better = _solve(field, a, b, c, beyond, second_order)
        change = better - beyond * field[a, b, c]
        if turns[a, b, c] < _FREE_TURNS:
            change = -wp.abs(change)
        if better <= reach and change < -tolerance and wp.atomic_max(state, a, b, c, 1) == 0:
            field[a, b, c] = beyond * better
            following[wp.atomic_add(n_following, 0, 1)] = wp.vec3i(a, b, c)


@wp.func
def _distance_within(mesh: wp.uint64, point: wp.vec3, reach: float) -> float:
    query = wp.mesh_query_point_no_sign(mesh, point, reach)
    if not query.result:
        return reach
    return wp.min(wp.length(point - wp.mesh_eval_position(mesh, query.face, query.u, query.v)), reach)


@wp.kernel
def distances_within(
    mesh: wp.uint64, points: wp.array(dtype=wp.vec3), reach: float, distances: wp.array(dtype=wp.float32)
) -> None:
    """Unsigned distance from points to a mesh, at most `reach`."""
    distances[wp.tid()] = _distance_within(mesh, points[wp.tid()], reach)


@wp.kernel
def distances_of_blocks(
    mesh: wp.uint64,
    corners: wp.array(dtype=wp.vec3i),
    size: int,
    reach: float,
    distances: wp.array3d(dtype=wp.float32),
) -> None:
    """As `distances_within`, for the nodes of cubic blocks with given first nodes."""
    block, number = wp.tid()
    i = corners[block][0] + number / (size * size)
    j = corners[block][1] + number / size % size
    k = corners[block][2] + number % size
    if i < distances.shape[0] and j < distances.shape[1] and k < distances.shape[2]:
        distances[i, j, k] = _distance_within(mesh, wp.vec3(float(i), float(j), float(k)), reach)


@wp.kernel
def closest_points(
    mesh: wp.uint64, points: wp.array(dtype=wp.vec3), closest: wp.array(dtype=wp.vec3)
) -> None:
    """Points of a mesh closest to others."""
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], 1.0e30)
    closest[i] = wp.mesh_eval_position(mesh, query.face, query.u, query.v)


@wp.kernel
def find_closest(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.vec3),
) -> None:
    """Face of a mesh and barycentric weights in it of the point closest to each of some points."""
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], 1.0e30)
    faces[i] = query.face
    weights[i] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)


@wp.kernel
def find_sides(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), inside: wp.array(dtype=wp.bool)) -> None:
    """Whether the winding number of a mesh around points is at least 1/2, at any distance."""
    query = wp.mesh_query_point_sign_winding_number(mesh, points[wp.tid()], _FAR, _ACCURACY)
    inside[wp.tid()] = query.result and query.sign < 0.0


@wp.kernel
def count_escaping(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    away: float,
    ahead: wp.array(dtype=wp.int32),
    behind: wp.array(dtype=wp.int32),
) -> None:
    """Count the directions in which rays from just before and just behind a face meet no other face."""
    here = wp.tid()
    normal = normals[here]
    for number in range(directions.shape[0]):
        way = directions[number]
        side = wp.sign(wp.dot(way, normal))
        query = wp.mesh_query_ray(mesh, points[here] + side * away * normal, way, _FAR)
        if query.result:
            continue
        if side > 0.0:
            ahead[here] += 1
        else:
            behind[here] += 1


@wp.kernel
def thickness_of_faces(mesh: wp.uint64, every: int, thickness: wp.array(dtype=wp.float32)) -> None:
    """Distance from the middle of every so many-th face, against its normal, to the next face."""
    face = wp.tid() * every
    middle = wp.mesh_eval_position(mesh, face, 1.0 / 3.0, 1.0 / 3.0)
    inward = -wp.mesh_eval_face_normal(mesh, face)
    a = wp.mesh_eval_position(mesh, face, 1.0, 0.0)
    start = 1.0e-4 * wp.length(a - middle)  # beyond the face itself
    query = wp.mesh_query_ray(mesh, middle + start * inward, inward, 1.0e30)
    thickness[wp.tid()] = wp.where(query.result, query.t + start, wp.inf)


@wp.kernel
def thickness_at_vertices(
    mesh: wp.uint64,
    normals: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    offset: float,
    ways: wp.array2d(dtype=wp.float32),
) -> None:
    """Distances inward from each vertex to the next face, along directions around the inward normal (z).

    Distances are projected onto the inward normal. Rays that meet no face, or the outer side of one, give -1.
    """
    i, j = wp.tid()
    inward = -normals[i]
    other = wp.vec3(1.0, 0.0, 0.0)
    if wp.abs(inward[0]) > 0.7:
        other = wp.vec3(0.0, 1.0, 0.0)
    across = wp.normalize(wp.cross(inward, other))
    ray = directions[j]
    way = ray[0] * across + ray[1] * wp.cross(inward, across) + ray[2] * inward
    start = wp.mesh_get(mesh).points[i] + offset * inward
    query = wp.mesh_query_ray(mesh, start, way, 1.0e30)
    ways[i, j] = -1.0
    if query.result and query.sign < 0.0:
        ways[i, j] = offset + query.t * directions[j][2]


@wp.kernel
def signed_distances_of_points(
    mesh: wp.uint64, points: wp.array(dtype=wp.vec3), distances: wp.array(dtype=wp.float32)
) -> None:
    """Distances to the nearest face, negative inside a closed surface."""
    i = wp.tid()
    query = wp.mesh_query_point_sign_normal(mesh, points[i], 1.0e30)
    distances[i] = query.sign * wp.length(
        points[i] - wp.mesh_eval_position(mesh, query.face, query.u, query.v)
    )
