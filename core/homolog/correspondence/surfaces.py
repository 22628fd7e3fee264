"""Shapes brought onto the device, in the optimizer's own unit of length.

The unit is one hundredth of the root of the mean surface area, so that nothing in the optimizer depends
on millimetres: regularisation and steps mean the same at every scale.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from scipy import ndimage
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, DeviceArray, Float32Array, FloatArray, IntArray
from homolog.correspondence.functions import FieldData
from homolog.correspondence.kernels import Surface
from homolog.correspondence.poses import rescaled, scales_of, transformed
from homolog.correspondence.relief import SIZE, opening_grid, openings_at
from homolog.correspondence.types import Shape
from homolog.errors import NumericalError
from homolog.geodesics import GeodesicTable
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "Level",
    "Placement",
    "build_level",
    "field_array",
    "length_unit",
    "nearest_faces",
    "of_one_size",
    "opening_array",
]


@dataclass(frozen=True, slots=True)
class Placement:
    """A similarity from local millimetres to the optimizer's coordinates: x = linear @ local + origin."""

    linear: FloatArray
    origin: FloatArray

    @property
    def scale(self) -> float:
        """Optimizer lengths per millimetre."""
        return float(np.cbrt(np.linalg.det(self.linear)))

    def apply(self, points: FloatArray) -> FloatArray:
        """Map local points (..., 3) to the optimizer's coordinates."""
        return points @ self.linear.T + self.origin

    def invert(self, points: FloatArray) -> FloatArray:
        """Map points (..., 3) of the optimizer back to local millimetres."""
        return (points - self.origin) @ np.linalg.inv(self.linear).T


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """All shapes at one level of detail.

    Attributes
    ----------
    surfaces : wp.array of Surface
        One element a shape.
    meshes : list of TriangleMesh
        The same meshes, in the optimizer's coordinates.
    extent : float
        Largest coordinate.
    sizes : (M,) array
        Roots of the surfaces' areas over that of their mean: even particles lie so much farther apart.
    """

    surfaces: DeviceArray
    meshes: list[TriangleMesh]
    extent: float
    sizes: FloatArray
    keep: list[Surface]


def length_unit(shapes: Sequence[Shape]) -> float:
    """Return the optimizer's unit of length [mm of the world frame]."""
    areas = [shape.mesh.area * np.linalg.det(shape.alignment[:3, :3]) ** (2.0 / 3.0) for shape in shapes]
    return 0.01 * float(np.sqrt(np.mean(areas)))


def of_one_size(shapes: Sequence[Shape]) -> list[Shape]:
    """Return the shapes with alignments that grow each about its middle, so that all have one area.

    It is the geometric mean of their areas in the world frame.
    """
    alignments = np.stack([shape.alignment for shape in shapes])
    areas = np.array([shape.mesh.area for shape in shapes])
    scales = scales_of(alignments)
    sizes = scales * np.sqrt(areas)
    middles = np.stack(
        [transformed(s.alignment[None], s.mesh.vertices[None])[0].mean(axis=0) for s in shapes]
    )
    common = np.exp(np.log(sizes).mean())
    grown = rescaled(alignments, scales * common / sizes, middles)
    return [replace(shape, alignment=own) for shape, own in zip(shapes, grown, strict=True)]


def field_array(
    shapes: Sequence[Shape], placements: Sequence[Placement], device: str, tick: Tick = no_tick
) -> DeviceArray:
    """Bring the distance fields to the device as cubic B-spline coefficients."""
    keep = []
    for index, (shape, placement) in enumerate(zip(shapes, placements, strict=True)):
        tick(index / len(shapes), f"distance field of {shape.name}")
        field = shape.field
        keep.append(_field_data(field.values, field.index_to_world, placement, placement.scale, device))
    return _packed(keep, device)


def opening_array(
    shapes: Sequence[Shape],
    placements: Sequence[Placement],
    weight: float,
    device: str,
    tick: Tick = no_tick,
) -> DeviceArray:
    """Bring the opening angles, as they count, to the device as cubic B-spline coefficients.

    An angle that hardly varies over the surfaces says little about the place: angles count by the weight
    times their standard deviation over a surface [rad]. Without a weight nothing is computed.
    """
    if weight == 0.0:
        return _packed([FieldData() for _ in shapes], device)  # of scale 0: kernels leave them alone
    grids, spreads = [], []
    for index, (shape, placement) in enumerate(zip(shapes, placements, strict=True)):
        tick(index / len(shapes), f"opening angles of {shape.name}")
        grids.append(opening_grid(shape.field, SIZE / placement.scale))
        spreads.append(openings_at(shape.coarse_mesh.vertices, *grids[-1]).std())
    scale = weight * float(np.mean(spreads))
    keep = [
        _field_data(values, grid, placement, scale, device)
        for (values, grid), placement in zip(grids, placements, strict=True)
    ]
    return _packed(keep, device)


def _packed(keep: list[FieldData], device: str) -> DeviceArray:
    fields = wp.array(keep, dtype=FieldData, device=device)
    fields.keep = keep  # an array of structs holds addresses only
    return fields


def _field_data(
    values: Float32Array, index_to_local: FloatArray, placement: Placement, scale: float, device: str
) -> FieldData:
    to_index = np.linalg.inv(placement.linear @ index_to_local[:3, :3])
    origin = -to_index @ placement.apply(index_to_local[:3, 3])
    coefficients = ndimage.spline_filter(values, order=3, output=np.float32, mode="mirror")
    data = FieldData()
    data.coefficients = wp.array(coefficients, dtype=wp.float32, device=device)
    data.to_index = wp.mat33(*to_index.astype(np.float32).ravel().tolist())
    data.origin_index = wp.vec3(*origin.tolist())
    data.scale = scale
    return data


def build_level(
    meshes: Sequence[TriangleMesh],
    tables: Sequence[GeodesicTable | None],
    placements: Sequence[Placement],
    device: str,
    moving: BoolArray | None = None,
) -> Level:
    """Bring meshes and tables of all shapes to the device.

    Tables stay empty for straight distances, and for shapes on which no particle is `moving`.
    """
    placed = [TriangleMesh(f.apply(m.vertices), m.faces) for m, f in zip(meshes, placements, strict=True)]
    keep = [
        _surface(mesh, table, placement, device, free)
        for mesh, table, placement, free in zip(
            placed, tables, placements, [True] * len(placed) if moving is None else moving, strict=True
        )
    ]
    extent = max(float(np.abs(mesh.vertices).max()) for mesh in placed)
    sizes = np.array([one.size for one in keep])
    return Level(wp.array(keep, dtype=Surface, device=device), placed, extent, sizes, keep)


def _surface(
    mesh: TriangleMesh, table: GeodesicTable | None, placement: Placement, device: str, moving: bool
) -> Surface:
    surface = Surface()
    surface.held = int(not moving)
    surface.size = 0.01 * math.sqrt(mesh.area)
    surface.vertices = wp.array(mesh.vertices.astype(np.float32), dtype=wp.vec3, device=device)
    surface.faces = wp.array(mesh.faces, dtype=wp.vec3i, device=device)
    surface.face_neighbors = wp.array(face_neighbors(mesh.faces), dtype=wp.vec3i, device=device)
    if table is not None:
        surface.table = table.on_device(device, placement.scale)
    return surface


def ordered(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with its vertices along a space-filling (Morton) curve.

    Corners of one triangle, and vertices near each other, then lie near each other in memory: lookups in a
    dense geodesic table take a fifth of the time.
    """
    low = mesh.vertices.min(axis=0)
    cells = ((mesh.vertices - low) / np.ptp(mesh.vertices, axis=0).max() * 1023.0).astype(np.int64)
    code = sum(((cells >> bit) & 1) << (3 * bit + 2 - np.arange(3)) for bit in range(10)).sum(axis=1)
    order = np.argsort(code, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return TriangleMesh(mesh.vertices[order], rank[mesh.faces])


def face_neighbors(faces: IntArray) -> IntArray:
    """Return for each face the three faces across the edges opposite to its corners, shape (F, 3)."""
    n = int(faces.max()) + 1
    start = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    stop = np.roll(faces, -2, axis=1).ravel().astype(np.int64)
    forward = start * n + stop
    order = np.argsort(forward)
    backward = stop * n + start
    place = order[np.minimum(np.searchsorted(forward[order], backward), len(order) - 1)]
    if not np.array_equal(forward[place], backward):
        raise NumericalError("a mesh for the optimizer is not closed and consistently oriented")
    return (place // 3).reshape(-1, 3).astype(np.int32)


def nearest_faces(mesh: TriangleMesh, points: FloatArray, normals: FloatArray) -> IntArray:
    """Return a face near each point whose normal agrees, where a walk can start; shape (n,)."""
    corners = mesh.vertices[mesh.faces]
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face_normals /= np.maximum(np.linalg.norm(face_normals, axis=1, keepdims=True), 1e-30)
    candidates = np.asarray(cKDTree(corners.mean(axis=1)).query(points, k=min(24, len(corners)))[1])
    agree = np.einsum("nkd,nd->nk", face_normals[candidates], normals) > 0.2
    first = np.where(agree.any(axis=1), agree.argmax(axis=1), 0)
    nearest: IntArray = candidates[np.arange(len(points)), first].astype(np.int32)
    return nearest
