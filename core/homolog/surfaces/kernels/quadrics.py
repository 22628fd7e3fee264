"""Warp functions of quadrics: squared distances to the planes of faces around a vertex.

Rows of quadrics: xx, xy, xz, yy, yz, zz, then the linear terms and the constant one.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = ["add_quadrics", "collapsed"]

_TO_MIDDLE = wp.constant(wp.float64(1.0e-3))
"""Weight of the edge's length, so that short edges collapse first in flat parts."""
_HALF = wp.constant(wp.float64(0.5))


@wp.kernel
def add_quadrics(
    origins: wp.array(dtype=int),
    vertices: wp.array(dtype=wp.vec3d),
    quadrics: wp.array2d(dtype=wp.float64),
):
    """Add the squared distance to each face's plane, times its area, to the quadrics of its corners."""
    side = 3 * wp.tid()
    a = vertices[origins[side]]
    across = _HALF * wp.cross(vertices[origins[side + 1]] - a, vertices[origins[side + 2]] - a)
    area = wp.length(across)
    n = across / wp.max(area, wp.float64(1.0e-300))
    offset = -wp.dot(n, a)
    weighted = area * n
    for corner in range(3):
        v = origins[side + corner]
        quadrics[v, 0] += weighted[0] * n[0]
        quadrics[v, 1] += weighted[0] * n[1]
        quadrics[v, 2] += weighted[0] * n[2]
        quadrics[v, 3] += weighted[1] * n[1]
        quadrics[v, 4] += weighted[1] * n[2]
        quadrics[v, 5] += weighted[2] * n[2]
        for axis in range(3):
            quadrics[v, 6 + axis] += weighted[axis] * offset
        quadrics[v, 9] += area * offset * offset


@wp.func
def collapsed(
    u: int, v: int, vertices: wp.array(dtype=wp.vec3d), quadrics: wp.array2d(dtype=wp.float64)
) -> wp.vec4d:
    """Position of a collapsed edge, and the cost: distance² to the planes of both ends, times areas.

    Without quadrics the position is the midpoint.
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
