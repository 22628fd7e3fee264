"""Distance fields and opening angles on the device, as cubic B-spline coefficients."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from scipy import ndimage

from homolog.arrays import DeviceArray, Float32Array, FloatArray
from homolog.correspondence.device_fields import angles_and_coefficients, coefficients_on
from homolog.correspondence.entropy.opening_angles import BALL_SIZE, opening_grid, openings_at
from homolog.correspondence.kernels.functions import FieldData
from homolog.correspondence.surface_sets import Similarity, on_device
from homolog.correspondence.types import Shape
from homolog.memory import Store, in_memory
from homolog.progress import Tick, no_tick
from homolog.surfaces.distance_field import DistanceField
from homolog.threads import cores, in_threads

__all__ = ["field_array", "opening_array", "opening_scale"]


def field_array(
    shapes: Sequence[Shape],
    to_optimizer: Sequence[Similarity],
    device: str,
    tick: Tick = no_tick,
    *,
    store: Store = in_memory,
) -> DeviceArray:
    """Copy the distance fields to the device as cubic B-spline coefficients; nothing for open shapes.

    Parameters
    ----------
    shapes : sequence of Shape
        Whose fields are copied.
    to_optimizer : sequence of Similarity
        From their coordinates to the optimizer's.
    device : str
        Warp device.
    tick : Tick
        Progress and cancellation.
    store : Store
        Where those of a CPU lie.

    Returns
    -------
    array of fields on the device
    """
    solid = _fields(shapes)
    made = iter(
        in_threads(_coefficients, (field.values for field in solid), cores())
        if wp.get_device(device).is_cpu
        else coefficients_on(device, solid)
    )
    references = []
    for index, (shape, similarity) in enumerate(zip(shapes, to_optimizer, strict=True)):
        tick(index / len(shapes), f"distance field of {shape.name}")
        if shape.field is None:
            references.append(FieldData())  # kernels skip fields of scale 0
            continue
        grid = shape.field.index_to_world
        references.append(_field_data(next(made), grid, similarity, similarity.scale, device, store))
    return _pack(references, device)


def opening_array(
    shapes: Sequence[Shape],
    to_optimizer: Sequence[Similarity],
    weight: float,
    device: str,
    tick: Tick = no_tick,
    *,
    scale: float | None = None,
    store: Store = in_memory,
) -> DeviceArray:
    """Copy the weighted opening angles to the device as cubic B-spline coefficients.

    Angles are multiplied by the weight and by their standard deviation over a surface [rad], since angles
    that hardly vary contain little information; or by `scale`, if it is given. Nothing is computed if the
    weight is 0, or a shape is open: the angle is that of a solid.

    Parameters
    ----------
    shapes, to_optimizer, device, tick, store
        As in `field_array`.
    weight : float
        Of opening angles relative to normals.
    scale : float, optional
        Weight times standard deviation, of another cohort.

    Returns
    -------
    array of fields on the device
    """
    if weight == 0.0 or not _are_solid(shapes):
        return _pack([FieldData() for _ in shapes], device)  # kernels skip fields of scale 0
    openings = list(_openings(shapes, to_optimizer, device, tick, store))
    scale = weight * float(np.mean([item.spread for item in openings])) if scale is None else scale
    references = [
        _field_data(item.coefficients, item.grid, similarity, scale, device, store)
        for item, similarity in zip(openings, to_optimizer, strict=True)
    ]
    return _pack(references, device)


def _are_solid(shapes: Sequence[Shape]) -> bool:
    return all(shape.field is not None for shape in shapes)


def _fields(shapes: Sequence[Shape]) -> list[DistanceField]:
    """Return the fields of solid shapes."""
    return [shape.field for shape in shapes if shape.field is not None]


@dataclass(frozen=True, slots=True, eq=False)
class _Openings:
    """Opening angles of a shape as B-spline coefficients, their grid, and their deviation on the surface."""

    coefficients: Any  # on the host or on a GPU
    grid: FloatArray
    spread: float


def _openings(
    shapes: Sequence[Shape],
    to_optimizer: Sequence[Similarity],
    device: str,
    tick: Tick,
    store: Store = in_memory,
) -> Iterator[_Openings]:
    def prepared(item: tuple[Shape, DistanceField, Similarity]) -> _Openings:
        shape, field, similarity = item
        values, grid = opening_grid(field, BALL_SIZE / similarity.scale)
        spread = float(openings_at(shape.coarse_mesh.vertices, values, grid).std())
        return _Openings(_coefficients(values), grid.index_to_local, spread)

    on_gpu = not wp.get_device(device).is_cpu
    made: Iterator[_Openings]
    if on_gpu:
        sizes = [BALL_SIZE / similarity.scale for similarity in to_optimizer]
        points = [shape.coarse_mesh.vertices for shape in shapes]
        given = angles_and_coefficients(device, _fields(shapes), sizes, points)
        made = (_Openings(both, grid, float(angles.std())) for angles, both, grid in given)
    else:
        made = in_threads(prepared, zip(shapes, _fields(shapes), to_optimizer, strict=True), cores())
    for index, (shape, item) in enumerate(zip(shapes, made, strict=True)):
        tick(index / len(shapes), f"opening angles of {shape.name}")
        yield item if on_gpu else replace(item, coefficients=store(item.coefficients))


def opening_scale(
    shapes: Sequence[Shape],
    to_optimizer: Sequence[Similarity],
    weight: float,
    tick: Tick = no_tick,
    *,
    device: str = "cpu",
) -> float:
    """Return the factor of opening angles in `opening_array`; 0 if a shape is open."""
    if not _are_solid(shapes):
        return 0.0
    spreads = [item.spread for item in _openings(shapes, to_optimizer, device, tick)]
    return weight * float(np.mean(spreads))


def _pack(references: list[FieldData], device: str) -> DeviceArray:
    fields = wp.array(references, dtype=FieldData, device=device)
    fields.references = references  # an array of structs holds addresses only
    return fields


def _coefficients(values: Float32Array) -> Float32Array:
    coefficients: Float32Array = ndimage.spline_filter(values, order=3, output=np.float32, mode="mirror")
    return coefficients


def _field_data(
    coefficients: Any,  # noqa: ANN401 - on the host or on the device
    index_to_local: FloatArray,
    similarity: Similarity,
    scale: float,
    device: str,
    store: Store,
) -> FieldData:
    to_index = np.linalg.inv(similarity.linear @ index_to_local[:3, :3])
    origin = -to_index @ similarity.apply(index_to_local[:3, 3])
    data = FieldData()
    if isinstance(coefficients, np.ndarray):
        coefficients = on_device(coefficients, wp.float32, device, store)
    data.coefficients = coefficients
    data.to_index = wp.mat33(*to_index.astype(np.float32).ravel().tolist())
    data.origin_index = wp.vec3(*origin.tolist())
    data.scale = scale
    return data
