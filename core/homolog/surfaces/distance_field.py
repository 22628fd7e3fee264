"""Signed distance fields on isotropic grids: the implicit surfaces that particles live on."""

from dataclasses import dataclass

import numpy as np

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

    @property
    def spacing(self) -> float:
        """Distance between neighbouring nodes [mm], the same along the three axes."""
        return float(np.linalg.norm(self.index_to_world[:3, 0]))
