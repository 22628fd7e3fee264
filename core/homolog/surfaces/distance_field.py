"""Signed distance fields on isotropic grids: the implicit surfaces that carry the particles."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from homolog.arrays import Float32Array, FloatArray, frozen
from homolog.memory import Store
from homolog.surfaces.kernels import fields as kernels
from homolog.surfaces.mirroring import MIRROR

__all__ = ["DistanceField"]


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Signed distance to a closed surface, negative inside.

    Attributes
    ----------
    values : (I, J, K) float32 array
        Signed distance [mm] at the grid nodes, read-only. Every border node is outside (positive).
    index_to_world : (4, 4) float64 array
        Affine from grid indices (i, j, k) to LPS millimetres: spacing times a rotation (a reflection, for
        the field of a mirror image), and an origin. Read-only.
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

    def stored(self, store: Store) -> "DistanceField":
        """Return the field with its values in a store."""
        return DistanceField(store(self.values), self.index_to_world)

    @property
    def spacing(self) -> float:
        """Distance between neighbouring nodes [mm], the same along the three axes."""
        return float(np.linalg.norm(self.index_to_world[:3, 0]))

    @property
    def mirrored(self) -> "DistanceField":
        """The distance to the mirror image; its grid is the mirror image of this one."""
        return DistanceField(self.values, MIRROR @ self.index_to_world)

    def sample_values(self, points: FloatArray) -> FloatArray:
        """Return the values at points, interpolated trilinearly.

        Parameters
        ----------
        points : (N, 3) array
            Positions in LPS [mm]; outside the grid the nearest border value is used.

        Returns
        -------
        (N,) float64 array
            Values [mm].
        """
        values = np.empty(len(points))
        self._run(kernels.sample_values, self._nodes(points)[1], wp.array(values, device="cpu", copy=False))
        return values

    def gradients(self, points: FloatArray) -> FloatArray:
        """Return the gradients at points (N, 3), shape (N, 3): central differences over two nodes, in LPS."""
        axes, nodes = self._nodes(points)
        slopes = np.empty((len(points), 3))
        self._run(kernels.sample_slopes, nodes, wp.array(slopes, dtype=wp.vec3d, device="cpu", copy=False))
        return np.asarray(slopes @ axes.T / self.spacing)

    def curvedness(self, points: FloatArray) -> FloatArray:
        """Return the root of the sum of squared principal curvatures at points (N, 3), shape (N,) [1/mm]."""
        h = self.spacing
        squared = np.zeros(len(points))
        for axis in np.eye(3):
            ahead, behind = self.gradients(points + h * axis), self.gradients(points - h * axis)
            squared += ((ahead - behind) ** 2).sum(axis=1) / (2.0 * h) ** 2
        return np.asarray(np.sqrt(squared))

    def _nodes(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the grid's axes in LPS, columns of (3, 3), and the points in grid indices, (N, 3)."""
        axes = self.index_to_world[:3, :3] / self.spacing
        nodes = (points - self.index_to_world[:3, 3]) @ axes / self.spacing
        return axes, np.ascontiguousarray(nodes)

    def _run(self, kernel: wp.Kernel, nodes: FloatArray, *further: object) -> None:
        """Launch a kernel on the grid, points in grid indices, and further arguments."""
        grid = wp.array(self.values, device="cpu", copy=False)
        places = wp.array(nodes, dtype=wp.vec3d, device="cpu", copy=False)
        wp.launch(kernel, len(nodes), [grid, places, *further], device="cpu")

    def projected(self, points: FloatArray, steps: int = 3) -> FloatArray:
        """Return the points projected to the zero level by Newton steps along the gradient, (N, 3) [mm]."""
        axes, nodes = self._nodes(points)
        self._run(kernels.project, nodes, self.spacing, steps)
        return np.asarray(nodes @ axes.T * self.spacing + self.index_to_world[:3, 3])
