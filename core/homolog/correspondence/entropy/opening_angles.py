"""Opening angles: convexity and concavity of a surface around each of its points.

The opening angle is 2 pi times the share of a Gaussian ball around the point that is inside the shape: pi on
a plane, the angle between the faces on an edge, less on a tip, more in a hollow (an integral invariant;
Pottmann et al. 2009). It is a smooth function in space, so it has a gradient for particles to follow.
"""

import math

import numpy as np
from scipy import ndimage

from homolog.arrays import Float32Array, FloatArray, IntArray
from homolog.surfaces.distance_field import DistanceField

__all__ = ["BALL_SIZE", "opening_grid", "openings_at"]

BALL_SIZE = (
    4.0  # standard deviation of the ball, in optimizer lengths: 4 % of the root of the mean surface area
)
NODES_PER_SIZE = 2.5  # of the coarser grid in that length, enough for a smooth function of it
MARGIN_NODES = 3  # coarse nodes added around the grid, for the splines


def opening_grid(field: DistanceField, size: float) -> tuple[Float32Array, FloatArray]:
    """Return opening angles on a grid.

    Parameters
    ----------
    field : DistanceField
    size : float
        Standard deviation of the ball [mm].

    Returns
    -------
    (I, J, K) float32 array
        Angles [rad], 0 far outside and 2 pi far inside.
    (4, 4) float64 array
        Affine from its indices to the field's coordinates [mm].
    """
    spacing = field.spacing
    block = max(1, int(size / (NODES_PER_SIZE * spacing)))
    nodes: IntArray = -(-np.array(field.values.shape) // block) * block
    inside = np.clip(0.5 - field.values / spacing, 0.0, 1.0)
    ends = [
        (MARGIN_NODES * block, MARGIN_NODES * block + int(n) - have)
        for n, have in zip(nodes, inside.shape, strict=True)
    ]
    inside = np.pad(inside, ends)
    i, j, k = (n // block for n in inside.shape)
    coarse = inside.reshape(i, block, j, block, k, block).mean(axis=(1, 3, 5), dtype=np.float32)
    remaining_width = (
        math.sqrt(max((size / spacing) ** 2 - (block**2 - 1) / 12.0, 0.01)) / block
    )  # means blur too
    inside_fraction = ndimage.gaussian_filter(coarse, remaining_width, mode="constant", truncate=MARGIN_NODES)
    grid = field.index_to_world.copy()
    grid[:3, 3] += grid[:3, :3] @ np.full(3, 0.5 * (block - 1) - MARGIN_NODES * block)
    grid[:3, :3] *= block
    return (2.0 * math.pi * inside_fraction).astype(np.float32), grid


def openings_at(points: FloatArray, values: Float32Array, grid: FloatArray) -> FloatArray:
    """Interpolate opening angles at points.

    Parameters
    ----------
    points : (n, 3) array
        In the field's coordinates [mm].
    values : (I, J, K) array
        Angles that `opening_grid` returned [rad].
    grid : (4, 4) array
        Their affine.

    Returns
    -------
    (n,) array
        Angles [rad].
    """
    nodes = np.linalg.solve(grid[:3, :3], (points - grid[:3, 3]).T)
    return np.asarray(ndimage.map_coordinates(values, nodes, np.float64, order=1, mode="nearest"))
