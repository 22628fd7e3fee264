"""Registration of two surfaces: similarities by iterative closest points from many starts."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import farthest_point_sampling, rotation_of, scale_of
from homolog.registration.closest_points import (
    NORMAL_WEIGHT,
    Fit,
    OrientedPoints,
    SearchedPoints,
    iterated,
    iterated_each,
    robust_weights,
    search_tree,
)
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.orientation import softness

__all__ = [
    "Bending", "Fit", "OrientedPoints", "axes_rotation", "candidates", "fit_at", "held", "oriented_points",
    "refined", "refined_each", "registered", "softness_of_fit",
]  # fmt: skip

_SCREENING_POINTS, _TRIAL_POINTS, _FIT_POINTS = 100, 300, 1000  # of each surface
_SCREENING_ROUNDS, _TRIAL_ROUNDS, _ROUNDS = 3, 10, 40
_TRIALS = 4
_CLEARLY_BETTER = 0.6  # fraction of the distance below which another orientation replaces the given one
_MAX_CANDIDATES, _MIN_ANGLE = 6, 30.0  # orientations tried with bending; angle between them [degrees]
_CANDIDATE_RATIO = 2.0  # times the closest distance: candidates for bending are not farther
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
    tree = KDTree(fixed.points)
    return min(turns, key=lambda turn: float(np.mean(tree.query(moving.points[::5] @ turn.T)[0])))


def registered(
    moving: OrientedPoints, fixed: OrientedPoints, *, free: bool = False, bends: bool = False
) -> Fit:
    """Return the similarity that registers one point set to another, both centred and of similar size.

    Matches are closest points in position and normal, in both directions. Unusually distant matches have
    little weight, so that a missing or displaced part does not rotate the rest. The starts are the given
    orientation, the 24 alignments of the principal axes, and rotations about the longest one by 45°.

    Parameters
    ----------
    moving, fixed : OrientedPoints
    free : bool
        Whether to ignore the given orientation. Otherwise it is kept unless another fits clearly better,
        so that near-symmetric shapes keep theirs.
    bends : bool
        Whether to ignore the given orientation, bend the surface from each of the orientations that fit about
        equally well, and choose the one with the smallest distance after bending. If shapes differ much, a
        wrong orientation may fit more closely, but its details do not. The distance is then that of the bent
        surface.
    """
    own, other = SearchedPoints(moving), SearchedPoints(fixed)
    screened = _screened(own, other)
    starts = np.array([np.eye(4), *(fit.pose for fit in screened[:_TRIALS])])
    given, *trials = iterated(own, other, starts, _TRIAL_POINTS, _TRIAL_ROUNDS)
    best = min(trials, key=lambda fit: fit.distance)
    free = free or bends
    if not free and best.distance <= _CLEARLY_BETTER * given.distance:  # it may not have converged yet
        given = iterated(own, other, given.pose[None], _TRIAL_POINTS, _ROUNDS)[0]
    if best.distance > (1.0 if free else _CLEARLY_BETTER) * given.distance:
        best = given
    if bends:
        best = _nearest_bent(own, other, best, screened)
    fit = iterated(own, other, best.pose[None], _FIT_POINTS, _ROUNDS)[0]
    return replace(fit, distance=best.distance) if bends else fit


def candidates(own: SearchedPoints, other: SearchedPoints) -> list[Fit]:
    """Return registrations of different orientations that fit about equally well, the given one first."""
    given = iterated(own, other, np.eye(4)[None], _TRIAL_POINTS, _TRIAL_ROUNDS)[0]
    return _candidates(own, other, given, _screened(own, other))


def _screened(own: SearchedPoints, other: SearchedPoints) -> list[Fit]:
    """Return the first rounds of registrations from all starts, the closest first."""
    fits = iterated(
        own, other, np.array(_starts(own.points, other.points)), _SCREENING_POINTS, _SCREENING_ROUNDS
    )
    return sorted(fits, key=lambda fit: fit.distance)


def _candidates(own: SearchedPoints, other: SearchedPoints, first: Fit, screened: list[Fit]) -> list[Fit]:
    """Return fits of different orientations, the first one and others that are about as close."""
    starts = np.array([fit.pose for fit in _different(screened)[:_MAX_CANDIDATES]])
    trials = sorted(iterated(own, other, starts, _TRIAL_POINTS, _TRIAL_ROUNDS), key=lambda fit: fit.distance)
    limit = _CANDIDATE_RATIO * first.distance
    return [fit for fit in _different([first, *trials]) if fit.distance <= limit]


def _nearest_bent(own: SearchedPoints, other: SearchedPoints, closest: Fit, screened: list[Fit]) -> Fit:
    """Return the candidate from which the bent surface comes nearest, with the distance after bending."""
    surface = Bending(own)
    tried = _candidates(own, other, closest, screened)
    bent = [Fit(fit.pose, surface.distance(other, fit.pose)) for fit in tried]
    return min(bent, key=lambda fit: fit.distance)


def _different(fits: list[Fit]) -> list[Fit]:
    """Return the fits without those whose rotation is similar to that of an earlier one."""
    chosen: list[Fit] = []
    for fit in fits:
        turns = [rotation_of(fit.pose) @ rotation_of(earlier.pose).T for earlier in chosen]
        if all(Rotation.from_matrix(turn).magnitude() > np.deg2rad(_MIN_ANGLE) for turn in turns):
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


def held(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the most probable similarity of two point sets whose files have the same orientation.

    It starts from the given orientation, which has a prior weight against that of the surfaces
    (`prior_weights`).
    """
    return iterated(
        SearchedPoints(moving), SearchedPoints(fixed), np.eye(4)[None], _FIT_POINTS, _ROUNDS, holds=True
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


def fit_at(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray) -> Fit:
    """Return a given similarity (4, 4) of one point set onto another with the distance of the matches."""
    return Fit(
        pose, iterated(SearchedPoints(moving), SearchedPoints(fixed), pose[None], _FIT_POINTS, 1)[0].distance
    )


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

    def distance(self, other: SearchedPoints, pose: FloatArray) -> float:
        """Return the mean distance of the matches, in both directions, after bending from a pose (4, 4)."""
        points, normals = self.bent(other, pose)
        return float(self._matches(other, other.some(_TRIAL_POINTS), points, normals)[0].mean())

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
        tree = search_tree(points, normals)
        wanted = np.concatenate([other.points[theirs], NORMAL_WEIGHT * other.normals[theirs]], axis=1)
        back, from_ = tree.query(wanted)
        return np.concatenate([there, back]), onto, np.asarray(from_)


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
