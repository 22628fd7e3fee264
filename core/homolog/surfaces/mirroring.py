"""Mirror images, and maps that may be reflections."""

from typing import Final

import numpy as np

from homolog.arrays import BoolArray, FloatArray, frozen

__all__ = ["MIRROR", "mirrors"]

MIRROR: Final[FloatArray] = frozen(np.diag([-1.0, 1.0, 1.0, 1.0]))
"""Exchanges left and right (the first axis of LPS); it is its own inverse, and exact in floating point."""


def mirrors(matrices: FloatArray) -> BoolArray:
    """Return whether affine maps (..., 4, 4) exchange left and right, shape (...)."""
    return np.asarray(np.linalg.det(matrices[..., :3, :3]) < 0.0)
