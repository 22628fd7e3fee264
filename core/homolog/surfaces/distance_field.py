"""Signed distance fields on isotropic grids: the implicit surfaces that particles live on."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from homolog.arrays import Float32Array, FloatArray, frozen

__all__ = ["DistanceField"]


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Signed distance to a closed surface, negative inside.

    Attributes
    ----------
    values : (I, J, K) float32 array
        Signed distance [mm] at the grid nodes, read-only. Every border node is outside (positive).
    index_to_world : (4, 4) float64 array
        Affine from grid indices (i, j, k) to LPS millimetres: spacing times a proper rotation, and an
        origin. Read-only.
    """

    values: Float32Array
    index_to_world: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "values", frozen(self.values, np.float32))
        object.__setattr__(self, "index_to_world", frozen(self.index_to_world, np.float64))

    def __reduce__(self) -> tuple[object, ...]:
        """Stay read-only through pickling."""
        return DistanceField, (self.values, self.index_to_world)

    @property
    def spacing(self) -> float:
        """Distance between neighbouring nodes [mm], the same along the three axes."""
        return float(np.linalg.norm(self.index_to_world[:3, 0]))

    def sample(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return value [mm] and gradient at points.

        Parameters
        ----------
        points : (N, 3) array
            LPS millimetres; outside the grid the nearest border value holds.

        Returns
        -------
        (N,) float64 array
            Trilinear in the values.
        (N, 3) float64 array
            Trilinear in the central differences of the values, in LPS.
        """
        axes = self.index_to_world[:3, :3] / self.spacing
        nodes = ((points - self.index_to_world[:3, 3]) @ axes / self.spacing).T
        values = ndimage.map_coordinates(self.values, nodes, np.float64, order=1, mode="nearest")
        slopes = np.empty((len(points), 3))
        for axis in range(3):
            ahead, behind = nodes.copy(), nodes.copy()
            ahead[axis] += 1.0
            behind[axis] -= 1.0
            slopes[:, axis] = ndimage.map_coordinates(self.values, ahead, np.float64, order=1, mode="nearest")
            slopes[:, axis] -= ndimage.map_coordinates(
                self.values, behind, np.float64, order=1, mode="nearest"
            )
        return values, slopes @ axes.T / (2.0 * self.spacing)

    def projected(self, points: FloatArray, steps: int = 3) -> FloatArray:
        """Return the points put onto the zero level by Newton steps along the gradient, shape (N, 3) [mm]."""
        for _ in range(steps):
            values, slopes = self.sample(points)
            squared = np.maximum((slopes**2).sum(axis=1), 0.25)
            points = points - np.clip(values / squared, -self.spacing, self.spacing)[:, None] * slopes
        return points
