"""Direct memory access to arrays by linear index.

Warp's own indexing supports strides and negative indices. It would take as many instructions as the
arithmetic of the kernels.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})


@wp.func_native("return values.data[index];")
def load(values: wp.array3d(dtype=wp.float32), index: int) -> float:
    """Load a value by its linear index."""
    ...


@wp.func_native("values.data[index] = value;")
def store(values: wp.array3d(dtype=wp.float32), index: int, value: float):
    """Store a value by its linear index."""
    ...


@wp.func_native("return values.data[index];")
def load_int(values: wp.array(dtype=wp.int32), index: int) -> int:
    """Load an integer of a list."""
    ...


@wp.func_native("return values.data[index];")
def load_int_2d(values: wp.array2d(dtype=wp.int32), index: int) -> int:
    """Load an integer by its linear index."""
    ...
