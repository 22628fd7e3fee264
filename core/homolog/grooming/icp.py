"""Registration of a surface to another: similarities by iterated closest points from many starts."""

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import fit_rotation, transform_points
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Fit", "OrientedPoints", "axes_rotation", "fit_at", "oriented_points", "registered"]

_GLANCE, _FEW, _MANY = 100, 300, 1000  # points of each surface that a look, a trial and the fit use
_GLANCE_ROUNDS, _TRIAL_ROUNDS, _ROUNDS = 3, 10, 40
_TRIALS = 4
_SETTLED = 1e-4  # change of the distance
_NORMAL_WEIGHT = 0.5  # of the size: how far apart a wall's two sides seem
_TOLERANT = 2.0  # times the median distance of matches: from where on a match counts little
_CLEARLY_BETTER = 0.6  # of the distance: when another orientation replaces the given one
_LIMIT = 1.5  # by how much a registration may change the size


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPoints:
    """A surface as points about their centre.

    Attributes
    ----------
    points, normals : (N, 3) float64 arrays
        ``scale * (vertex - centre)`` [mm] and unit normals.
    centre : (3,) float64 array
        Mean of the vertices [mm, local].
    scale : float
        Enlargement about the centre.
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


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How a surface was registered.

    Attributes
    ----------
    pose : (4, 4) float64 array
        Similarity of the moving cloud onto the fixed one.
    distance : float
        Median distance of the matches in position and normal, over the size.
    """

    pose: FloatArray
    distance: float


def oriented_points(mesh: TriangleMesh) -> OrientedPoints:
    """Return a mesh of even triangles as points: every vertex stands for about the same area."""
    centre = mesh.vertices.mean(axis=0)
    return OrientedPoints(mesh.vertices - centre, mesh.vertex_normals, centre)


def axes_rotation(moving: OrientedPoints, fixed: OrientedPoints) -> FloatArray:
    """Return the rotation of principal axes onto principal axes, of the four the one that fits best."""
    own, other = _axes(moving), _axes(fixed)
    turns = [other @ np.diag(signs) @ own.T for signs in product((1.0, -1.0), repeat=3)]
    turns = [turn for turn in turns if np.linalg.det(turn) > 0.0]
    tree = KDTree(fixed.points)
    return min(turns, key=lambda turn: float(np.mean(tree.query(moving.points[::5] @ turn.T)[0])))


def registered(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the similarity that brings one cloud onto another, both centred and of about one size.

    Matches are closest points in position and normal, in both directions; what is farther than usual counts
    little, so that a part that one surface lacks, or has elsewhere, does not turn the rest. Starts are the
    given orientation, the 24 ways of matching principal axes, and turns about the longest by 45°. The given
    orientation is kept unless another fits clearly better, so that near-symmetric shapes keep theirs.
    """
    own, other = _Half(moving), _Half(fixed)
    given = _iterated(own, other, np.eye(4), _FEW, _TRIAL_ROUNDS)
    looks = [_iterated(own, other, start, _GLANCE, _GLANCE_ROUNDS) for start in _starts(moving, fixed)]
    looks.sort(key=lambda fit: fit.distance)
    trials = [_iterated(own, other, look.pose, _FEW, _TRIAL_ROUNDS) for look in looks[:_TRIALS]]
    best = min(trials, key=lambda fit: fit.distance)
    if best.distance > _CLEARLY_BETTER * given.distance:
        best = given
    return _iterated(own, other, best.pose, _MANY, _ROUNDS)


def fit_at(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray) -> Fit:
    """Return a similarity (4, 4) of one cloud onto another as it is, with the distance of the matches."""
    return Fit(pose, _iterated(_Half(moving), _Half(fixed), pose, _MANY, 1).distance)


class _Half:
    """One of two clouds of about unit size that are registered, ready to be searched."""

    def __init__(self, shape: OrientedPoints) -> None:
        self.points, self.normals = shape.points, shape.normals
        self.tree = KDTree(np.concatenate([self.points, _NORMAL_WEIGHT * self.normals], axis=1))

    def some(self, count: int) -> slice:
        """Return which points stand for all where about so many do."""
        return slice(None, None, max(1, len(self.points) // count))

    def nearest(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return distances to the nearest points in position and normal, and their indices."""
        distances, indices = self.tree.query(np.concatenate([points, _NORMAL_WEIGHT * normals], axis=1))
        return np.asarray(distances), np.asarray(indices)


def _axes(shape: OrientedPoints) -> FloatArray:
    axes: FloatArray = np.linalg.eigh(shape.points.T @ shape.points)[1]
    return axes


def _starts(moving: OrientedPoints, fixed: OrientedPoints) -> list[FloatArray]:
    """Return rotations to begin with, as (4, 4) matrices."""
    own, other = _axes(moving), _axes(fixed)
    flips = [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)]
    ways = [np.eye(3)[list(order)] @ flip for order in permutations(range(3)) for flip in flips]
    about = Rotation.from_rotvec([0.0, 0.0, np.pi / 4.0]).as_matrix()  # the longest axis is the last
    ways += [about @ way for way in ways if abs(way[2, 2]) == 1.0]
    starts = []
    for turn in (other @ way @ own.T for way in ways):
        if np.linalg.det(turn) > 0.0:
            start = np.eye(4)
            start[:3, :3] = turn
            starts.append(start)
    return starts


def _iterated(own: _Half, other: _Half, pose: FloatArray, count: int, rounds: int) -> Fit:
    """Alternate matching, in both directions, and moving."""
    mine, theirs = own.some(count), other.some(count)
    a, na, b, nb = own.points[mine], own.normals[mine], other.points[theirs], other.normals[theirs]
    distance = np.inf
    for _ in range(rounds):
        scale = np.cbrt(np.linalg.det(pose[:3, :3]))
        turn = pose[:3, :3] / scale
        there, onto = other.nearest(transform_points(pose, a), na @ turn.T)
        back, from_ = own.nearest((b - pose[:3, 3]) @ turn / scale, nb @ turn)
        distances = np.concatenate([there, back * scale])
        before, distance = distance, float(np.median(distances))
        usual = _TOLERANT * max(distance, 1e-9)
        weights = 1.0 / np.square(1.0 + np.square(distances / usual))
        pose = _best_fit(
            np.concatenate([a, own.points[from_]]), np.concatenate([other.points[onto], b]), weights
        )
        if abs(before - distance) < _SETTLED:
            break
    return Fit(pose, distance)


def _best_fit(points: FloatArray, targets: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the similarity of points to targets with weighted least squares (Umeyama 1991)."""
    share = weights / weights.sum()
    middle, goal = share @ points, share @ targets
    own, other = points - middle, targets - goal
    left, right, _ = fit_rotation((other * share[:, None]).T @ own)
    scale = float(np.sqrt((share @ np.square(other)).sum() / (share @ np.square(own)).sum()))
    pose = np.eye(4)
    pose[:3, :3] = np.clip(scale, 1.0 / _LIMIT, _LIMIT) * left @ right
    pose[:3, 3] = goal - pose[:3, :3] @ middle
    return pose
