"""Iterative closest points in position and normal: alternating matches and least squares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import fit_rotation, rotation_of, scale_of, transform_points
from homolog.surfaces.nearest import NearestPoints
from homolog.surfaces.orientation import prior_weights

__all__ = [
    "NORMAL_WEIGHT",
    "Fit",
    "OrientedPoints",
    "SearchedPoints",
    "iterated",
    "iterated_each",
    "robust_weights",
]

NORMAL_WEIGHT = 0.5
"""Weight of normals in distances, relative to the size: separates the sides of a wall."""
_CONVERGED = 1e-4  # change of the distance
_OUTLIER = 2.0  # times the median distance of matches: weights decrease beyond it
_MAX_SCALING = 1.5  # largest change of size by a registration


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPoints:
    """A surface as points relative to their centre.

    Attributes
    ----------
    points, normals : (N, 3) float64 arrays
        ``scale * (vertex - centre)`` [mm] and unit normals.
    centre : (3,) float64 array
        Mean of the vertices [mm, local].
    scale : float
        Scale factor about the centre.
    """

    points: FloatArray
    normals: FloatArray
    centre: FloatArray
    scale: float = 1.0

    @property
    def size(self) -> float:
        """Root-mean-square distance from the centre [mm]."""
        return float(np.sqrt((self.points**2).sum(axis=1).mean()))

    def scaled(self, factor: float) -> "OrientedPoints":
        """Return the points scaled about their centre."""
        return replace(self, points=self.points * factor, scale=self.scale * factor)

    def placed(self, pose: FloatArray) -> "OrientedPoints":
        """Return the points moved by a similarity (4, 4), which leaves centre and scale as they are."""
        rotation = rotation_of(pose)
        return replace(self, points=transform_points(pose, self.points), normals=self.normals @ rotation.T)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Registration of a surface.

    Attributes
    ----------
    pose : (4, 4) float64 array
        Similarity of the moving point set onto the fixed one.
    distance : float
        Mean distance of the matches in position and normal, relative to the size. Unlike a median it includes
        the few asymmetric regions, which determine the orientation.
    """

    pose: FloatArray
    distance: float


class SearchedPoints(NearestPoints):
    """One of two registered point sets of about unit size, searched by position and normal.

    Parameters
    ----------
    shape : OrientedPoints
    """

    def __init__(self, shape: OrientedPoints) -> None:
        super().__init__(shape.points, shape.normals, NORMAL_WEIGHT)

    def some(self, count: int) -> slice:
        """Return a slice that selects about `count` points evenly."""
        return slice(None, None, max(1, len(self.points) // count))

    def exactly(self, count: int) -> IntArray:
        """Return the indices of `count` points, evenly."""
        return np.arange(count) * len(self.points) // count


def iterated(
    own: SearchedPoints,
    other: SearchedPoints,
    poses: FloatArray,
    count: int,
    rounds: int,
    *,
    holds: bool = False,
) -> list[Fit]:
    """Alternate matching in both directions and least squares, from several poses (S, 4, 4) at once."""
    return iterated_each([own], [other], poses, count, rounds, holds=holds)


def iterated_each(
    own: Sequence[SearchedPoints],
    other: Sequence[SearchedPoints],
    poses: FloatArray,
    count: int,
    rounds: int,
    *,
    holds: bool = False,
) -> list[Fit]:
    """Do as `iterated`, with a pair of point sets for each pose, or one for all."""
    a, na = _some(own, count)
    b, nb = _some(other, count)
    poses, distances = poses.copy(), np.full(len(poses), np.inf)
    moving = np.arange(len(poses))  # those that have not converged
    for _ in range(rounds):
        pose = poses[moving]
        mine: list[int] = moving.tolist() if len(own) > 1 else [0]
        scale = scale_of(pose)[:, None, None]
        turn, shift = pose[:, :3, :3] / scale, pose[:, None, :3, 3]
        there, onto = _nearest(
            [other[k] for k in mine],
            a[mine] @ pose[:, :3, :3].transpose(0, 2, 1) + shift,
            na[mine] @ turn.transpose(0, 2, 1),
        )
        back, from_ = _nearest([own[k] for k in mine], (b[mine] - shift) @ turn / scale, nb[mine] @ turn)
        gaps = np.concatenate([there, back * scale[..., 0]], axis=1)
        before, distances[moving] = distances[moving], gaps.mean(axis=1)
        weights = robust_weights(gaps)
        points = np.concatenate([np.broadcast_to(a[mine], onto.shape), from_], axis=1)
        targets = np.concatenate([onto, np.broadcast_to(b[mine], from_.shape)], axis=1)
        poses[moving] = _best_fits(points, targets, weights, pose if holds else None)
        moving = moving[~(np.abs(before - distances[moving]) < _CONVERGED)]
        if not len(moving):
            break
    return [Fit(pose, float(distance)) for pose, distance in zip(poses, distances, strict=True)]


def _some(halves: Sequence[SearchedPoints], count: int) -> tuple[FloatArray, FloatArray]:
    """Return about `count` points of each point set, evenly, and their normals, (S, N, 3) both."""
    fewest = min(len(half.points) for half in halves)
    rows = [half.some(count) if len(halves) == 1 else half.exactly(min(count, fewest)) for half in halves]
    pairs = list(zip(halves, rows, strict=True))
    return np.array([half.points[some] for half, some in pairs]), np.array(
        [half.normals[some] for half, some in pairs]
    )


def _nearest(
    halves: Sequence[SearchedPoints], points: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return distances (S, N) to the nearest points of one point set, or of one for each row, and these."""
    if len(halves) == 1:
        distances, indices = halves[0].nearest(points, normals)
        return distances, halves[0].points[indices]
    matches = [half.nearest(*row) for half, *row in zip(halves, points, normals, strict=True)]
    nearest = [half.points[indices] for half, (_, indices) in zip(halves, matches, strict=True)]
    return np.array([distances for distances, _ in matches]), np.array(nearest)


def robust_weights(gaps: FloatArray) -> FloatArray:
    """Return robust weights of matches (S, N) from their distances."""
    scale = _OUTLIER * np.maximum(np.median(gaps, axis=1), 1e-9)[:, None]
    weights: FloatArray = 1.0 / np.square(1.0 + np.square(gaps / scale))
    return weights


def _best_fits(
    points: FloatArray, targets: FloatArray, weights: FloatArray, held_poses: FloatArray | None = None
) -> FloatArray:
    """Return the similarities (S, 4, 4) of points to targets (S, N, 3), least squares (Umeyama 1991).

    With the current poses (`held_poses`), the given orientation has a prior weight that depends on the
    residual distances.
    """
    share = (weights / weights.sum(axis=1, keepdims=True))[:, None]
    middle, goal = share @ points, share @ targets
    own, other = points - middle, targets - goal
    covariance = (other * share.transpose(0, 2, 1)).transpose(0, 2, 1) @ own
    if held_poses is not None:
        placed = points @ held_poses[:, :3, :3].transpose(0, 2, 1) + held_poses[:, None, :3, 3]
        # Half of a match's squared distance is along the normal; rotating by t reduces the trace by t^2 / 2.
        squares = 0.5 * (share @ np.square(targets - placed)).sum(axis=(1, 2))
        covariance = covariance + 0.5 * prior_weights(squares)[:, None, None] * np.eye(3)
    left, right, _ = fit_rotation(covariance)
    spread = [(share @ np.square(item)).sum(axis=(1, 2)) for item in (other, own)]
    scale = np.clip(np.sqrt(spread[0] / spread[1]), 1.0 / _MAX_SCALING, _MAX_SCALING)
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, :3] = scale[:, None, None] * left @ right
    poses[:, :3, 3] = (goal - middle @ poses[:, :3, :3].transpose(0, 2, 1))[:, 0]
    return poses
