"""Thickness of walls."""

import numpy as np
import warp as wp

from homolog.arrays import FloatArray
from homolog.device import choose_device
from homolog.surfaces.closest import on_device
from homolog.surfaces.kernels import distances as kernels
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["mean_over_area", "wall_thickness"]

_CONE = np.deg2rad(25.0)
_RINGS = ((0.0, 1), (0.5, 6), (1.0, 6))
_CLEAR = 1e-4  # of the mean edge: offset of the rays' start below the surface


def wall_thickness(mesh: TriangleMesh, *, device: str = "cpu") -> FloatArray:
    """Return the thickness of the solid below each vertex.

    Rays go inward from the vertex to the opposite side of the wall: one along the normal and twelve in a cone
    of 25° around it. The thickness is the median of their lengths, projected onto the normal, as in the shape
    diameter function (Shapira, Shamir, Cohen-Or 2008).

    Parameters
    ----------
    mesh : TriangleMesh
        Faces counter-clockwise seen from outside.
    device : str
        ``"cpu"`` or a CUDA device.

    Returns
    -------
    (V,) float64 array
        Thickness [mm]; NaN without an opposite side, as at the border of an open surface.
    """
    with wp.ScopedDevice(choose_device(device)):
        surface, _ = on_device(mesh)
        directions = _directions()
        ways = wp.empty((len(mesh.vertices), len(directions)), dtype=wp.float32)
        inputs = [
            surface.id,
            wp.array(mesh.vertex_normals.astype(np.float32), dtype=wp.vec3),
            wp.array(directions.astype(np.float32), dtype=wp.vec3),
            float(_CLEAR * mesh.mean_edge),
            ways,
        ]
        wp.launch(kernels.thickness_at_vertices, ways.shape, inputs)
        lengths = ways.numpy().astype(np.float64)
    lengths[lengths < 0.0] = np.nan
    seen = ~np.isnan(lengths).all(axis=1)
    result = np.full(len(lengths), np.nan)
    result[seen] = np.nanmedian(lengths[seen], axis=1)
    return result


def mean_over_area(mesh: TriangleMesh, values: FloatArray) -> float:
    """Return the area-weighted mean of values on a surface, ignoring NaN; NaN if all are NaN.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (V,) array
        Values at the vertices, such as those of `wall_thickness`.
    """
    weights, known = mesh.vertex_areas, ~np.isnan(values)
    total = float(weights[known].sum())
    return float(weights[known] @ values[known]) / total if total > 0.0 else float("nan")


def _directions() -> FloatArray:
    """Return unit vectors around z, in rings of a cone."""
    rays = []
    for share, count in _RINGS:
        turn = 2.0 * np.pi * (np.arange(count) + share) / count
        tilt = np.full(count, share * _CONE)
        rays.append(
            np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
        )
    return np.concatenate(rays)
