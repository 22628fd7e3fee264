"""How much of its surroundings a surface hides from its own points."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False})

__all__ = ["find_normals", "find_opposite", "occlude", "smooth"]


@wp.kernel
def find_normals(
    points: wp.array(dtype=wp.vec3), faces: wp.array2d(dtype=int), normals: wp.array(dtype=wp.vec3)
):
    """Find unit normals at the vertices, weighted by face area; 0 without any area. One thread."""
    for i in range(points.shape[0]):
        normals[i] = wp.vec3()
    for face in range(faces.shape[0]):
        a, b, c = points[faces[face, 0]], points[faces[face, 1]], points[faces[face, 2]]
        across = wp.cross(b - a, c - a)
        for corner in range(3):
            normals[faces[face, corner]] += across
    for i in range(points.shape[0]):
        normals[i] = wp.normalize(normals[i])


@wp.kernel
def smooth(
    faces: wp.array2d(dtype=int),
    rounds: int,
    around: wp.array(dtype=float),
    total: wp.array(dtype=float),
    values: wp.array(dtype=float),
):
    """Replace values at the vertices by the mean of the faces around them, several times. One thread.

    `around` and `total` are empty arrays of the same length.
    """
    for i in range(values.shape[0]):
        around[i] = float(0.0)
    for face in range(faces.shape[0]):
        for corner in range(3):
            around[faces[face, corner]] += 3.0
    for _ in range(rounds):
        for i in range(values.shape[0]):
            total[i] = float(0.0)
        for face in range(faces.shape[0]):
            part = values[faces[face, 0]] + values[faces[face, 1]] + values[faces[face, 2]]
            for corner in range(3):
                total[faces[face, corner]] += part
        for i in range(values.shape[0]):
            if around[i] > 0.0:
                values[i] = total[i] / around[i]


@wp.kernel
def occlude(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    reach: float,
    first: int,
    sets: int,
    openness: wp.array(dtype=float),
):
    """Share of directions (hemisphere around z) that are not occluded by the surface.

    Every vertex samples one of several interleaved sets of directions.
    """
    i = first + wp.tid()
    own = (i * 7 + i // 5) % sets  # neighbours have different sets for any order of vertices
    normal = normals[i]
    turn = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), normal)
    free = float(0.0)
    count = directions.shape[0] // sets
    for j in range(count):
        along = wp.quat_rotate(turn, directions[own + j * sets])
        if not wp.mesh_query_ray_anyhit(mesh, points[i] + 0.01 * reach * normal, along, reach):
            free += 1.0
    openness[i] = free / float(count)


@wp.kernel
def find_opposite(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    start: float,
    ahead: wp.array(dtype=float),
    behind: wp.array(dtype=float),
):
    """Distance of the surface along the normal of a vertex and against it; infinite without a hit."""
    i = wp.tid()
    out = wp.mesh_query_ray(mesh, points[i] + start * normals[i], normals[i], 1.0e30)
    ahead[i] = wp.where(out.result, out.t + start, wp.inf)
    into = wp.mesh_query_ray(mesh, points[i] - start * normals[i], -normals[i], 1.0e30)
    behind[i] = wp.where(into.result, into.t + start, wp.inf)
