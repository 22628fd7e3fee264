"""Registration of a surface to another: similarities by iterated closest points from many starts."""

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, IntArray
from homolog.geometry import farthest_point_sampling, fit_rotation, rotation_of, scale_of
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.orientation import prior_weights, softness

__all__ = [
    "Fit", "OrientedPoints", "axes_rotation", "fit_at", "held", "oriented_points", "refined", "registered",
    "softness_of_fit",
]  # fmt: skip

_GLANCE, _FEW, _MANY = 100, 300, 1000  # points of each surface that a look, a trial and the fit use
_GLANCE_ROUNDS, _TRIAL_ROUNDS, _ROUNDS = 3, 10, 40
_TRIALS = 4
_SETTLED = 1e-4  # change of the distance
_NORMAL_WEIGHT = 0.5  # of the size: how far apart a wall's two sides seem
_TOLERANT = 2.0  # times the median distance of matches: from where on a match counts little
_CLEARLY_BETTER = 0.6  # of the distance: when another orientation replaces the given one
_LIMIT = 1.5  # by how much a registration may change the size
_WAYS, _APART = 6, 30.0  # orientations that may be bent, and by how many degrees they differ
_RIVAL = 2.0  # of the closest distance: up to where another orientation is bent, too
_HANDLES, _REACH = 40, 0.7  # Gaussians by which a surface is bent, and their width, of the size
_STIFFNESSES = np.geomspace(0.1, 0.003, 10).tolist()  # of the rounds: cost of bending
_LINEAR_STIFFNESS = 0.01


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
    """Registration of a surface.

    Attributes
    ----------
    pose : (4, 4) float64 array
        Similarity of the moving cloud onto the fixed one.
    distance : float
        Mean distance of the matches in position and normal, over the size. Unlike a median it includes the
        few regions where a shape is not symmetric, which tell its orientation.
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


def registered(
    moving: OrientedPoints, fixed: OrientedPoints, *, free: bool = False, bends: bool = False
) -> Fit:
    """Return the similarity of one point set to another, both centred and of about one size.

    Matches are closest points in position and normal, in both directions; those farther apart than usual have
    little weight, so that a part that is missing or displaced does not rotate the rest. Starts are the
    given orientation, the 24 ways of matching principal axes, and turns about the longest by 45°.

    Parameters
    ----------
    moving, fixed : OrientedPoints
    free : bool
        Whether to ignore the given orientation. Otherwise it is kept unless another fits clearly better,
        so that near-symmetric shapes keep theirs.
    bends : bool
        Whether to ignore the given orientation, and to choose of those that fit about as well the one from
        which the surface comes nearest once it is bent: where shapes differ much, a wrong orientation may fit
        more closely, but then their details do not. The distance is then that of the bent surface.
    """
    own, other = _Half(moving), _Half(fixed)
    looks = _iterated(own, other, np.array(_starts(moving, fixed)), _GLANCE, _GLANCE_ROUNDS)
    looks.sort(key=lambda fit: fit.distance)
    starts = np.array([np.eye(4), *(look.pose for look in looks[:_TRIALS])])
    given, *trials = _iterated(own, other, starts, _FEW, _TRIAL_ROUNDS)
    best = min(trials, key=lambda fit: fit.distance)
    free = free or bends
    if not free and best.distance <= _CLEARLY_BETTER * given.distance:  # which may not have settled yet
        given = _iterated(own, other, given.pose[None], _FEW, _ROUNDS)[0]
    if best.distance > (1.0 if free else _CLEARLY_BETTER) * given.distance:
        best = given
    if bends:
        best = _nearest_bent(own, other, best, looks)
    fit = _iterated(own, other, best.pose[None], _MANY, _ROUNDS)[0]
    return replace(fit, distance=best.distance) if bends else fit


def _nearest_bent(own: "_Half", other: "_Half", closest: Fit, looks: list[Fit]) -> Fit:
    """Return the closest fit, or a rival, from which the surface comes nearest once bent, and how near."""
    starts = np.array([look.pose for look in _different(looks)[:_WAYS]])
    trials = sorted(_iterated(own, other, starts, _FEW, _TRIAL_ROUNDS), key=lambda fit: fit.distance)
    rivals = [fit for fit in _different([closest, *trials]) if fit.distance <= _RIVAL * closest.distance]
    surface = _Bending(own)
    bent = [Fit(fit.pose, surface.distance(other, fit.pose)) for fit in rivals]
    return min(bent, key=lambda fit: fit.distance)


def _different(fits: list[Fit]) -> list[Fit]:
    """Return the fits without those that hardly turn relative to an earlier one."""
    chosen: list[Fit] = []
    for fit in fits:
        turns = [rotation_of(fit.pose) @ rotation_of(earlier.pose).T for earlier in chosen]
        if all(Rotation.from_matrix(turn).magnitude() > np.deg2rad(_APART) for turn in turns):
            chosen.append(fit)
    return chosen


def refined(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the similarity of one point set to another that starts from where they lie."""
    return _iterated(_Half(moving), _Half(fixed), np.eye(4)[None], _FEW, _TRIAL_ROUNDS)[0]


def sought(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the best similarity of those that 60 evenly spaced orientations lead to."""
    starts = np.tile(np.eye(4), (60, 1, 1))
    starts[:, :3, :3] = Rotation.create_group("I").as_matrix()
    fits = _iterated(_Half(moving), _Half(fixed), starts, _FEW, _TRIAL_ROUNDS)
    return min(fits, key=lambda fit: fit.distance)


def held(moving: OrientedPoints, fixed: OrientedPoints) -> Fit:
    """Return the similarity to a point set whose file lies like the moving one's: the most probable.

    It starts from where they lie, and is turned as far as the surfaces tell (`prior_weights`).
    """
    return _iterated(_Half(moving), _Half(fixed), np.eye(4)[None], _MANY, _ROUNDS, holds=True)[0]


def softness_of_fit(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray) -> float:
    """Return how little a surface tells of its orientation (`softness`), once registered by a pose (4, 4)."""
    other, linear = _Half(fixed), pose[:3, :3] / scale_of(pose)
    some = slice(None, None, max(1, len(moving.points) // _MANY))
    points, normals = moving.points[some] @ pose[:3, :3].T + pose[:3, 3], moving.normals[some] @ linear.T
    nearest = other.nearest(points, normals)[1]
    planes, offsets = other.normals[nearest], other.points[nearest] - points
    weights = _weights(np.linalg.norm(offsets, axis=1)[None])
    along = np.einsum("ni,ni->n", offsets, planes)
    return float(softness(points[None], planes[None], along[None], weights)[0])


def fit_at(moving: OrientedPoints, fixed: OrientedPoints, pose: FloatArray) -> Fit:
    """Return a similarity (4, 4) of one cloud onto another as it is, with the distance of the matches."""
    return Fit(pose, _iterated(_Half(moving), _Half(fixed), pose[None], _MANY, 1)[0].distance)


class _Half:
    """One of two clouds of about unit size that are registered, ready to be searched."""

    def __init__(self, shape: OrientedPoints) -> None:
        self.points, self.normals = shape.points, shape.normals
        self.tree = _tree(self.points, self.normals)

    def some(self, count: int) -> slice:
        """Return a slice that takes about `count` points, evenly."""
        return slice(None, None, max(1, len(self.points) // count))

    def nearest(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return distances to the nearest points in position and normal, and their indices, (..., N)."""
        distances, indices = self.tree.query(np.concatenate([points, _NORMAL_WEIGHT * normals], axis=-1))
        return np.asarray(distances), np.asarray(indices)


class _Bending:
    """A surface that is moved by a sum of Gaussians and a linear map, at a cost by its stiffness."""

    def __init__(self, half: _Half) -> None:
        some = half.some(_FEW)
        self._points, self._normals = half.points[some], half.normals[some]
        count = min(_HANDLES, len(self._points))
        handles = self._points[farthest_point_sampling(self._points, count)]
        values, self._cost = (
            np.exp(-0.5 * cdist(points, handles, "sqeuclidean") / _REACH**2)
            for points in (self._points, handles)
        )
        slopes = (handles - self._points[:, None]) / _REACH**2 * values[..., None]
        linear = np.broadcast_to(np.eye(3), (len(slopes), 3, 3))
        self._values = np.concatenate([values, self._points], axis=1)
        self._slopes = np.concatenate([slopes, linear], axis=1)  # (N, functions, 3)

    def distance(self, other: _Half, pose: FloatArray) -> float:
        """Return the mean distance of the matches, in both directions, once bent from a pose (4, 4)."""
        theirs, linear = other.some(_FEW), np.full(3, _LINEAR_STIFFNESS)
        placed = self._points @ pose[:3, :3].T + pose[:3, 3]
        points, normals = placed, self._normals @ rotation_of(pose).T
        for stiffness in _STIFFNESSES:
            gaps, onto, back = self._matches(other, theirs, points, normals)
            weights = _weights(gaps[None])[0]
            functions = np.concatenate([self._values, self._values[back]])
            offsets = np.concatenate([other.points[onto] - placed, other.points[theirs] - placed[back]])
            weighted = (functions * (weights / weights.sum())[:, None]).T
            cost = block_diag(stiffness * self._cost, np.diag(linear))
            by = np.linalg.solve(weighted @ functions + cost, weighted @ offsets)
            points = placed + self._values @ by
            slopes = pose[:3, :3] + np.einsum("nfi,fj->nji", self._slopes, by)
            normals = np.linalg.solve(slopes.transpose(0, 2, 1), self._normals[..., None])[..., 0]
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return float(self._matches(other, theirs, points, normals)[0].mean())

    @staticmethod
    def _matches(
        other: _Half, theirs: slice, points: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, IntArray, IntArray]:
        """Return distances of matches in both directions, and the indices of either surface's points."""
        there, onto = other.nearest(points, normals)
        tree = _tree(points, normals)
        wanted = np.concatenate([other.points[theirs], _NORMAL_WEIGHT * other.normals[theirs]], axis=1)
        back, from_ = tree.query(wanted)
        return np.concatenate([there, back]), onto, np.asarray(from_)


def _tree(points: FloatArray, normals: FloatArray) -> KDTree:
    """Return a tree of positions and normals; in six dimensions, large unbalanced leaves are quickest."""
    values = np.concatenate([points, _NORMAL_WEIGHT * normals], axis=1)
    return KDTree(values, leafsize=32, balanced_tree=False)


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


def _iterated(
    own: _Half, other: _Half, poses: FloatArray, count: int, rounds: int, *, holds: bool = False
) -> list[Fit]:
    """Alternate matching, in both directions, and moving, from each of several poses (S, 4, 4) at once."""
    mine, theirs = own.some(count), other.some(count)
    a, na, b, nb = own.points[mine], own.normals[mine], other.points[theirs], other.normals[theirs]
    poses, distances = poses.copy(), np.full(len(poses), np.inf)
    moving = np.arange(len(poses))  # those that have not settled
    for _ in range(rounds):
        pose = poses[moving]
        scale = scale_of(pose)[:, None, None]
        turn, shift = pose[:, :3, :3] / scale, pose[:, None, :3, 3]
        there, onto = other.nearest(
            a @ pose[:, :3, :3].transpose(0, 2, 1) + shift, na @ turn.transpose(0, 2, 1)
        )
        back, from_ = own.nearest((b - shift) @ turn / scale, nb @ turn)
        gaps = np.concatenate([there, back * scale[..., 0]], axis=1)
        before, distances[moving] = distances[moving], gaps.mean(axis=1)
        weights = _weights(gaps)
        pairs = np.empty((2, len(moving), len(a) + len(b), 3))
        pairs[0, :, : len(a)], pairs[0, :, len(a) :] = a, own.points[from_]
        pairs[1, :, : len(a)], pairs[1, :, len(a) :] = other.points[onto], b
        poses[moving] = _best_fits(pairs[0], pairs[1], weights, pose if holds else None)
        moving = moving[~(np.abs(before - distances[moving]) < _SETTLED)]
        if not len(moving):
            break
    return [Fit(pose, float(distance)) for pose, distance in zip(poses, distances, strict=True)]


def _weights(gaps: FloatArray) -> FloatArray:
    """Return robust weights of matches (S, N) from their distances."""
    usual = _TOLERANT * np.maximum(np.median(gaps, axis=1), 1e-9)[:, None]
    weights: FloatArray = 1.0 / np.square(1.0 + np.square(gaps / usual))
    return weights


def _best_fits(
    points: FloatArray, targets: FloatArray, weights: FloatArray, held_poses: FloatArray | None = None
) -> FloatArray:
    """Return the similarities (S, 4, 4) of points to targets (S, N, 3), least squares (Umeyama 1991).

    With present poses, the given orientation is prior knowledge that counts by the distances that remain.
    """
    share = (weights / weights.sum(axis=1, keepdims=True))[:, None]
    middle, goal = share @ points, share @ targets
    own, other = points - middle, targets - goal
    covariance = (other * share.transpose(0, 2, 1)).transpose(0, 2, 1) @ own
    if held_poses is not None:
        placed = points @ held_poses[:, :3, :3].transpose(0, 2, 1) + held_poses[:, None, :3, 3]
        # Half of a match's squared distance is along the normal, and a turn by t costs t^2 / 2 of the trace.
        squares = 0.5 * (share @ np.square(targets - placed)).sum(axis=(1, 2))
        covariance = covariance + 0.5 * prior_weights(squares)[:, None, None] * np.eye(3)
    left, right, _ = fit_rotation(covariance)
    spread = [(share @ np.square(item)).sum(axis=(1, 2)) for item in (other, own)]
    scale = np.clip(np.sqrt(spread[0] / spread[1]), 1.0 / _LIMIT, _LIMIT)
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, :3] = scale[:, None, None] * left @ right
    poses[:, :3, 3] = (goal - middle @ poses[:, :3, :3].transpose(0, 2, 1))[:, 0]
    return poses
