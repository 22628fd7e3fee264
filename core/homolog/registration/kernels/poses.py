"""Kernels for the poses of shapes, on the host: what numpy does in many small calls."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["align_shapes"]

Equations = wp.types.matrix(shape=(7, 7), dtype=wp.float64)
Unknowns = wp.types.vector(length=7, dtype=wp.float64)


@wp.func
def select(values: wp.array2d(dtype=wp.float64), row: int, rank: int):
    """Sort a row so far that the value of a rank is in its place, with no larger one before it."""
    low = int(0)
    high = values.shape[1] - 1
    while low < high:
        pivot = values[row, rank]
        i = int(low)
        j = int(high)
        while i <= j:
            while values[row, i] < pivot:
                i += 1
            while pivot < values[row, j]:
                j -= 1
            if i <= j:
                kept = values[row, i]
                values[row, i] = values[row, j]
                values[row, j] = kept
                i += 1
                j -= 1
        if j < rank:
            low = i
        if rank < i:
            high = j


@wp.func
def median_of(values: wp.array2d(dtype=wp.float64), row: int) -> wp.float64:
    """Return the median of a row, whose order changes."""
    count = values.shape[1]
    half = count // 2
    select(values, row, half)
    if count % 2 == 1:
        return values[row, half]
    below = values[row, 0]
    for k in range(1, half):
        below = wp.max(below, values[row, k])
    return wp.float64(0.5) * (below + values[row, half])


@wp.func
def solved(matrix: Equations, right: Unknowns, size: int) -> Unknowns:
    """Solve symmetric positive definite equations (Cholesky)."""
    lower = Equations()
    x = Unknowns()
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                lower[i, i] = wp.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * x[k]
        x[i] = total / lower[i, i]
    for step in range(size):
        i = size - 1 - step
        total = x[i]
        for k in range(i + 1, size):
            total -= lower[k, i] * x[k]
        x[i] = total / lower[i, i]
    return x


@wp.func
def rotation_of(turn: wp.vec3d) -> wp.mat33d:
    """Return the matrix of a rotation vector."""
    half = wp.float64(0.5) * wp.length(turn)
    ratio = wp.float64(1.0)
    if half > wp.float64(1.0e-9):
        ratio = wp.sin(half) / half
    axis = wp.float64(0.5) * ratio * turn
    return wp.quat_to_matrix(wp.quatd(axis[0], axis[1], axis[2], wp.cos(half)))


@wp.struct
class Moments:
    """Weighted sums over the points of a shape, counted from their centre, and over their offsets."""

    total: wp.float64  # weights
    first: wp.vec3d  # points
    shift: wp.vec3d  # offsets
    second: wp.mat33d  # point ⊗ point
    cross: wp.mat33d  # point ⊗ offset


@wp.func
def add_point(moments: Moments, place: wp.vec3d, offset: wp.vec3d, weight: wp.float64) -> Moments:
    """Return the moments with a further point."""
    weighted = weight * place
    moments.total += weight
    moments.first += weighted
    moments.shift += weight * offset
    moments.second += wp.outer(weighted, place)
    moments.cross += wp.outer(weighted, offset)
    return moments


@wp.func
def least_squares(moments: Moments, scaling: int) -> Unknowns:
    """Return the rotation vector, shift and logarithm of the scale that come closest to the offsets."""
    second = moments.second
    first = moments.first
    cross = moments.cross
    trace = second[0, 0] + second[1, 1] + second[2, 2]
    matrix = Equations()
    right = Unknowns()
    for i in range(3):
        for j in range(3):
            matrix[i, j] = -second[i, j]
        matrix[i, i] += trace
        matrix[3 + i, 3 + i] = moments.total
        matrix[6, i + 3] = first[i]
        following = (i + 1) % 3
        last = (i + 2) % 3
        # the cross product of an axis and the first moment
        matrix[3 + following, i] = -first[last]
        matrix[3 + last, i] = first[following]
        right[i] = cross[following, last] - cross[last, following]
        right[3 + i] = moments.shift[i]
    matrix[6, 6] = trace
    right[6] = cross[0, 0] + cross[1, 1] + cross[2, 2]
    return solved(matrix, right, 6 + scaling)


@wp.kernel
def align_shapes(
    rows: wp.array(dtype=int),
    begin: int,
    place: int,
    pulls: wp.array2d(dtype=wp.vec3d),
    factors: wp.array(dtype=wp.float64),
    outlier_ratio: wp.float64,
    scaling: int,
    points: wp.array2d(dtype=wp.vec3d),
    changes: wp.array2d(dtype=wp.vec3d),
    squares: wp.array2d(dtype=wp.float64),
    steps: wp.array(dtype=wp.mat44d),
):
    """Move each shape by the similarity that its pulls ask for (see `homolog.registration.procrustes`).

    Parameters
    ----------
    rows
        The shapes, of which thread k moves that at `begin` + k.
    place
        Where the pulls and factors of the first one lie.
    factors
        From pulls to offsets.
    changes, squares, steps
        One for each thread: what its points moved by, space, and the similarity.
    """
    thread = wp.tid()
    shape = rows[begin + thread]
    own = place + thread
    count = points.shape[1]
    factor = factors[own]
    centre = wp.vec3d()
    for i in range(count):
        centre += points[shape, i]
        squares[thread, i] = wp.length_sq(factor * pulls[own, i])
    centre /= wp.float64(count)
    scale = outlier_ratio * wp.max(median_of(squares, thread), wp.float64(1.0e-12))
    moments = Moments()
    for i in range(count):
        offset = factor * pulls[own, i]
        ratio = wp.float64(1.0) + wp.length_sq(offset) / scale
        weight = wp.float64(1.0) / (ratio * ratio)
        moments = add_point(moments, points[shape, i] - centre, offset, weight)
    change = least_squares(moments, scaling)
    linear = rotation_of(wp.vec3d(change[0], change[1], change[2]))
    if scaling == 1:
        linear = wp.exp(change[6]) * linear
    away = centre + wp.vec3d(change[3], change[4], change[5]) - linear * centre
    for i in range(count):
        before = points[shape, i]
        moved = linear * before + away
        changes[thread, i] = moved - before
        points[shape, i] = moved
    step = wp.identity(n=4, dtype=wp.float64)
    for i in range(3):
        for j in range(3):
            step[i, j] = linear[i, j]
        step[i, 3] = away[i]
    steps[thread] = step
