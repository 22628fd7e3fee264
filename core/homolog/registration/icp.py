"""Registration of two surfaces: similarities by iterative closest points from many starts."""

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import (
    farthest_point_sampling,
    inverse_matrices,
    rotation_of,
    scale_of,
    transform_points,
)
from homolog.registration.closest_points import (
    NORMAL_WEIGHT,
    Fit,
    OrientedPoints,
    SearchedPoints,
    iterated,
    iterated_each,
    robust_weights,
)
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints
from homolog.surfaces.orientation import softness

__all__ = [
    "ANOTHER",
    "Bending",
    "Fit",
    "OrientedPoints",
    "axes_rotation",
    "candidates",
    "gap",
    "oriented_points",
    "refined",
    "refined_each",
    "refitted",
    "registered",
    "softness_of_fit",
    "sought",
]

_SCREENING_POINTS, _TRIAL_POINTS, _FIT_POINTS = 100, 300, 1000  # of each surface
_SCREENING_ROUNDS, _TRIAL_ROUNDS, _ROUNDS = 3, 10, 40
_CLEARLY = 2.0  # times as far are surfaces in the given orientation if another one replaces it
_MAX_CANDIDATES = 6  # orientations that are tried
ANOTHER = 30.0
"""Smallest rotation that counts as another orientation [degrees]."""
_GAUSSIANS, _WIDTH = 40, 0.7  # number of Gaussians that bend a surface; their width relative to the size
_STIFFNESSES = np.geomspace(0.1, 0.003, 10).tolist()  # of successive rounds
_LINEAR_STIFFNESS = 0.01


def oriented_points(mesh: TriangleMesh) -> OrientedPoints:
    """Return the vertices of an evenly triangulated mesh as points; each represents about the same area."""
    centre = mesh.vertices.mean(axis=0)
    return OrientedPoints(mesh.vertices - centre, mesh.vertex_normals, centre)


def axes_rotation(moving: OrientedPoints, fixed: OrientedPoints) -> FloatArray:
    """Return the best-fitting of the four rotations that align the principal axes."""
    own, other = _axes(moving.points), _axes(fixed.points)
    turns = [other @ np.diag(signs) @ own.T for signs in product((1.0, -1.0), repeat=3)]
    turns = [turn for turn in turns if np.linalg.det(turn) > 0.0]
    surface = NearestPoints(fixed.points, fixed.normals)
    return min(turns, key=lambda turn: float(np.mean(surface.nearest(moving.points[::5] @ turn.T)[0])))


def registered(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the similarity that registers one point set to another, both centred and of similar size.

    Matches are closest points in position and normal, in both directions. Unusually distant matches have
    little weight, so that a missing or displaced part does not rotate the rest. The given orientation is kept
    unless another leaves less than half the distance between the surfaces, so that near-symmetric shapes keep
    theirs.

    Parameters
    ----------
    moving, fixed : OrientedPoints
    """
    own, other = SearchedPoints(moving), SearchedPoints(fixed)
    given, *others = _candidates(own, other)
    best = min(others, key=lambda fit: _gap(own, other, fit.pose), default=given)
    if _gap(own, other, best.pose) * _CLEARLY > _gap(own, other, given.pose):
        best = given
    return iterated(own, other, best.pose[None], _FIT_POINTS, _ROUNDS)[0]


def candidates(moving: OrientedPoints, fixed: OrientedPoints) -> list[Fit]:
    """Return registrations of different orientations, the given one first, then the closest first.

    The starts are the 24 alignments of the principal axes, and rotations about the longest one by 45°.
    """
    return _candidates(SearchedPoints(moving), SearchedPoints(fixed))


def _candidates(own: SearchedPoints, other: SearchedPoints) -> list[Fit]:
    given = iterated(own, other, np.eye(4)[None], _TRIAL_POINTS, _ROUNDS)[0]  # it may settle slowly
    starts = np.array(_starts(own.points, other.points))
    screened = iterated(own, other, starts, _SCREENING_POINTS, _SCREENING_ROUNDS)
    tried = _different(sorted(screened, key=lambda fit: fit.distance))[:_MAX_CANDIDATES]
    trials = iterated(own, other, np.array([fit.pose for fit in tried]), _TRIAL_POINTS, _TRIAL_ROUNDS)
    return _different([given, *sorted(trials, key=lambda fit: fit.distance)])


def gap(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray) -> float:
    """Return the mean distance between two surfaces, one of which is placed by a similarity (4, 4)."""
    return _gap(SearchedPoints(moving), SearchedPoints(fixed), pose)


def _gap(own: SearchedPoints, other: SearchedPoints, pose: FloatArray) -> float:
    """Return the mean distance between two surfaces, both ways.

    It is that of matched points along the mean of their normals, which is zero for points of one sphere, so
    that it does not depend on how densely surfaces are sampled.
    """
    rotation, some, theirs = rotation_of(pose), own.some(_FIT_POINTS), other.some(_FIT_POINTS)
    points, normals = transform_points(pose, own.points), own.normals @ rotation.T
    onto = other.nearest(points[some], normals[some])[1]
    goals = transform_points(inverse_matrices(pose), other.points[theirs])
    from_ = own.nearest(goals, other.normals[theirs] @ rotation)[1]
    offsets = np.concatenate([points[some] - other.points[onto], points[from_] - other.points[theirs]])
    planes = np.concatenate([normals[some] + other.normals[onto], normals[from_] + other.normals[theirs]])
    return float(np.abs(np.einsum("ni,ni->n", offsets, planes)).mean()) / 2.0 + 1e-9


def _different(fits: list[Fit]) -> list[Fit]:
    """Return the fits without those whose rotation is similar to that of an earlier one."""
    chosen: list[Fit] = []
    for fit in fits:
        turns = [rotation_of(fit.pose) @ rotation_of(earlier.pose).T for earlier in chosen]
        if all(Rotation.from_matrix(turn).magnitude() > np.deg2rad(ANOTHER) for turn in turns):
            chosen.append(fit)
    return chosen


def refined(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the similarity of one point set to another, starting from the given orientation."""
    return iterated(
        SearchedPoints(moving), SearchedPoints(fixed), np.eye(4)[None], _TRIAL_POINTS, _TRIAL_ROUNDS
    )[0]


def refined_each(moving: Sequence[SearchedPoints], fixed: Sequence[SearchedPoints]) -> list[Fit]:
    """Return `refined` for pairs of point sets, which is faster for several pairs together."""
    starts = np.tile(np.eye(4), (len(moving), 1, 1))
    return iterated_each(moving, fixed, starts, _TRIAL_POINTS, _TRIAL_ROUNDS)


def sought(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the best of the similarities that start from 60 evenly spaced orientations."""
    starts = np.tile(np.eye(4), (60, 1, 1))
    starts[:, :3, :3] = Rotation.create_group("I").as_matrix()
    fits = iterated(SearchedPoints(moving), SearchedPoints(fixed), starts, _TRIAL_POINTS, _TRIAL_ROUNDS)
    return min(fits, key=lambda fit: fit.distance)


def refitted(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray, *, holds: bool = False) -> Fit:
    """Return the similarity (4, 4) that a given one leads to, with many points.

    With `holds`, the given orientation of the points has a prior weight against that of the surfaces
    (`prior_weights`), and the result is the most probable one.
    """
    return iterated(
        SearchedPoints(moving), SearchedPoints(fixed), pose[None], _FIT_POINTS, _ROUNDS, holds=holds
    )[0]


def softness_of_fit(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray) -> float:
    """Return how little a surface determines its orientation (`softness`), if registered by a pose (4, 4)."""
    other, linear = SearchedPoints(fixed), pose[:3, :3] / scale_of(pose)
    some = slice(None, None, max(1, len(moving.points) // _FIT_POINTS))
    points, normals = moving.points[some] @ pose[:3, :3].T + pose[:3, 3], moving.normals[some] @ linear.T
    nearest = other.nearest(points, normals)[1]
    planes, offsets = other.normals[nearest], other.points[nearest] - points
    weights = robust_weights(np.linalg.norm(offsets, axis=1)[None])
    along = np.einsum("ni,ni->n", offsets, planes)
    return float(softness(points[None], planes[None], along[None], weights)[0])


class Bending:
    """A surface deformed by a sum of Gaussians and a linear map; the stiffness penalizes the deformation."""

    def __init__(self, half: SearchedPoints) -> None:
        some = half.some(_TRIAL_POINTS)
        self._points, self._normals = half.points[some], half.normals[some]
        count = min(_GAUSSIANS, len(self._points))
        centres = self._points[farthest_point_sampling(self._points, count)]
        values, self._cost = (
            np.exp(-0.5 * cdist(points, centres, "sqeuclidean") / _WIDTH**2)
            for points in (self._points, centres)
        )
        slopes = (centres - self._points[:, None]) / _WIDTH**2 * values[..., None]
        linear = np.broadcast_to(np.eye(3), (len(slopes), 3, 3))
        self._values = np.concatenate([values, self._points], axis=1)
        self._slopes = np.concatenate([slopes, linear], axis=1)  # (N, functions, 3)

    def bent(self, other: SearchedPoints, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and normals of the surface, bent onto another one from a pose (4, 4)."""
        theirs, linear = other.some(_TRIAL_POINTS), np.full(3, _LINEAR_STIFFNESS)
        placed = self._points @ pose[:3, :3].T + pose[:3, 3]
        points, normals = placed, self._normals @ rotation_of(pose).T
        for stiffness in _STIFFNESSES:
            gaps, onto, back = self._matches(other, theirs, points, normals)
            weights = robust_weights(gaps[None])[0]
            functions = np.concatenate([self._values, self._values[back]])
            offsets = np.concatenate([other.points[onto] - placed, other.points[theirs] - placed[back]])
            weighted = (functions * (weights / weights.sum())[:, None]).T
            cost = block_diag(stiffness * self._cost, np.diag(linear))
            by = np.linalg.solve(weighted @ functions + cost, weighted @ offsets)
            points = placed + self._values @ by
            slopes = pose[:3, :3] + np.einsum("nfi,fj->nji", self._slopes, by)
            normals = np.linalg.solve(slopes.transpose(0, 2, 1), self._normals[..., None])[..., 0]
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return points, normals

    @staticmethod
    def _matches(
        other: SearchedPoints, theirs: slice, points: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, IntArray, IntArray]:
        """Return distances of matches in both directions, and the indices of either surface's points."""
        there, onto = other.nearest(points, normals)
        own = NearestPoints(points, normals, NORMAL_WEIGHT)
        back, from_ = own.nearest(other.points[theirs], other.normals[theirs])
        return np.concatenate([there, back]), onto, from_


def _axes(points: FloatArray) -> FloatArray:
    axes: FloatArray = np.linalg.eigh(points.T @ points)[1]
    return axes


def _starts(moving: FloatArray, fixed: FloatArray) -> list[FloatArray]:
    """Return the initial rotations as (4, 4) matrices."""
    own, other = _axes(moving), _axes(fixed)
    flips = [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)]
    alignments = [np.eye(3)[list(order)] @ flip for order in permutations(range(3)) for flip in flips]
    about = Rotation.from_rotvec([0.0, 0.0, np.pi / 4.0]).as_matrix()  # the longest axis is the last
    alignments += [about @ item for item in alignments if abs(item[2, 2]) == 1.0]
    starts = []
    for turn in (other @ item @ own.T for item in alignments):
        if np.linalg.det(turn) > 0.0:
            start = np.eye(4)
            start[:3, :3] = turn
            starts.append(start)
    return starts
