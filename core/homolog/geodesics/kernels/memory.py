"""Direct memory access to arrays by linear index.

Warp's own indexing supports strides and negative indices; it takes as many instructions as the arithmetic of
the kernels.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels.local_solver import Corner, PropagationBound

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


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    atomicOr(flags.data + index, bits);
#else
    flags.data[index] |= bits;
#endif
""")
def set_bits(flags: wp.array2d(dtype=wp.int32), index: int, bits: int):
    """Set bits by linear index; atomic on CUDA."""
    ...


@wp.func_native("return corners.data[index].a;")
def corner_a(corners: wp.array(dtype=Corner), index: int) -> int:
    """Load a corner's vertex a."""
    ...


@wp.func_native("return corners.data[index].b;")
def corner_b(corners: wp.array(dtype=Corner), index: int) -> int:
    """Load a corner's vertex b."""
    ...


@wp.func_native("""
    const wp::float32* values = reinterpret_cast<const wp::float32*>(corners.data + index) + 4 * half;
#if defined(__CUDA_ARCH__)
    const float4 four = *reinterpret_cast<const float4*>(values);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    return wp::vec_t<4, wp::float32>(values[0], values[1], values[2], values[3]);
#endif
""")
def load_half_corner(corners: wp.array(dtype=Corner), index: int, half: int) -> wp.vec4:
    """Load the first or second half of a corner as one 16-byte vector."""
    ...


@wp.func
def load_corner(corners: wp.array(dtype=Corner), index: int) -> Corner:
    """Load a corner in two vector loads."""
    low = load_half_corner(corners, index, 0)
    high = load_half_corner(corners, index, 1)
    corner = Corner()
    corner.a = wp.cast(low[0], wp.int32)
    corner.b = wp.cast(low[1], wp.int32)
    corner.length = low[2]
    corner.half = low[3]
    corner.x = high[0]
    corner.y = high[1]
    corner.ac = high[2]
    corner.bc = high[3]
    return corner


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float4 four = *reinterpret_cast<const float4*>(bounds.data + index);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    const wp::float32* values = reinterpret_cast<const wp::float32*>(bounds.data + index);
    return wp::vec_t<4, wp::float32>(values[0], values[1], values[2], values[3]);
#endif
""")
def load_bound(bounds: wp.array(dtype=PropagationBound), index: int) -> wp.vec4:
    """Load a bound in one vector load; its ranks are the bits of the last float."""
    ...


@wp.func_native("return bounds.data[index].ranks;")
def load_ranks(bounds: wp.array(dtype=PropagationBound), index: int) -> int:
    """Load a bound's ranks."""
    ...
