"""Rigid registration of a surface to another by iterated closest points."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Cloud", "axes_rotation", "cloud_of", "registered"]

_FEW = 300
_TRIAL_ROUNDS, _ROUNDS = 15, 60
_SETTLED = 1e-5  # of the size
_NORMAL_WEIGHT = 0.5  # of the size: how far apart a wall's two sides seem
_CLEARLY_BETTER = 0.6  # of the residual: when principal axes replace the given orientation


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
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

    def scaled(self, factor: float) -> "Cloud":
        """Return the cloud enlarged about its centre."""
        return replace(self, points=self.points * factor, scale=self.scale * factor)


def cloud_of(mesh: TriangleMesh) -> Cloud:
    """Return a mesh of even triangles as points: every vertex stands for about the same area."""
    centre = mesh.vertices.mean(axis=0)
    return Cloud(mesh.vertices - centre, mesh.vertex_normals, centre)


def axes_rotation(moving: Cloud, fixed: Cloud) -> FloatArray:
    """Return the rotation of principal axes onto principal axes, of the four the one that fits best."""
    turns = _axes_rotations(moving, fixed)
    tree = KDTree(fixed.points)
    return min(turns, key=lambda turn: float(np.mean(tree.query(moving.points[::5] @ turn.T)[0])))


def registered(moving: Cloud, fixed: Cloud) -> FloatArray:
    """Return the (4, 4) rigid motion that brings one cloud onto another, both centred.

    Starts are the given orientation and the four ways of matching principal axes; the given one is kept
    unless another fits clearly better, so that near-symmetric shapes keep their orientation.
    """
    tree = KDTree(np.concatenate([fixed.points, _NORMAL_WEIGHT * fixed.size * fixed.normals], axis=1))
    some = slice(None, None, max(1, len(moving.points) // _FEW))
    best, least = _iterated(moving, fixed, tree, np.eye(4), some, _TRIAL_ROUNDS)
    least *= _CLEARLY_BETTER
    for turn in _axes_rotations(moving, fixed):
        start = np.eye(4)
        start[:3, :3] = turn
        pose, residual = _iterated(moving, fixed, tree, start, some, _TRIAL_ROUNDS)
        if residual < least:
            best, least = pose, residual
    return _iterated(moving, fixed, tree, best, slice(None), _ROUNDS)[0]


def _axes_rotations(moving: Cloud, fixed: Cloud) -> list[FloatArray]:
    """Return the four proper rotations of principal axes onto principal axes."""
    own, other = (np.linalg.eigh(cloud.points.T @ cloud.points)[1] for cloud in (moving, fixed))
    turns = [other @ np.diag(signs) @ own.T for signs in product((1.0, -1.0), repeat=3)]
    return [turn for turn in turns if np.linalg.det(turn) > 0.0]


def _iterated(
    moving: Cloud, fixed: Cloud, tree: KDTree, pose: FloatArray, some: slice, rounds: int
) -> tuple[FloatArray, float]:
    """Alternate matching and moving; return the pose and the root-mean-square distance of matches [mm]."""
    points, normals = moving.points[some], moving.normals[some]
    weight = _NORMAL_WEIGHT * fixed.size
    residual = np.inf
    for _ in range(rounds):
        placed = points @ pose[:3, :3].T + pose[:3, 3]
        turned = weight * normals @ pose[:3, :3].T
        distances, nearest = tree.query(np.concatenate([placed, turned], axis=1))
        before, residual = residual, float(np.sqrt(np.mean(np.square(distances))))
        pose = _best_fit(points, fixed.points[nearest])
        if before - residual < _SETTLED * fixed.size:
            break
    return pose, residual


def _best_fit(points: FloatArray, targets: FloatArray) -> FloatArray:
    """Return the rigid motion of points to targets with least squares (Kabsch 1976)."""
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((targets - goal).T @ (points - middle))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, goal - turn @ middle
    return pose
