"""Meshes on the device, in the optimizer's unit of length.

The unit is one hundredth of the square root of the mean surface area, so that regularization and steps do not
depend on the scale of the shapes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import warp as wp

from homolog.arrays import Array, BoolArray, DeviceArray, FloatArray, IntArray
from homolog.correspondence.kernels.particles import Surface
from homolog.correspondence.types import Shape
from homolog.errors import NumericalError
from homolog.geodesics import GeodesicTable, distances_from
from homolog.geometry import scale_of, transform_points
from homolog.memory import Store, in_memory
from homolog.registration.procrustes import rescale
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.sides import MeshSides, batches
from homolog.surfaces.topology import rim_sides
from homolog.threads import cores, in_threads

__all__ = [
    "Similarity",
    "SurfaceSet",
    "build_surface_set",
    "length_unit",
    "normalize_size",
    "on_device",
]


@dataclass(frozen=True, slots=True)
class Similarity:
    """A similarity from local millimetres to the optimizer's coordinates: x = linear @ local + origin."""

    linear: FloatArray
    origin: FloatArray

    @classmethod
    def of(cls, alignment: FloatArray, unit: float) -> "Similarity":
        """Return the similarity of a local-to-world matrix (4, 4) and the optimizer's unit [mm]."""
        return cls(alignment[:3, :3] / unit, alignment[:3, 3] / unit)

    @property
    def scale(self) -> float:
        """Optimizer lengths per millimetre."""
        return float(scale_of(self.linear))

    def apply(self, points: FloatArray) -> FloatArray:
        """Map local points (..., 3) to the optimizer's coordinates."""
        return points @ self.linear.T + self.origin

    def invert(self, points: FloatArray) -> FloatArray:
        """Map points (..., 3) of the optimizer back to local millimetres."""
        return (points - self.origin) @ np.linalg.inv(self.linear).T


@dataclass(frozen=True, slots=True, eq=False)
class Carriers:
    """The meshes on which the particles of open shapes lie, in the optimizer's coordinates.

    Attributes
    ----------
    surfaces : wp.array of Surface
        One element a shape, with normals; empty for a shape that has a field.
    meshes : list of TriangleMesh or None
        The same on the host.
    references : list of Surface
        Keep the arrays of `surfaces` alive.
    """

    surfaces: DeviceArray
    meshes: list[TriangleMesh | None]
    references: list[Surface]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSet:
    """All shapes at one level of detail.

    Attributes
    ----------
    surfaces : wp.array of Surface
        One element a shape.
    meshes : list of TriangleMesh
        The same meshes on the host, in the optimizer's coordinates.
    carriers : Carriers or None
        Fine meshes on which the particles of open shapes lie; None if all have fields.
    has_rims : bool
        Whether a mesh has rims.
    extent : float
        Largest absolute coordinate.
    sizes : (M,) array
        Square roots of the areas over the mean area; proportional to the spacing of even particles.
    references : list of Surface
        Keep the arrays of `surfaces` alive.
    """

    surfaces: DeviceArray
    meshes: list[TriangleMesh]
    carriers: Carriers | None
    has_rims: bool
    extent: float
    sizes: FloatArray
    references: list[Surface]


def length_unit(shapes: Sequence[Shape]) -> float:
    """Return the optimizer's unit of length [mm of the world frame]."""
    areas = [shape.mesh.area * np.linalg.det(shape.alignment[:3, :3]) ** (2.0 / 3.0) for shape in shapes]
    return 0.01 * float(np.sqrt(np.mean(areas)))


def normalize_size(shapes: Sequence[Shape]) -> list[Shape]:
    """Return the shapes with alignments scaled about their centres, so that all have the same area.

    It is the geometric mean of their areas in the world frame.
    """
    alignments = np.stack([shape.alignment for shape in shapes])
    areas = np.array([shape.mesh.area for shape in shapes])
    scales = scale_of(alignments)
    sizes = scales * np.sqrt(areas)
    centres = np.stack([transform_points(s.alignment, s.mesh.vertices).mean(axis=0) for s in shapes])
    common = np.exp(np.log(sizes).mean())
    grown = rescale(alignments, scales * common / sizes, centres)
    return [replace(shape, alignment=own) for shape, own in zip(shapes, grown, strict=True)]


def build_surface_set(
    meshes: Sequence[TriangleMesh],
    tables: Sequence[GeodesicTable | None],
    to_optimizer: Sequence[Similarity],
    device: str,
    free_shapes: BoolArray | None = None,
    *,
    carriers: Sequence[TriangleMesh | None] = (),
    store: Store = in_memory,
) -> SurfaceSet:
    """Copy meshes and tables of all shapes to the device.

    Tables stay empty for straight distances, and for shapes on which no particle is `free_shapes`.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        One for each shape.
    tables : sequence of GeodesicTable or None
        Of the meshes; None for straight distances.
    to_optimizer : sequence of Similarity
        From the meshes' coordinates to the optimizer's.
    device : str
        Warp device.
    free_shapes : (M,) bool array, optional
        Shapes with free particles; all if not given.
    carriers : sequence of TriangleMesh or None
        Meshes on which the particles of open shapes lie, None for others; empty if there is none.
    store : Store
        Where meshes lie, and copies for a CPU.

    Returns
    -------
    SurfaceSet
    """

    def transformed(pair: tuple[TriangleMesh, Similarity]) -> TriangleMesh:
        mesh = TriangleMesh(pair[1].apply(pair[0].vertices), pair[0].faces)
        mesh.area  # noqa: B018 - is computed here, and kept
        return mesh

    made = in_threads(transformed, zip(meshes, to_optimizer, strict=True), cores())
    transformed_meshes = [
        mesh if store is in_memory else TriangleMesh(store(mesh.vertices), mesh.faces) for mesh in made
    ]
    free = [True] * len(meshes) if free_shapes is None else free_shapes
    references = [
        _surface(*parts, device, store)
        for parts in zip(transformed_meshes, face_neighbours(meshes), tables, to_optimizer, free, strict=True)
    ]
    extent = max(float(np.abs(mesh.vertices).max()) for mesh in transformed_meshes)
    sizes = np.array([surface.size for surface in references])
    return SurfaceSet(
        wp.array(references, dtype=Surface, device=device),
        transformed_meshes,
        _carriers(carriers, to_optimizer, device, store) if any(carriers) else None,
        any(len(surface.rims) > 0 for surface in references if surface.rims is not None),
        extent,
        sizes,
        references,
    )


def _carriers(
    meshes: Sequence[TriangleMesh | None], to_optimizer: Sequence[Similarity], device: str, store: Store
) -> Carriers:
    """Copy the meshes on which particles lie to the device, with normals; nothing for other shapes."""
    references: list[Surface] = []
    placed: list[TriangleMesh | None] = []
    for mesh, similarity in zip(meshes, to_optimizer, strict=True):
        if mesh is None:
            references.append(Surface())
            placed.append(None)
            continue
        (neighbours,) = face_neighbours([mesh])
        placed.append(moved := TriangleMesh(similarity.apply(mesh.vertices), mesh.faces))
        references.append(_surface(moved, neighbours, None, similarity, True, device, store))
        normals = moved.vertex_normals.astype(np.float32)
        references[-1].normals = on_device(normals, wp.vec3, device, store)
    return Carriers(wp.array(references, dtype=Surface, device=device), placed, references)


def _surface(
    mesh: TriangleMesh,
    neighbours: IntArray,
    table: GeodesicTable | None,
    similarity: Similarity,
    is_free: bool,
    device: str,
    store: Store,
) -> Surface:
    surface = Surface()
    surface.fixed = int(not is_free)
    surface.size = 0.01 * math.sqrt(mesh.area)
    surface.vertices = on_device(mesh.vertices.astype(np.float32), wp.vec3, device, store)
    surface.faces = on_device(mesh.faces, wp.vec3i, device, store)
    surface.face_neighbours = on_device(neighbours, wp.vec3i, device, store)
    if (neighbours < 0).any():
        rim = np.unique(rim_sides(mesh.faces)[0])
        surface.rims = on_device(distances_from(mesh, rim.tolist()), wp.float32, device, store)
    if table is not None:
        surface.table = table.on_device(device, similarity.scale)
    return surface


def on_device(array: Array, dtype: type, device: str, store: Store) -> DeviceArray:
    """Return a copy of an array: of a CPU's in a store, else in the device's memory."""
    if store is in_memory or not wp.get_device(device).is_cpu:
        return wp.array(array, dtype=dtype, device=device)
    return wp.array(store(array), dtype=dtype, device=device, copy=False)


def morton_ordered(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with its vertices sorted along a Morton curve.

    Neighbouring vertices are then mostly neighbours in memory, which makes lookups in geodesic tables faster.
    """
    low = mesh.vertices.min(axis=0)
    cells = ((mesh.vertices - low) / np.ptp(mesh.vertices, axis=0).max() * 1023.0).astype(np.int64)
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        cells = (cells | cells << shift) & mask  # two zeros between the bits
    code = cells[:, 0] << 2 | cells[:, 1] << 1 | cells[:, 2]
    order = np.argsort(code, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return TriangleMesh(mesh.vertices[order], rank[mesh.faces])


def face_neighbours(meshes: Sequence[TriangleMesh]) -> Iterator[IntArray]:
    """Yield for each face of each mesh the faces across the edges opposite to its corners; -1 at rims."""
    for batch in batches(len(meshes)):
        sides = MeshSides.of(meshes[batch])
        if not sides.is_paired.all():
            raise NumericalError("a mesh for the optimizer is not consistently oriented")
        across = np.roll(sides.twin.reshape(-1, 3) // 3, -1, axis=1)
        for first, end in pairwise(sides.first_face.tolist()):
            yield np.where(across[first:end] < 0, -1, across[first:end] - np.int32(first))
