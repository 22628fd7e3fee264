"""Particles located on their surfaces: normals there, and geodesic distances between neighbours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.cluster import SubjectWorkers
from homolog.correspondence.kernels.particles import locate
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.surface_sets import (
    Similarity,
    SurfaceSet,
    build_surface_set,
    morton_ordered,
)
from homolog.errors import InputError
from homolog.geodesics import distances_from, solve_tables
from homolog.geodesics.kernels.lookup import SurfacePoint
from homolog.geometry import transform_points
from homolog.inspection import kernels
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.closest import closest_faces
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import nearest_faces
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import longest_edge

__all__ = ["FAR", "REACH", "LocatedParticles", "closest_points_on", "locate_particles", "mean_normals"]

REACH = 3.0
"""Cutoff of geodesic distances, in mean spacings of the particles."""
FAR = 1.4
"""Least distance of an uncovered point from the nearest particle, in spacings; even layouts have at most
0.6."""
_HALF_EDGE = 0.6
"""Bound of the distance of a surface point from the nearest vertex of the coarse mesh, in its mean edges."""
_VERTICES = 2.0
"""Vertices per particle of the coarse mesh on which distances are computed."""
_FEWEST_VERTICES = 700
"""Least number of vertices of that mesh."""
_NEAREST = 12
"""Number of particles, the nearest by straight distance, to which distances of a vertex are computed."""
_LEAST = 32
"""Fewest subjects for which a further process pays: its start takes as long as twenty subjects with 256
particles."""
_CHUNK = 8
"""Number of subjects that a process receives at a time."""
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
    coarse_reaches : tuple of float64 arrays
        Geodesic distance [mm] of every vertex of a coarse mesh from the nearest particle; inf beyond `REACH`.
    reaches : tuple of (V,) float64 arrays
        The same of every vertex of the subject's mesh; empty if the coarse mesh shows that none is `FAR`.
    distances : tuple of (N, N) csr_array
        Geodesic distances between the particles of each subject, in its spacings, up to `REACH`; symmetric,
        without the diagonal. Missing pairs are farther apart, or nearly as far if they lie in the largest
        triangles of the coarse mesh.
    """

    meshes: tuple[TriangleMesh, ...]
    alignments: FloatArray
    local: FloatArray
    world: FloatArray
    normals: FloatArray
    faces: IntArray
    spacing: FloatArray
    coarse_reaches: tuple[FloatArray, ...]
    reaches: tuple[FloatArray, ...]
    distances: tuple[csr_array, ...]

    def with_subject(self, index: int, other: "LocatedParticles") -> "LocatedParticles":
        """Return a copy in which one subject is replaced by the single subject of `other`."""
        changed: dict[str, Any] = {}
        for name in self.__dataclass_fields__:
            parts = list(getattr(self, name))
            parts[index] = getattr(other, name)[0]
            changed[name] = (
                frozen(np.stack(parts)) if isinstance(getattr(self, name), np.ndarray) else tuple(parts)
            )
        return LocatedParticles(**changed)


def locate_particles(
    local: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    *,
    names: Sequence[str],
    workers: int = 1,
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
    workers : int
        Largest number of processes. Fewer, or only this one, are used for cohorts for which they do not pay;
        the result does not depend on it.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If particles are not on their subject's surface, or a surface is not closed.
    NumericalError
        If processes die repeatedly.
    """
    count = local.shape[1]
    world = transform_points(alignments, local)
    spacing = np.sqrt([mesh.area / count for mesh in meshes])
    subjects = [
        _Subject(points, mesh, float(own), name)
        for points, mesh, own, name in zip(local, meshes, spacing, names, strict=True)
    ]
    processes = min(workers, len(subjects) // _LEAST)
    located = _located_chunk(subjects, tick) if processes < 2 else _in_processes(subjects, processes, tick)
    normals = np.stack([item.normals for item in located]) @ alignments[:, :3, :3].swapaxes(1, 2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return LocatedParticles(
        tuple(meshes),
        frozen(alignments, np.float64),
        frozen(local, np.float64),
        frozen(world),
        frozen(normals),
        frozen(np.stack([item.faces for item in located])),
        frozen(spacing),
        tuple(item.coarse_reach for item in located),
        tuple(item.reach for item in located),
        tuple(item.distances for item in located),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Subject:
    """Particles, surface, spacing and name of one subject."""

    points: FloatArray
    mesh: TriangleMesh
    spacing: float
    name: str


@dataclass(frozen=True, slots=True, eq=False)
class _Located:
    """Particles of one subject; see `LocatedParticles`."""

    normals: FloatArray  # in the coordinates of the file
    faces: IntArray
    coarse_reach: FloatArray
    reach: FloatArray
    distances: csr_array


def _in_processes(subjects: Sequence[_Subject], processes: int, tick: Tick) -> list[_Located]:
    """Locate the particles of many subjects, a chunk at a time in each process."""
    chunks = {str(first + 1): subjects[first : first + _CHUNK] for first in range(0, len(subjects), _CHUNK)}
    with SubjectWorkers(processes) as workers:
        located = dict(workers.each(_located_chunk, chunks, "distances between particles of subject", tick))
    return [item for first in chunks for item in located[first]]


def _located_chunk(subjects: Sequence[_Subject], tick: Tick = no_tick) -> list[_Located]:
    located = []
    for m, subject in enumerate(subjects):
        part = part_of(tick, m / len(subjects), (m + 1) / len(subjects))
        part(0.0, f"distances between particles of {subject.name}")
        located.append(_locate(subject.points, subject.mesh, subject.spacing, subject.name, part))
    return located


def _locate(points: FloatArray, mesh: TriangleMesh, spacing: float, name: str, tick: Tick) -> _Located:
    normals, faces, away = closest_points_on(mesh, points)
    off = ~(away < _LOST * spacing)
    if off.mean() > _MOST_OFF:
        raise InputError(
            f"{name}: {np.count_nonzero(off)} particles are not on the surface, which has changed; run again"
        )
    distances, coarse = _distances(points, normals, mesh, spacing, name, part_of(tick, 0.0, 0.9))
    reach = np.empty(0)
    edge = np.sqrt(len(points) / len(coarse))  # about the mean one of the coarse mesh, in spacings
    if coarse.max() > (FAR - _HALF_EDGE * edge) * spacing:
        corners = mesh.faces[faces]
        start = np.linalg.norm(mesh.vertices[corners] - points[:, None], axis=2)
        reach = np.asarray(
            distances_from(mesh, corners.ravel().tolist(), start.ravel().tolist(), name=name), np.float64
        )
    return _Located(normals, faces, frozen(coarse), frozen(reach), distances)


def closest_points_on(mesh: TriangleMesh, points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return normals (n, 3) and faces (n,) of a mesh at the closest points, and the distances (n,) [mm]."""
    faces, weights = closest_faces(mesh, points)
    corners = mesh.faces[faces]
    normals = np.einsum("nk,nki->ni", weights, mesh.vertex_normals[corners])
    away = points - np.einsum("nk,nki->ni", weights, mesh.vertices[corners])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return normals, faces, np.linalg.norm(away, axis=1)


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
) -> tuple[csr_array, FloatArray]:
    """Geodesic distances between neighbouring particles over their spacing, and coverage of a coarse mesh."""
    reach, n = REACH * spacing, len(points)
    light = morton_ordered(simplified(mesh, max(_FEWEST_VERTICES, round(_VERTICES * n))))
    far = reach + longest_edge(light)
    (table,) = solve_tables([light], far, device="cpu", names=[name], tick=tick, threads=1)
    middle = light.vertices.mean(axis=0)
    surface_set = build_surface_set([light], [table], [Similarity(np.eye(3), -middle)], "cpu")
    tree = cKDTree(points)
    pairs: IntArray = tree.query_pairs(reach, output_type="ndarray")  # straight ≤ geodesic
    near = np.asarray(tree.query(light.vertices, k=min(_NEAREST, n))[1]).reshape(len(light.vertices), -1)
    vertices = np.broadcast_to(n + np.arange(len(near))[:, None], near.shape)
    ends = np.concatenate([pairs, np.stack([near, vertices], axis=-1).reshape(-1, 2)])
    lengths = _lengths(surface_set, points - middle, normals, ends)

    own = lengths[: len(pairs)]
    is_near = (own >= 0.0) & (own <= reach)
    (i, j), d = pairs[is_near].T, np.maximum(own[is_near] / spacing, 1e-3)
    rows, columns = np.concatenate([i, j]), np.concatenate([j, i])
    distances = csr_array((np.concatenate([d, d]), (rows, columns)), shape=(n, n))
    away = lengths[len(pairs) :].reshape(near.shape)
    return distances, np.where(away >= 0.0, away, np.inf).min(axis=1)


def _lengths(surface_set: SurfaceSet, points: FloatArray, normals: FloatArray, ends: IntArray) -> FloatArray:
    """Return the distances [mm] between pairs of points; numbers from N on are the mesh's vertices."""
    mesh = surface_set.meshes[0]
    face_of = np.empty(len(mesh.vertices), np.int64)
    face_of[mesh.faces] = np.arange(len(mesh.faces))[:, None]
    faces = np.concatenate([nearest_faces(mesh, points, normals), face_of])
    places = np.concatenate([points, mesh.vertices])
    toward = np.concatenate([normals, mesh.vertex_normals])
    closest = wp.zeros(len(places), dtype=SurfacePoint, device="cpu")
    inputs = [
        wp.array(places.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(toward.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(faces.astype(np.int32), dtype=int, device="cpu"),
        closest,
    ]
    launch = Launcher("cpu", threads=1)
    launch(locate, len(places), [len(places), surface_set.surfaces, *inputs])
    pairs = wp.array(ends.astype(np.int32), dtype=wp.vec2i, device="cpu")
    lengths = wp.zeros(len(ends), dtype=float, device="cpu")
    wp.launch(
        kernels.pair_distances, len(ends), [surface_set.surfaces, closest, pairs, lengths], device="cpu"
    )
    measured: FloatArray = lengths.numpy().astype(np.float64)
    return measured
