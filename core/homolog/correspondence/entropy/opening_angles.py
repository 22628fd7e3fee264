"""Opening angles: convexity and concavity of a surface around each of its points.

The opening angle is 2 pi times the share of a Gaussian ball around the point that is inside the shape: pi on
a plane, the angle between the faces on an edge, less on a tip, more in a hollow (an integral invariant;
Pottmann et al. 2009). It is smooth in space, so that particles can follow its gradient.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import ndimage

from homolog.arrays import Float32Array, FloatArray
from homolog.surfaces.distance_field import DistanceField

__all__ = ["BALL_SIZE", "MARGIN_NODES", "OpeningGrid", "opening_grid", "openings_at"]

BALL_SIZE = (
    4.0  # standard deviation of the ball, in optimizer lengths: 4 % of the root of the mean surface area
)
NODES_PER_SIZE = 2.5  # of the coarser grid in that length, enough for a smooth function of it
MARGIN_NODES = 3  # coarse nodes added around the grid, for the splines


@dataclass(frozen=True, slots=True, eq=False)
class OpeningGrid:
    """The grid of a shape's opening angles.

    Attributes
    ----------
    shape : tuple of 3 int
        Nodes along each axis.
    block : int
        Nodes of the distance field along each edge of a node's cube.
    width : float
        Standard deviation of the ball that is left to blur with [nodes].
    index_to_local : (4, 4) array
        Affine from indices to the field's coordinates [mm].
    """

    shape: tuple[int, int, int]
    block: int
    width: float
    index_to_local: FloatArray

    @classmethod
    def of(cls, field: DistanceField, size: float) -> Self:
        """Choose the grid for a ball of standard deviation `size` [mm]."""
        spacing = field.spacing
        block = max(1, int(size / (NODES_PER_SIZE * spacing)))
        i, j, k = (-(-n // block) + 2 * MARGIN_NODES for n in field.values.shape)
        remaining = max((size / spacing) ** 2 - (block**2 - 1) / 12.0, 0.01)  # means blur too
        grid = field.index_to_world.copy()
        grid[:3, 3] += grid[:3, :3] @ np.full(3, 0.5 * (block - 1) - MARGIN_NODES * block)
        grid[:3, :3] *= block
        return cls((i, j, k), block, math.sqrt(remaining) / block, grid)

    def nodes(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in grid indices, (3, n)."""
        axes, origin = self.index_to_local[:3, :3], self.index_to_local[:3, 3]
        return np.asarray(np.linalg.solve(axes, (points - origin).T), np.float64)


def opening_grid(field: DistanceField, size: float) -> tuple[Float32Array, OpeningGrid]:
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
    OpeningGrid
        Where its nodes are.
    """
    layout = OpeningGrid.of(field, size)
    block = layout.block
    inside = np.clip(0.5 - field.values / field.spacing, 0.0, 1.0)
    ends = [
        (MARGIN_NODES * block, (nodes - MARGIN_NODES) * block - have)
        for nodes, have in zip(layout.shape, inside.shape, strict=True)
    ]
    inside = np.pad(inside, ends)
    if block > 1:
        i, j, k = layout.shape
        inside = inside.reshape(i, block, j, block, k, block).mean(axis=(1, 3, 5), dtype=np.float32)
    inside_fraction = ndimage.gaussian_filter(inside, layout.width, mode="constant", truncate=MARGIN_NODES)
    return (2.0 * math.pi * inside_fraction).astype(np.float32), layout


def openings_at(points: FloatArray, values: Float32Array, grid: OpeningGrid) -> FloatArray:
    """Interpolate opening angles at points.

    Parameters
    ----------
    points : (n, 3) array
        In the field's coordinates [mm].
    values : (I, J, K) array
        Angles that `opening_grid` returned [rad].
    grid : OpeningGrid
        Where they are.

    Returns
    -------
    (n,) array
        Angles [rad].
    """
    nodes = grid.nodes(points)
    return np.asarray(ndimage.map_coordinates(values, nodes, np.float64, order=1, mode="nearest"))
