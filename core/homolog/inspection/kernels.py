"""Warp kernel of the inspection: distances between particles along a mesh."""

import warp as wp

from homolog.correspondence.kernels.particles import Surface
from homolog.geodesics.kernels.lookup import SurfacePoint, blocks_of, geodesic

wp.set_module_options({"enable_backward": False})

__all__ = ["pair_distances"]


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
