"""Numbers of arrays by their place in memory.

Warp's own indexing, which allows for any strides and negative indices, takes as many instructions as what the
front's kernels compute from the values.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import Corner, Tell

wp.set_module_options({"enable_backward": False, "max_unroll": 8, "fast_math": True})


@wp.func_native("return values.data[at];")
def read(values: wp.array3d(dtype=wp.float32), at: int) -> float:
    """Return a value of an array by its place in memory."""
    ...


@wp.func_native("values.data[at] = value;")
def write(values: wp.array3d(dtype=wp.float32), at: int, value: float):
    """Put a value into an array, by its place in memory."""
    ...


@wp.func_native("return values.data[at];")
def int_at(values: wp.array(dtype=wp.int32), at: int) -> int:
    """Return a number of a list."""
    ...


@wp.func_native("return values.data[at];")
def int_in(values: wp.array2d(dtype=wp.int32), at: int) -> int:
    """Return a number of an array by its place in memory."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    atomicOr(flags.data + at, bits);
#else
    flags.data[at] |= bits;
#endif
""")
def set_bits(flags: wp.array2d(dtype=wp.int32), at: int, bits: int):
    """Set bits of an array by its place in memory, which others may be setting too."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("prefetch.global.L1 [%0];" ::"l"(values.data + at));
#endif
""")
def fetch(values: wp.array3d(dtype=wp.float32), at: int):
    """Begin to fetch a value that will be read soon."""
    ...


@wp.func_native("return corners.data[at].a;")
def a_of(corners: wp.array(dtype=Corner), at: int) -> int:
    """Return the a of one of the corners."""
    ...


@wp.func_native("return corners.data[at].b;")
def b_of(corners: wp.array(dtype=Corner), at: int) -> int:
    """Return the b of one of the corners."""
    ...


@wp.func_native("""
    const wp::float32* values = reinterpret_cast<const wp::float32*>(corners.data + at) + 4 * half;
#if defined(__CUDA_ARCH__)
    const float4 four = *reinterpret_cast<const float4*>(values);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    return wp::vec_t<4, wp::float32>(values[0], values[1], values[2], values[3]);
#endif
""")
def half_corner(corners: wp.array(dtype=Corner), at: int, half: int) -> wp.vec4:
    """Return the first or second four values of a corner, in one read."""
    ...


@wp.func
def corner_at(corners: wp.array(dtype=Corner), at: int) -> Corner:
    """Return one of the corners."""
    low = half_corner(corners, at, 0)
    high = half_corner(corners, at, 1)
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
    const float4 four = *reinterpret_cast<const float4*>(tells.data + at);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    const wp::float32* values = reinterpret_cast<const wp::float32*>(tells.data + at);
    return wp::vec_t<4, wp::float32>(values[0], values[1], values[2], values[3]);
#endif
""")
def tell_at(tells: wp.array(dtype=Tell), at: int) -> wp.vec4:
    """Return a tell, its places as the bits of a float, in one read."""
    ...


@wp.func_native("return tells.data[at].places;")
def places_of(tells: wp.array(dtype=Tell), at: int) -> int:
    """Return the places of one of the tells."""
    ...


@wp.func_native("return values.data[at];")
def read_word(values: wp.array3d(dtype=wp.uint32), at: int) -> wp.uint32:
    """Return a word by its place in memory."""
    ...


@wp.func_native("values.data[at] = value;")
def write_word(values: wp.array3d(dtype=wp.uint32), at: int, value: wp.uint32):
    """Put a word into an array, by its place in memory."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("prefetch.global.L1 [%0];" ::"l"(values.data + at));
#endif
""")
def fetch_word(values: wp.array3d(dtype=wp.uint32), at: int):
    """Begin to fetch a word that will be read soon."""
    ...
