"""How far a surface moves outward, and a scale for it."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["common_limit", "outward_displacement"]

_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def outward_displacement(mesh: TriangleMesh, displacement: FloatArray) -> FloatArray:
    """Return the part of a displacement (V, 3) along the outward normals [mm], shape (V,)."""
    return np.asarray((displacement * mesh.vertex_normals).sum(axis=1))


def common_limit(values: Sequence[FloatArray]) -> float:
    """Return a round value [mm] that 99 % of all the given values stay below."""
    reach = float(np.percentile(np.abs(np.concatenate(values)), 99.0))
    if reach <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(reach))
    return float(next(step for step in _STEPS if step * power >= 0.99 * reach) * power)
