"""Opening angles and B-spline coefficients of many shapes, computed on a GPU.

The shapes of a batch are computed side by side, as the lines of one grid are too few threads.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, FloatArray
from homolog.correspondence.entropy.opening_angles import MARGIN_NODES, OpeningGrid
from homolog.correspondence.kernels import fields as kernels
from homolog.surfaces.distance_field import DistanceField

__all__ = ["angles_and_coefficients", "coefficients_on"]

TOGETHER = 32
"""Shapes in a batch."""


def coefficients_on(device: str, fields: Sequence[DistanceField]) -> Iterator[DeviceArray]:
    """Yield the coefficients of each distance field.

    Parameters
    ----------
    device : str
        Warp device.
    fields : sequence of DistanceField

    Yields
    ------
    (I, J, K) float32 wp.array
    """
    for first in range(0, len(fields), TOGETHER):
        volumes = []
        for field in fields[first : first + TOGETHER]:
            volume = _volume(device, field.values.shape)
            volume.grid = wp.array(field.values, dtype=wp.float32, device=device).flatten()
            volumes.append(volume)
        _filter(device, volumes)
        yield from (_grid_of(volume) for volume in volumes)


def angles_and_coefficients(
    device: str, fields: Sequence[DistanceField], sizes: Sequence[float], points: Sequence[FloatArray]
) -> Iterator[tuple[FloatArray, DeviceArray, FloatArray]]:
    """Yield opening angles of each shape (see `homolog.correspondence.entropy.opening_angles`).

    Parameters
    ----------
    device : str
        Warp device.
    fields : sequence of DistanceField
    sizes : sequence of float
        Standard deviation of the ball [mm].
    points : sequence of (n, 3) array
        Of the shape, in the field's coordinates [mm].

    Yields
    ------
    angles : (n,) array
        At the points [rad].
    coefficients : (I, J, K) float32 wp.array
        Of the angles on a grid.
    index_to_local : (4, 4) array
        Affine from the grid's indices to the field's coordinates.
    """
    shapes = list(zip(fields, sizes, points, strict=True))
    for first in range(0, len(shapes), TOGETHER):
        batch = shapes[first : first + TOGETHER]
        grids = [OpeningGrid.of(field, size) for field, size, _ in batch]
        volumes = []
        for (field, _, own), grid in zip(batch, grids, strict=True):
            volume = _volume(device, grid.shape)
            volume.grid, volume.spare = (_empty(device, grid.shape, wp.float32) for _ in range(2))
            volume.field = wp.array(field.values, dtype=wp.float32, device=device)
            volume.spacing, volume.block, volume.margin = field.spacing, grid.block, MARGIN_NODES
            volume.weights = wp.array(_half_gaussian(grid.width), dtype=wp.float64, device=device)
            volume.nodes = wp.array(grid.nodes(own).T, dtype=wp.vec3d, device=device)
            volume.angles = wp.empty(len(own), dtype=wp.float64, device=device)
            volumes.append(volume)
        packed = _pack(device, volumes)
        _launch(kernels.fill_inside, packed, _largest(volumes), device)
        for axis, back in enumerate((0, 1, 0)):
            _launch(kernels.blur, packed, _largest(volumes), device, axis, back)
        _launch(kernels.turn_to_angles, packed, _largest(volumes), device)
        _launch(kernels.sample_angles, packed, max(len(own) for _, _, own in batch), device)
        angles = [volume.angles.numpy() for volume in volumes]
        _filter(device, volumes)
        affines = [grid.index_to_local for grid in grids]
        yield from zip(angles, (_grid_of(volume) for volume in volumes), affines, strict=True)


def _volume(device: str, shape: tuple[int, ...]) -> Any:  # noqa: ANN401 - a wp.struct has no type
    volume = kernels.Volume()
    volume.size = wp.vec3i(*shape)
    volume.lines = _empty(device, shape, wp.float64)
    return volume


def _empty(device: str, shape: tuple[int, ...], dtype: type) -> DeviceArray:
    return wp.empty(int(np.prod(shape)), dtype=dtype, device=device)


def _half_gaussian(width: float) -> FloatArray:
    """Return the weights of `scipy.ndimage.gaussian_filter`, from the middle to one side."""
    places = np.arange(int(MARGIN_NODES * width + 0.5) + 1)
    weights = np.exp(-0.5 / width**2 * places**2)
    result: FloatArray = weights / (weights[0] + 2.0 * weights[1:].sum())
    return result


def _filter(device: str, volumes: Sequence[Any]) -> None:
    packed = _pack(device, volumes)
    sizes = np.array([list(volume.size) for volume in volumes])
    for axis in range(3):
        lines = int((sizes.prod(axis=1) // sizes[:, axis]).max())
        _launch(kernels.filter_lines, packed, lines, device, axis)


def _pack(device: str, volumes: Sequence[Any]) -> DeviceArray:
    return wp.array(volumes, dtype=kernels.Volume, device=device)


def _largest(volumes: Sequence[Any]) -> int:
    return max(int(volume.grid.size) for volume in volumes)


def _launch(kernel: Any, packed: DeviceArray, count: int, device: str, *given: Any) -> None:  # noqa: ANN401
    wp.launch(kernel, dim=(packed.size, count), inputs=[*given, packed], device=device)


def _grid_of(volume: Any) -> DeviceArray:  # noqa: ANN401
    return volume.grid.reshape(tuple(volume.size))
