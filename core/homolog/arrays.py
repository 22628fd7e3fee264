"""Array types and the read-only rule: arrays that are passed between packages can't be written to."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Array",
    "ArrayLike",
    "BoolArray",
    "DeviceArray",
    "Float32Array",
    "FloatArray",
    "IntArray",
    "frozen",
]

Array = NDArray[Any]
FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
DeviceArray = Any
"""A `wp.array`, without the type of its elements."""


def frozen(array: Array, dtype: Any = None) -> Array:  # noqa: ANN401 - anything that numpy accepts as a dtype
    """Return a contiguous, read-only array with the given values.

    Parameters
    ----------
    array : array_like
        Array of any shape. The caller's array stays writable: a view or copy is frozen.
    dtype : dtype, optional
        Type of the result; the array's own by default.

    Returns
    -------
    array
        Read-only array of the same shape.
    """
    result = np.ascontiguousarray(array, dtype=dtype).view()
    result.setflags(write=False)
    return result
