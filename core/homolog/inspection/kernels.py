"""Warp kernels of the inspection: normals of a mesh at points, distances between particles along it."""

import warp as wp

from homolog.correspondence.kernels.particles import Surface
from homolog.geodesics.kernels.lookup import SurfacePoint, blocks_of, geodesic

wp.set_module_options({"enable_backward": False})

__all__ = ["closest_points_on", "pair_distances"]


@wp.kernel
def closest_points_on(
    mesh: wp.uint64,
    reach: float,
    points: wp.array(dtype=wp.vec3),
    vertex_normals: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=int),
    away: wp.array(dtype=float),
):
    """Find the closest point of a mesh for each point: unit normal (from the vertices), face and distance."""
    p = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[p], reach)
    away[p] = reach
    if query.result:
        corners = wp.vec3i(
            wp.mesh_get_index(mesh, 3 * query.face),
            wp.mesh_get_index(mesh, 3 * query.face + 1),
            wp.mesh_get_index(mesh, 3 * query.face + 2),
        )
        last = 1.0 - query.u - query.v
        normal = query.u * vertex_normals[corners[0]] + query.v * vertex_normals[corners[1]]
        normals[p] = wp.normalize(normal + last * vertex_normals[corners[2]])
        faces[p] = query.face
        away[p] = wp.length(wp.mesh_eval_position(mesh, query.face, query.u, query.v) - points[p])


@wp.kernel
def pair_distances(
    surfaces: wp.array(dtype=Surface),
    closest: wp.array(dtype=SurfacePoint),
    pairs: wp.array(dtype=wp.vec2i),
    distances: wp.array(dtype=float),
):
    """Geodesic distance between the two particles of each pair, negative beyond the table's range."""
    p = wp.tid()
    pair = pairs[p]
    table = surfaces[0].table
    x = closest[pair[0]]
    distances[p] = geodesic(table, blocks_of(table, x.corners), x, closest[pair[1]]).distance
