"""Surfaces that follow particles: a subject's mesh is warped to the mean, and from there to any other shape.

The warp is a thin-plate spline (`homolog.statistics.thin_plate`), smoothed locally where it would fold faces.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.thin_plate import (
    MOST_CENTRES,
    evaluate_spline,
    farthest_points,
    spline_weights,
    warp_displacements,
)

__all__ = ["MeanSurface", "mean_surface", "medoid", "warp_surface"]

Parts = Sequence[tuple[slice, slice]]
"""Particles and vertices of each of several structures."""

ROUNDS = 16
"""Largest number of rounds in which the spline is smoothed at folded faces."""

_FIRST_SMOOTHING = 0.1
"""First smoothing of a centre near a folded face, in mean distances of neighbouring centres; doubled in
each round."""

_NEAR = 3
"""Number of centres smoothed for each folded face."""

_AROUND = 4.0
"""Distance from folded faces within which faces are checked again in each round, in mean distances of
neighbouring centres."""


@dataclass(frozen=True, slots=True, eq=False)
class MeanSurface:
    """A mesh that follows any particle configuration of its shape model. Arrays are read-only.

    Attributes
    ----------
    vertices : (V, 3) array
        The mean surface [mm].
    faces : (F, 3) int array
        Faces of the template mesh.
    smoothing : (N,) array
        Smoothing of the spline at each particle [mm]: 0 (interpolation) except near faces that would
        otherwise fold; see `warp_surface`.
    folded : int
        Number of faces of the mean that remain folded: 0 unless correspondences cross each other.
    moved : (K, V, 3) array or None
        Displacements of the vertices [mm], as by `warp_surface`, for the moves that `mean_surface` was given;
        None if there were none, or some fold faces.
    parts : tuple of pairs of slices
        Particles and vertices of each of several structures; empty for a single one.
    """

    vertices: FloatArray
    faces: IntArray
    smoothing: FloatArray
    folded: int
    moved: FloatArray | None = None
    parts: Parts = ()

    @classmethod
    def joined(cls, surfaces: Sequence["MeanSurface"]) -> "MeanSurface":
        """Return the surfaces of several structures as one of separate pieces."""
        moves = [item.moved for item in surfaces if item.moved is not None]
        ends = np.cumsum([[len(item.smoothing), len(item.vertices)] for item in surfaces], axis=0).tolist()
        begins = [[0, 0], *ends[:-1]]
        return cls(
            np.concatenate([item.vertices for item in surfaces]),
            np.concatenate([item.faces + first for item, (_, first) in zip(surfaces, begins, strict=True)]),
            np.concatenate([item.smoothing for item in surfaces]),
            sum(item.folded for item in surfaces),
            np.concatenate(moves, axis=1) if len(moves) == len(surfaces) else None,
            tuple((slice(a, b), slice(c, d)) for (a, c), (b, d) in zip(begins, ends, strict=True)),
        )

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("vertices", "faces", "smoothing"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.moved is not None:
            object.__setattr__(self, "moved", frozen(self.moved))

    @property
    def smoothed(self) -> int:
        """Number of particles at which the spline does not interpolate."""
        return int(np.count_nonzero(self.smoothing))


def mean_surface(
    mean: FloatArray,
    particles: FloatArray,
    vertices: FloatArray,
    faces: IntArray,
    *,
    moves: FloatArray | None = None,
    tick: Tick = no_tick,
) -> MeanSurface:
    """Warp one subject's mesh to the mean shape, without folds, and prepare it for any other shape.

    Parameters
    ----------
    mean : (N, 3) array
        Mean particles [mm].
    particles : (N, 3) array
        The subject's particles [mm], preferably those of the `medoid`.
    vertices : (V, 3) array
        The subject's mesh in the same frame as its particles [mm].
    faces : (F, 3) int array
        Its faces, counter-clockwise seen from outside.
    moves : (K, N, 3) array, optional
        Displacements of the mean particles that should fold no face in either direction, such as modes [mm].
    tick : Tick

    Returns
    -------
    MeanSurface

    Raises
    ------
    NumericalError
        If particles coincide or lie in one plane.
    """
    chosen = farthest_points(mean, MOST_CENTRES)
    start, centres = particles[chosen], mean[chosen]
    none = np.zeros(len(chosen))
    warp = (centres - start)[None]
    near, folded, _ = _unfolded(start, vertices, faces, warp, none, part_of(tick, 0.0, 0.5))
    warped = vertices + warp_displacements(start, vertices, warp, near)[0]
    moved = None
    if moves is not None and len(moves):
        both = np.concatenate([moves, -moves])[:, chosen]
        near, _, of_both = _unfolded(centres, warped, faces, both, near, part_of(tick, 0.5, 1.0))
        moved = None if of_both is None else of_both[: len(moves)]
    smoothing = np.zeros(len(mean))
    smoothing[chosen] = near
    return MeanSurface(warped, faces, smoothing, folded, moved)


def warp_surface(
    mean: FloatArray,
    vertices: FloatArray,
    displacements: FloatArray,
    smoothing: FloatArray,
    parts: Parts = (),
) -> FloatArray:
    """Return the displacements of the mean surface's vertices for displacements of the mean particles.

    Parameters
    ----------
    mean : (N, 3) array
        Mean particles [mm].
    vertices : (V, 3) array
        The mean surface [mm].
    displacements : (K, N, 3) array
        K displacements of the mean particles, such as modes [mm].
    smoothing : (N,) array
        Smoothing of the `MeanSurface` [mm].
    parts : sequence of pairs of slices
        Particles and vertices of each of several structures, which move by themselves.

    Returns
    -------
    (K, V, 3) array
        Displacements of the vertices [mm].

    Raises
    ------
    NumericalError
        If particles coincide or lie in one plane.
    """
    if parts:
        moved = [
            warp_surface(mean[own], vertices[near], displacements[:, own], smoothing[own])
            for own, near in parts
        ]
        return np.concatenate(moved, axis=1)
    centres = farthest_points(mean, MOST_CENTRES)
    return warp_displacements(mean[centres], vertices, displacements[:, centres], smoothing[centres])


def medoid(particles: FloatArray, mean: FloatArray) -> int:
    """Return the index of the subject whose particles are nearest to the mean, in the least-squares sense."""
    return int(np.square(particles - mean).sum(axis=(1, 2)).argmin())


def _unfolded(
    centres: FloatArray,
    vertices: FloatArray,
    faces: IntArray,
    moves: FloatArray,
    smoothing: FloatArray,
    tick: Tick,
) -> tuple[FloatArray, int, FloatArray | None]:
    """Smooth the spline until no move (K, n, 3) of its centres folds a face.

    Returns the smoothing, the number of faces that remain folded, and if that is 0 the displacements of the
    vertices (K, V, 3).
    """
    tree, spacing = KDTree(centres), _mean_spacing(centres)
    columns = moves.transpose(1, 0, 2).reshape(len(centres), -1)
    middles, smoothing = vertices[faces].mean(axis=1), smoothing.copy()
    everywhere = checked = np.arange(len(faces))
    for attempt in range(ROUNDS):
        now = part_of(tick, attempt / ROUNDS, (attempt + 1) / ROUNDS)
        weights = spline_weights(centres, columns, smoothing)
        turned, moved = _folded(centres, vertices, faces[checked], weights, now)
        folded = checked[turned]
        if len(folded):
            _, near = tree.query(middles[folded], k=range(1, min(_NEAR, len(centres)) + 1))
            touched = np.unique(near)
            smoothing[touched] = np.maximum(2.0 * smoothing[touched], _FIRST_SMOOTHING * spacing)
            apart, _ = KDTree(middles[folded]).query(middles, distance_upper_bound=_AROUND * spacing)
            checked = np.flatnonzero(np.isfinite(apart))  # others are checked at the end
        elif len(checked) == len(faces):
            return smoothing, 0, moved if moved.shape[1] == len(vertices) else None
        else:
            checked = everywhere
    return smoothing, len(folded), None


def _folded(
    centres: FloatArray, vertices: FloatArray, faces: IntArray, weights: FloatArray, tick: Tick
) -> tuple[BoolArray, FloatArray]:
    """Return whether any move turns a face inside out, and the displacements of the vertices in use."""
    used, corners = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], corners.reshape(faces.shape)
    moved = _by_move(evaluate_spline(centres, vertices, weights, part_of(tick, 0.0, 0.2)))
    middles = vertices[faces].mean(axis=1)
    normals = _across(vertices, faces)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    step = 1e-3 * np.sqrt(lengths.mean()) * normals / lengths
    above = evaluate_spline(centres, middles + step, weights, part_of(tick, 0.2, 0.6))
    above -= evaluate_spline(centres, middles, weights, part_of(tick, 0.6, 1.0))
    folded = np.zeros(len(faces), dtype=bool)
    for outward, move in zip(step + _by_move(above), moved, strict=True):
        folded |= np.einsum("fi,fi->f", outward, _across(vertices + move, faces)) <= 0.0
    return folded, moved


def _by_move(columns: FloatArray) -> FloatArray:
    """Convert three columns per move (P, 3 K) to moves (K, P, 3)."""
    return columns.reshape(len(columns), -1, 3).transpose(1, 0, 2)


def _across(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return normals of the faces, whose length is twice the area."""
    corners = vertices[faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _mean_spacing(points: FloatArray) -> float:
    """Mean distance of each point to its nearest other [mm]."""
    distances, _ = KDTree(points).query(points, k=[2])
    return float(np.mean(distances))
