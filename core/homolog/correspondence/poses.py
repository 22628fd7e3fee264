"""Similarities that bring corresponding points onto each other."""

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.dual import covariance, inverse_dual

__all__ = [
    "best_similarity",
    "entropic",
    "generalized",
    "inverted",
    "onto_mean",
    "procrustes",
    "rescaled",
    "scales_of",
    "transformed",
]

SWEEPS = 3  # over the shapes, of poses by entropy
TOLERANT = 49.0  # times the median squared distance: from where on a particle counts little
ROUNDS, STILL = 100, 1e-9  # of generalized Procrustes analysis: at most, and when the mean has come to rest


def transformed(matrices: FloatArray, points: FloatArray) -> FloatArray:
    """Return the points (M, n, 3) of each shape mapped by its own (4, 4) matrix."""
    turned = [one @ matrix[:3, :3].T for one, matrix in zip(points, matrices, strict=True)]
    result: FloatArray = np.stack(turned) + matrices[:, None, :3, 3]
    return result


def inverted(matrices: FloatArray) -> FloatArray:
    """Return the inverses of (M, 4, 4) matrices."""
    inverses: FloatArray = np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    return inverses


def best_similarity(points: FloatArray, targets: FloatArray, *, scaling: bool) -> FloatArray:
    """Return the similarity of points to targets with least squares (Umeyama 1991), shape (4, 4).

    Parameters
    ----------
    points, targets : (n, 3) arrays
        Corresponding positions.
    scaling : bool
        Whether the size may change; otherwise the motion is rigid. Reflections are not allowed.
    """
    middle, goal = points.mean(axis=0), targets.mean(axis=0)
    own = points - middle
    u, values, vt = np.linalg.svd((targets - goal).T @ own)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float(values @ signs / np.square(own).sum()) if scaling else 1.0
    result = np.eye(4)
    result[:3, :3] = scale * (u * signs) @ vt
    result[:3, 3] = goal - result[:3, :3] @ middle
    return result


def scales_of(matrices: FloatArray) -> FloatArray:
    """Return the scales of (M, 4, 4) similarities, (M,)."""
    scales: FloatArray = np.cbrt(np.linalg.det(matrices[:, :3, :3]))
    return scales


def rescaled(matrices: FloatArray, scales: FloatArray, middles: FloatArray) -> FloatArray:
    """Return similarities (M, 4, 4) followed by a growth about a point each, (M, 3), to the given scales."""
    growth = (scales / scales_of(matrices))[:, None]
    result = matrices.copy()
    result[:, :3, :3] *= growth[:, None]
    result[:, :3, 3] = middles + growth * (result[:, :3, 3] - middles)
    return result


def generalized(points: FloatArray, poses: FloatArray, *, scaling: bool) -> FloatArray:
    """Return the poses of generalized Procrustes analysis (Gower 1975), which bring all shapes to their mean.

    Parameters
    ----------
    points : (M, n, 3) array
        Corresponding points of each shape, not posed.
    poses : (M, 4, 4) array
        Similarities to begin with. As a whole the shapes stay where these put them.
    scaling : bool
        Whether sizes are taken out too, to their geometric mean under these poses; otherwise every shape
        keeps its scale.

    Returns
    -------
    (M, 4, 4) float64 array
    """
    begin, scales = transformed(poses, points), scales_of(poses)
    arms = begin - begin.mean(axis=1, keepdims=True)
    sizes = np.sqrt(np.square(arms).sum(axis=(1, 2)))
    common = float(np.exp(np.log(sizes).mean()))
    if scaling:
        scales, arms = scales * common / sizes, arms * (common / sizes)[:, None, None]
    target = arms.mean(axis=0)
    for _ in range(ROUNDS):
        arms = np.stack([one @ _turn(one, target).T for one in arms])
        before, target = target, arms.mean(axis=0)
        if np.sqrt(np.square(target - before).sum()) < STILL * common:
            break
    middle = begin.mean(axis=(0, 1))
    target = target @ _turn(target, begin.mean(axis=0) - middle).T + middle
    found = np.stack([best_similarity(one, target, scaling=True) for one in points])
    return rescaled(found, scales, np.tile(middle, (len(points), 1)))


def onto_mean(points: FloatArray, poses: FloatArray, free: BoolArray, *, scaling: bool) -> FloatArray:
    """Return poses of which the free ones bring their shapes to the mean of the others, which stay.

    Parameters
    ----------
    points : (M, n, 3) array
        Corresponding points of each shape, not posed.
    poses : (M, 4, 4) array
    free : (M,) bool array
        Not all of them.
    scaling : bool
        Whether the free ones change their scale too.
    """
    mean = transformed(poses[~free], points[~free]).mean(axis=0)
    result = poses.copy()
    for k in np.flatnonzero(free).tolist():
        result[k] = best_similarity(points[k], mean, scaling=True)
    if not scaling:
        result[free] = rescaled(
            result[free], scales_of(poses[free]), np.tile(mean.mean(axis=0), (free.sum(), 1))
        )
    return result


def procrustes(
    points: FloatArray,
    normals: FloatArray,
    poses: FloatArray,
    free: BoolArray,
    *,
    scaling: bool,
    sliding: float = 1.0,
) -> FloatArray:
    """Return poses nearer to those of generalized Procrustes analysis (Gower 1975): one round of it.

    Parameters
    ----------
    points, normals : (M, n, 3) arrays
        Particles and unit normals of each shape, as posed.
    poses : (M, 4, 4) array
        The similarities that posed them.
    free : (M,) bool array
        Shapes whose pose may change. Where some may not, the others are brought to the mean of those.
    scaling : bool
        Whether sizes are taken out too; the geometric mean of the scales is then 1.
    sliding : float
        How much the part of a particle's distance from its mean counts that lies in the mean tangent plane:
        1 for Procrustes analysis; less where particles are still to slide over their surfaces, as a turned
        shape with particles that turned with it would keep its pose for long (Chen and Medioni 1992).

    Notes
    -----
    Particles much farther from their mean than the shape's others count little (Geman and McClure 1987): a
    part that varies by itself, such as a slot that wanders, does not turn the rest.

    Returns
    -------
    (M, 4, 4) float64 array
    """
    known = free if free.all() else ~free
    mean, upward = points[known].mean(axis=0), normals[known].sum(axis=0)
    upward /= np.maximum(np.linalg.norm(upward, axis=1, keepdims=True), 1e-12)
    weights = (1.0 - sliding) * upward[:, :, None] * upward[:, None, :] + sliding * np.eye(3)
    result = poses.copy()
    for k in np.flatnonzero(free).tolist():
        away = points[k] - mean
        heeded = _heeded(np.einsum("ni,nij,nj->n", away, weights, away))
        result[k] = _nearer(points[k], mean, heeded[:, None, None] * weights, scaling) @ poses[k]
    if scaling and free.all():
        grown = float(np.exp(np.mean(np.log(np.linalg.det(result[:, :3, :3])))) ** (1.0 / 3.0))
        middle = mean.mean(axis=0)
        result[:, :3, :3] /= grown
        result[:, :3, 3] = middle + (result[:, :3, 3] - middle) / grown
    return result


def entropic(
    points: FloatArray, poses: FloatArray, free: BoolArray, *, scaling: bool, regularization: float
) -> FloatArray:
    """Return poses under which the ensemble's entropy H(Z) is lower: Newton's method, shape by shape.

    For a large regularization these are rounds of generalized Procrustes analysis, which minimises the trace
    of the covariance; for a small one poses heed what few modes do not explain, so that a part that varies
    by itself does not turn the rest. Particles much farther away than the shape's others count little, as in
    `procrustes`.

    Parameters
    ----------
    points : (M, n, 3) array
        Particles of each shape, as posed.
    poses : (M, 4, 4) array
        The similarities that posed them.
    free : (M,) bool array
        Shapes whose pose may change.
    scaling : bool
        Whether sizes are taken out too; the geometric mean of the scales then stays, if all are free.
    regularization : float
        The a of H(Z), a squared length.

    Returns
    -------
    (M, 4, 4) float64 array
    """
    points, result = points.copy(), poses.copy()
    shapes = len(points)
    for _ in range(SWEEPS):
        rows = (points - points.mean(axis=0)).reshape(shapes, -1)
        weights = inverse_dual(covariance(rows), regularization)
        for k in np.flatnonzero(free).tolist():
            pull = np.einsum("m,mni->ni", weights[k], points) / weights[k, k]
            heeded = _heeded(np.square(pull).sum(axis=1))[:, None, None] * np.eye(3)
            step = _nearer(points[k], points[k] - pull, heeded, scaling)
            points[k] = transformed(step[None], points[k : k + 1])[0]
            result[k] = step @ result[k]
    if scaling and free.all():
        middle = points.mean(axis=(0, 1))
        scales = scales_of(result)
        result = rescaled(
            result, scales * np.exp(np.log(scales_of(poses) / scales).mean()), np.tile(middle, (shapes, 1))
        )
    return result


def _nearer(points: FloatArray, targets: FloatArray, weights: FloatArray, scaling: bool) -> FloatArray:
    """Return the similarity that, to first order, brings points to targets under (n, 3, 3) weights."""
    middle = points.mean(axis=0)
    arms = points - middle
    by_pose = np.zeros((len(points), 3, 7))  # derivative of the points by turn, shift and growth
    for axis in range(3):
        by_pose[:, :, axis] = np.cross(np.eye(3)[axis], arms)
    by_pose[:, :, 3:6] = np.eye(3)
    by_pose[:, :, 6] = arms
    by_pose = by_pose[:, :, : 7 if scaling else 6]
    weighted = np.einsum("nia,nij->naj", by_pose, weights)
    matrix = np.einsum("nai,nib->ab", weighted, by_pose)
    change = np.linalg.solve(matrix, np.einsum("nai,ni->a", weighted, targets - points))
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix() * (np.exp(change[6]) if scaling else 1.0)
    result[:3, 3] = middle + change[3:6] - result[:3, :3] @ middle
    return result


def _heeded(squares: FloatArray) -> FloatArray:
    """Return how much particles count by their squared distances (Geman and McClure 1987), (n,)."""
    usual = TOLERANT * max(float(np.median(squares)), 1e-12)
    weights: FloatArray = 1.0 / np.square(1.0 + squares / usual)
    return weights


def _turn(points: FloatArray, target: FloatArray) -> FloatArray:
    """Return the rotation of centred points to a centred target with least squares (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(target.T @ points)
    turn: FloatArray = (u * [1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn
