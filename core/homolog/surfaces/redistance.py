"""Signed distances on a grid by the fast iterative method."""

import numpy as np
import warp as wp
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array
from homolog.device import choose_device
from homolog.surfaces.kernels import distances as kernels

__all__ = ["redistanced"]

_TOLERANCE = 1e-3  # voxels
_ROUNDS = 4
_EVERY = 3  # spacing of the nodes of approximate distances [nodes]


def redistanced(
    level: Array, *, reach: float | None = None, device: str = "cpu", second_order: bool = True
) -> Float32Array:
    """Return the signed distance to the zero level of a function on a regular grid.

    Next to the zero level the distance is that to the trilinear interpolant; further out the eikonal
    equation |∇φ| = 1 is solved by the fast iterative method with Godunov's upwind differences
    (W.-K. Jeong, R. T. Whitaker: A Fast Iterative Method for Eikonal Equations, SIAM J. Sci. Comput. 30,
    2008).

    Parameters
    ----------
    level : (I, J, K) array
        Level function of any scale, negative inside, with a zero level.
    reach : int, optional
        Range of exact distances from the zero level [voxels], by default unlimited. Beyond it, distances are
        accurate to about a voxel.
    device : str
        ``"cpu"`` or a CUDA device.
    second_order : bool
        Whether to use second differences where two upwind nodes are known.

    Returns
    -------
    (I, J, K) float32 array
        Distances in voxels, with the signs of `level`.
    """
    device = choose_device(device)
    level = np.ascontiguousarray(level, dtype=np.float32)
    inside = level < 0.0
    border = _border(inside)
    with wp.ScopedDevice(device):
        given, slopes = wp.array(level), wp.empty(level.shape, dtype=wp.vec3)
        signed = wp.array(np.where(inside, np.float32(-kernels.FAR), np.float32(kernels.FAR)))
        wp.launch(kernels.find_gradient, level.shape, [given, slopes])
        nodes = wp.array(np.argwhere(border).astype(np.int32), dtype=wp.vec3i)
        wp.launch(kernels.start_band, len(nodes), [nodes, given, slopes, signed])
        _propagate(signed, border, kernels.FAR if reach is None else reach, second_order)
        result = np.asarray(signed.numpy())
    return result if reach is None else _filled(result, reach)


def _filled(signed: Float32Array, reach: float) -> Float32Array:
    """Fill in distances far from the zero level by interpolation from a coarse grid."""
    far = np.abs(signed) == kernels.FAR
    rough: Array = ndimage.distance_transform_edt(far[::_EVERY, ::_EVERY, ::_EVERY])
    rough = _EVERY * np.maximum(rough - 0.5, 0.0)  # the border of the near nodes is between two nodes
    rough = rough.astype(np.float32)
    for axis, size in enumerate(signed.shape):
        places = np.arange(size) / _EVERY
        low = np.minimum(places.astype(int), rough.shape[axis] - 1)
        high = np.minimum(low + 1, rough.shape[axis] - 1)
        share = np.expand_dims((places - low).astype(np.float32), tuple(range(1, 3 - axis)))
        a, b = np.take(rough, low, axis), np.take(rough, high, axis)
        rough = a + share * (b - a)
    return np.where(far, np.copysign(np.float32(reach) + rough, signed), signed)


def _border(inside: BoolArray) -> BoolArray:
    """Return the nodes with a neighbour of the other kind."""
    border = np.zeros_like(inside)
    for axis in range(3):
        marked, nodes = np.moveaxis(border, axis, 0), np.moveaxis(inside, axis, 0)
        differ = nodes[1:] != nodes[:-1]
        marked[1:] |= differ
        marked[:-1] |= differ
    return border


def _propagate(signed: wp.array, fixed: BoolArray, reach: float, second_order: bool) -> None:
    """Relax from the fixed nodes outward until nothing changes within reach."""
    start = np.argwhere(_border(fixed) & ~fixed).astype(np.int32)
    marks = np.where(fixed, np.int32(2), np.int32(0))
    marks[tuple(start.T)] = 1
    state = wp.array(marks)
    capacity = 1 + int(np.count_nonzero(~fixed))
    lists = [wp.empty(capacity, dtype=wp.vec3i) for _ in range(2)]
    if len(start):
        lists[0][: len(start)].assign(start)
    turns = wp.zeros_like(state)
    count, total = len(start), wp.zeros(1, dtype=wp.int32)
    for _ in range(_ROUNDS * sum(signed.shape)):  # enough for a front to cross the grid; usually far fewer
        if not count:
            break
        total.zero_()
        wp.launch(
            kernels.relax, count, [signed, state, turns, *lists, total, reach, _TOLERANCE, second_order]
        )
        lists.reverse()
        count = int(total.numpy()[0])
