"""Kernels for exchanges of particles: near particles, products of rows, and pairs whose exchange pays."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = [
    "NEAREST",
    "N_NEIGHBOURS",
    "EntropyPart",
    "find_expected",
    "find_nearest",
    "find_promising",
    "multiply_rows",
]

NEAREST = wp.constant(12)
"""Number of nearest particles with which a particle may be exchanged."""
N_NEIGHBOURS = wp.constant(8)
"""Number of particles that predict the position of one between them."""


@wp.struct
class EntropyPart:
    """What the changes of H(Z) or H(V) by all pairs have in common (see `Survey`)."""

    own: wp.array(dtype=wp.float64)  # (M,) p' C^-1 p of each shape
    pulled: wp.array2d(dtype=wp.vec3d)  # (N, M), C^-1 times the rows
    alone: wp.array(dtype=wp.mat33d)  # (N,) products of each particle's rows
    mixed: wp.array(dtype=wp.mat33d)  # and of those of pairs
    weight: wp.float64  # times the factor of the logarithm


@wp.kernel
def find_nearest(
    first: int, count: int, positions: wp.array(dtype=wp.vec3d), nearest: wp.array2d(dtype=wp.int32)
):
    """Find the nearest particles of the same shape; thread (particle, counted from `first`)."""
    particle = first + wp.tid()
    begin = particle // count * count
    distances = wp.vector(wp.float64(1.0e300), length=NEAREST)
    for other in range(begin, begin + count):
        distance = wp.length_sq(positions[other] - positions[particle])
        if other != particle and distance < distances[NEAREST - 1]:
            place = int(NEAREST - 1)
            while place > 0 and distance < distances[wp.max(place - 1, 0)]:
                distances[place] = distances[place - 1]
                nearest[particle, place] = nearest[particle, place - 1]
                place -= 1
            distances[place] = distance
            nearest[particle, place] = other - begin


@wp.kernel
def find_expected(
    first: int,
    neighbours: wp.array2d(dtype=wp.int32),
    mean: wp.array(dtype=wp.vec3d),
    positions: wp.array(dtype=wp.vec3d),
    expected: wp.array(dtype=wp.vec3d),
    nearest: wp.array(dtype=wp.int32),
):
    """Find a particle's mean plus its neighbours' median deviation, and the other particle nearest to that.

    Thread (particle, counted from `first`).
    """
    particle = first + wp.tid()
    count = mean.shape[0]
    begin = particle // count * count
    place = particle - begin
    middle = wp.vec3d()
    for axis in range(3):
        sorted_values = wp.vector(wp.float64(0.0), length=N_NEIGHBOURS)
        for k in range(N_NEIGHBOURS):
            near = neighbours[place, k]
            value = positions[begin + near][axis] - mean[near][axis]
            at = int(k)
            while at > 0 and value < sorted_values[wp.max(at - 1, 0)]:
                sorted_values[at] = sorted_values[at - 1]
                at -= 1
            sorted_values[at] = value
        middle[axis] = (sorted_values[N_NEIGHBOURS // 2 - 1] + sorted_values[N_NEIGHBOURS // 2]) / wp.float64(
            2.0
        )
    there = mean[place] + middle
    expected[particle] = there
    shortest = wp.float64(1.0e300)
    for other in range(begin, begin + count):
        distance = wp.length_sq(positions[other] - there)
        if other != particle and distance < shortest:
            shortest = distance
            nearest[particle] = other - begin


@wp.kernel
def multiply_rows(
    first: int,
    pairs: wp.array2d(dtype=wp.int32),
    rows: wp.array2d(dtype=wp.vec3d),
    pulled: wp.array2d(dtype=wp.vec3d),
    products: wp.array(dtype=wp.mat33d),
):
    """Write y_i' C^-1 y_j of the coordinates of particles i and j; thread (pair, counted from `first`)."""
    pair = first + wp.tid()
    i = pairs[pair, 0]
    j = pairs[pair, 1]
    total = wp.mat33d()
    for shape in range(rows.shape[1]):
        total += wp.outer(rows[i, shape], pulled[j, shape])
    products[pair] = total


@wp.func
def log_at(normal: wp.vec3d, mean: wp.vec3d) -> wp.vec3d:
    """Return the Log of a unit normal at a mean."""
    cosine = wp.clamp(wp.dot(normal, mean), wp.float64(-1.0 + 1.0e-9), wp.float64(1.0))
    angle = wp.acos(cosine)
    part = wp.float64(1.0)
    if angle > wp.float64(1.0e-12):
        part = wp.sin(angle) / angle
    return (normal - cosine * mean) / part


@wp.func
def gain_of(
    part: EntropyPart,
    shape: int,
    i: int,
    j: int,
    number: int,
    here: wp.vec3d,
    there: wp.vec3d,
    c: wp.float64,
) -> wp.float64:
    """Return by how much the weighted entropy falls if the rows change by `here` at i and by `there` at j."""
    mixed = wp.dot(part.pulled[i, shape], here) + wp.dot(part.pulled[j, shape], there)
    both = wp.dot(here, part.alone[i] * here) + wp.dot(there, part.alone[j] * there)
    both += wp.float64(2.0) * wp.dot(here, part.mixed[number] * there)
    squared = wp.length_sq(here) + wp.length_sq(there)
    own = part.own[shape]
    determinant = (c + squared * own + mixed) * (c + mixed) - own * (squared * mixed + both)
    return -part.weight * wp.log(determinant / (c * c))


@wp.kernel
def find_promising(
    first: int,
    c: wp.float64,
    least: wp.float64,
    nearest: wp.array2d(dtype=wp.int32),
    allowed: wp.array(dtype=bool),
    codes: wp.array(dtype=wp.int64),
    means: wp.array(dtype=wp.vec3d),
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    openings: wp.array(dtype=wp.float64),
    ensemble: EntropyPart,
    of_normals: EntropyPart,
    promising: wp.array2d(dtype=bool),
):
    """Mark the near particles with which an exchange lowers H(Z) and the objective; thread (particle)."""
    particle = first + wp.tid()
    count = means.shape[0]
    shape = particle // count
    place = particle - shape * count
    for column in range(nearest.shape[1]):
        near = nearest[particle, column]
        other = shape * count + near
        if place != near and allowed[particle] and allowed[other]:
            i = wp.min(place, near)
            j = wp.max(place, near)
            a = shape * count + i
            b = shape * count + j
            number = wp.lower_bound(codes, wp.int64(i) * wp.int64(count) + wp.int64(j))
            step = positions[b] - positions[a]
            gain = gain_of(ensemble, shape, i, j, number, step, -step, c)
            if gain > wp.float64(0.0):
                open = openings[b] - openings[a]
                here = log_at(normals[b], means[i]) - log_at(normals[a], means[i]) + open * means[i]
                there = log_at(normals[a], means[j]) - log_at(normals[b], means[j]) - open * means[j]
                gain += gain_of(of_normals, shape, i, j, number, here, there, c)
                promising[particle, column] = gain > least
