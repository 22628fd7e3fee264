"""Particles located on their surfaces: normals there, and geodesic distances between neighbours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import warp as wp
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from homolog.arrays import Array, FloatArray, IntArray, frozen
from homolog.correspondence.kernels.particles import locate
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.surface_sets import Similarity, build_surface_set, morton_ordered, nearest_faces
from homolog.errors import InputError
from homolog.geodesics import distances_from, solve_tables
from homolog.geodesics.kernels.lookup import SurfacePoint
from homolog.geometry import transform_points
from homolog.inspection import kernels
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.closest import on_device
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import longest_edge

__all__ = ["REACH", "LocatedParticles", "closest_points_on", "locate_particles", "mean_normals"]

REACH = 3.0
"""Cutoff of geodesic distances, in mean spacings of the particles."""
_VERTICES = 2.0
"""Vertices per particle of the mesh on which distances are computed."""
_FEWEST_VERTICES = 1500
"""Least number of vertices of that mesh."""
_T = TypeVar("_T")
_MEAN_ROUNDS = 20
_LOST = 1.0
_MOST_OFF = 0.02  # fraction of the particles: a few may be off a mesh that cuts corners of the surface
"""Largest distance of particles on their surface, in mean spacings."""


@dataclass(frozen=True, slots=True, eq=False)
class LocatedParticles:
    """Particles of all subjects with their normals and geodesic distances; arrays are read-only.

    Attributes
    ----------
    meshes : tuple of TriangleMesh
        The subjects' surfaces in the coordinates of their files.
    alignments : (M, 4, 4) float64 array
        Similarities from file to aligned coordinates.
    local, world : (M, N, 3) float64 arrays
        Positions [mm] in the coordinates of the files, and aligned.
    normals : (M, N, 3) float64 array
        Outward unit normals in aligned coordinates.
    faces : (M, N) int array
        The face of the subject's mesh that each particle is on.
    spacing : (M,) float64 array
        Root of a subject's surface area per particle [mm of its file].
    reaches : tuple of (V,) float64 arrays
        Geodesic distance [mm] of every vertex of a mesh from the nearest particle.
    distances : tuple of (N, N) csr_array
        Geodesic distances between the particles of each subject, in its spacings, up to `REACH`; symmetric,
        without the diagonal. Missing pairs are farther apart.
    """

    meshes: tuple[TriangleMesh, ...]
    alignments: FloatArray
    local: FloatArray
    world: FloatArray
    normals: FloatArray
    faces: IntArray
    spacing: FloatArray
    reaches: tuple[FloatArray, ...]
    distances: tuple[csr_array, ...]

    def with_subject(self, index: int, other: "LocatedParticles") -> "LocatedParticles":
        """Return a copy in which one subject is replaced by the single subject of `other`."""

        def put(name: str) -> Array:
            changed: Array = getattr(self, name).copy()
            changed[index] = getattr(other, name)[0]
            return frozen(changed)

        return LocatedParticles(
            meshes=_put(self.meshes, index, other.meshes),
            alignments=put("alignments"),
            local=put("local"),
            world=put("world"),
            normals=put("normals"),
            faces=put("faces"),
            spacing=put("spacing"),
            reaches=_put(self.reaches, index, other.reaches),
            distances=_put(self.distances, index, other.distances),
        )


def _put(whole: tuple[_T, ...], index: int, other: tuple[_T, ...]) -> tuple[_T, ...]:
    return (*whole[:index], other[0], *whole[index + 1 :])


def locate_particles(
    local: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    *,
    names: Sequence[str],
    tick: Tick = no_tick,
) -> LocatedParticles:
    """Find normals and distances of particles.

    Parameters
    ----------
    local : (M, N, 3) array
        Particles [mm] in the coordinates of the files.
    meshes : sequence of TriangleMesh
        The subjects' closed surfaces in the same coordinates.
    alignments : (M, 4, 4) array
        Similarities to aligned coordinates.
    names : sequence of str
        Names of the subjects, for messages.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If particles are not on their subject's surface, or a surface is not closed.
    """
    count = local.shape[1]
    world = transform_points(alignments, local)
    spacing = np.sqrt([mesh.area / count for mesh in meshes])
    normals, faces = np.empty_like(world), np.empty(world.shape[:2], np.int64)
    reaches, distances = [], []
    for m, (points, mesh, name) in enumerate(zip(local, meshes, names, strict=True)):
        part = part_of(tick, m / len(meshes), (m + 1) / len(meshes))
        part(0.0, f"distances between particles of {name}")
        own, faces[m], away = closest_points_on(mesh, points)
        off = ~(away < _LOST * spacing[m])
        if off.mean() > _MOST_OFF:
            raise InputError(
                f"{name}: {np.count_nonzero(off)} particles are not on the surface, "
                "which has changed; run again"
            )
        normals[m] = own @ alignments[m, :3, :3].T
        distances.append(_distances(points, own, mesh, float(spacing[m]), name, part_of(part, 0.0, 0.9)))
        corners = mesh.faces[faces[m]]
        start = np.linalg.norm(mesh.vertices[corners] - points[:, None], axis=2)
        part(0.9, f"coverage of {name}")
        reach = distances_from(mesh, corners.ravel().tolist(), start.ravel().tolist(), name=name)
        reaches.append(frozen(reach, np.float64))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return LocatedParticles(
        tuple(meshes),
        frozen(alignments, np.float64),
        frozen(local, np.float64),
        frozen(world),
        frozen(normals),
        frozen(faces),
        frozen(spacing),
        tuple(reaches),
        tuple(distances),
    )


def closest_points_on(mesh: TriangleMesh, points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return normals (n, 3) and faces (n,) of a mesh at the closest points, and the distances (n,) [mm]."""
    reach = float(np.ptp(np.concatenate([mesh.vertices, points]), axis=0).sum())
    with wp.ScopedDevice("cpu"):
        surface, middle = on_device(mesh)
        own = wp.array(mesh.vertex_normals.astype(np.float32), dtype=wp.vec3)
        located = wp.array((points - middle).astype(np.float32), dtype=wp.vec3)
        normals = wp.zeros(len(points), dtype=wp.vec3)
        faces, away = wp.zeros(len(points), dtype=int), wp.zeros(len(points), dtype=float)
        wp.launch(
            kernels.closest_points_on, len(points), [surface.id, reach, located, own, normals, faces, away]
        )
    return normals.numpy().astype(np.float64), faces.numpy().astype(np.int64), away.numpy().astype(np.float64)


def mean_normals(normals: FloatArray) -> FloatArray:
    """Return the Fréchet mean of unit normals over subjects on the sphere, (M, N, 3) to (N, 3).

    It is the fixed point of the mean of the logarithms (the paper's Eq. 6), starting at the normalized sum.
    """
    mean = normals.sum(axis=0)
    opposed = np.linalg.norm(mean, axis=1) < 1e-6
    mean[opposed] = normals[0][opposed]
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    for _ in range(_MEAN_ROUNDS):
        cosine = np.clip(np.einsum("mni,ni->mn", normals, mean), -1.0 + 1e-9, 1.0)
        factor = 1.0 / np.sinc(np.arccos(cosine) / np.pi)
        logs = factor[:, :, None] * (normals - cosine[:, :, None] * mean)
        step = logs.mean(axis=0)
        angle = np.linalg.norm(step, axis=1, keepdims=True)
        mean = np.cos(angle) * mean + np.sinc(angle / np.pi) * step
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    return np.asarray(mean)


def _distances(
    points: FloatArray, normals: FloatArray, mesh: TriangleMesh, spacing: float, name: str, tick: Tick
) -> csr_array:
    """Geodesic distances between neighbouring particles over their spacing."""
    reach = REACH * spacing
    light = morton_ordered(simplified(mesh, max(_FEWEST_VERTICES, round(_VERTICES * len(points)))))
    far = reach + 2.0 * longest_edge(light)
    (table,) = solve_tables([light], far, device="cpu", names=[name], tick=tick)
    middle = light.vertices.mean(axis=0)
    surface_set = build_surface_set([light], [table], [Similarity(np.eye(3), -middle)], "cpu")
    pairs: IntArray = cKDTree(points).query_pairs(reach, output_type="ndarray")  # straight ≤ geodesic
    with wp.ScopedDevice("cpu"):
        faces = wp.array(nearest_faces(surface_set.meshes[0], points - middle, normals), dtype=int)
        positions = wp.array((points - middle).astype(np.float32), dtype=wp.vec3)
        toward = wp.array(normals.astype(np.float32), dtype=wp.vec3)
        closest = wp.zeros(len(points), dtype=SurfacePoint)
        launch = Launcher("cpu", threads=1)
        launch(locate, len(points), [len(points), surface_set.surfaces, positions, toward, faces, closest])
        ends = wp.array(pairs.astype(np.int32), dtype=wp.vec2i)
        lengths = wp.zeros(len(pairs), dtype=float)
        wp.launch(kernels.pair_distances, len(pairs), [surface_set.surfaces, closest, ends, lengths])
    measured = lengths.numpy().astype(np.float64)
    near = (measured >= 0.0) & (measured <= reach)
    (i, j), d = pairs[near].T, np.maximum(measured[near] / spacing, 1e-3)
    n = len(points)
    rows, columns = np.concatenate([i, j]), np.concatenate([j, i])
    return csr_array((np.concatenate([d, d]), (rows, columns)), shape=(n, n))
