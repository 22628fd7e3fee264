"""Similarities that align corresponding points."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.geometry import fit_rotation, fit_similarity, scale_of, transform_points
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "OUTLIER_RATIO",
    "align_to_mean",
    "alignments_of_particles",
    "blocks",
    "even_steps",
    "generalized_procrustes",
    "largest_turn",
    "posed_meshes",
    "poses_of_particles",
    "procrustes_step",
    "rescale",
    "robust_step",
]

BLOCK = 32  # shapes moved by one product
OUTLIER_RATIO = 49.0  # of squared distances to their median, at which a particle's weight is a quarter
MAX_ROUNDS, CONVERGENCE = 100, 1e-9  # of generalized Procrustes analysis: rounds, motion of the mean


def largest_turn(matrices: FloatArray) -> float:
    """Return the largest angle [rad] by which any of (M, 4, 4) similarities turns."""
    linear = matrices[:, :3, :3] / scale_of(matrices)[:, None, None]
    return float(Rotation.from_matrix(linear).magnitude().max())


def posed_meshes(meshes: Sequence[TriangleMesh], poses: FloatArray) -> list[TriangleMesh]:
    """Return meshes moved by their poses (M, 4, 4)."""
    pairs = zip(meshes, poses, strict=True)
    return [TriangleMesh(transform_points(pose, mesh.vertices), mesh.faces) for mesh, pose in pairs]


def poses_of_particles(
    points: FloatArray, poses: FloatArray, free: BoolArray, *, scaling: bool
) -> FloatArray:
    """Return poses that align corresponding points (M, n, 3) of all shapes, or of the free to the fixed ones.

    Fixed shapes are aligned to their own mean first.
    """
    if free.all():
        return generalized_procrustes(points, poses, scaling=scaling)
    result = poses.copy()
    result[~free] = generalized_procrustes(points[~free], poses[~free], scaling=scaling)
    return align_to_mean(points, result, free, scaling=scaling)


def alignments_of_particles(
    local: FloatArray, alignments: FloatArray, poses: FloatArray, free: BoolArray, *, scaling: bool
) -> FloatArray:
    """Return the similarities of a result from file to world coordinates, (M, 4, 4).

    Parameters
    ----------
    local : (M, n, 3) array
        Particles in the coordinates of the files.
    alignments : (M, 4, 4) array
        Similarities that the run began with. Shapes that are not free keep theirs.
    poses : (M, 4, 4) array
        Similarities of the free shapes at the end of the run, if all are free.
    free : (M,) bool array
    scaling : bool
        Whether the sizes are taken out; otherwise the scales of `alignments` are kept.
    """
    if not free.all():
        return align_to_mean(local, alignments, free, scaling=scaling)
    if not scaling:
        poses = rescale(poses, scale_of(alignments), transform_points(poses, local).mean(axis=1))
    return generalized_procrustes(local, poses, scaling=scaling)


def rescale(matrices: FloatArray, scales: FloatArray, centres: FloatArray) -> FloatArray:
    """Return similarities with other scales.

    Parameters
    ----------
    matrices : (M, 4, 4) array
        Similarities.
    scales : (M,) array
        Their new scales.
    centres : (M, 3) array
        Points that stay where the similarities map them.

    Returns
    -------
    (M, 4, 4) array
    """
    growth = (scales / scale_of(matrices))[:, None]
    result = matrices.copy()
    result[:, :3, :3] *= growth[:, None]
    result[:, :3, 3] = centres + growth * (result[:, :3, 3] - centres)
    return result


def generalized_procrustes(points: FloatArray, poses: FloatArray, *, scaling: bool) -> FloatArray:
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
    initial, scales = transform_points(poses, points), scale_of(poses)
    centred = initial - initial.mean(axis=1, keepdims=True)
    sizes = np.sqrt(np.square(centred).sum(axis=(1, 2)))
    common = float(np.exp(np.log(sizes).mean()))
    if scaling:
        scales, centred = scales * common / sizes, centred * (common / sizes)[:, None, None]
    target = centred.mean(axis=0)
    for _ in range(MAX_ROUNDS):
        centred = np.stack([shape @ _rotation(shape, target).T for shape in centred])
        before, target = target, centred.mean(axis=0)
        if np.sqrt(np.square(target - before).sum()) < CONVERGENCE * common:
            break
    centre = initial.mean(axis=(0, 1))
    target = target @ _rotation(target, initial.mean(axis=0) - centre).T + centre
    fitted = np.stack([fit_similarity(shape, target, scaling=True) for shape in points])
    return rescale(fitted, scales, np.tile(centre, (len(points), 1)))


def align_to_mean(points: FloatArray, poses: FloatArray, free: BoolArray, *, scaling: bool) -> FloatArray:
    """Return poses that align the free shapes to the mean of the fixed ones.

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
    mean = transform_points(poses[~free], points[~free]).mean(axis=0)
    result = poses.copy()
    for k in np.flatnonzero(free).tolist():
        result[k] = fit_similarity(points[k], mean, scaling=True)
    if not scaling:
        result[free] = rescale(
            result[free], scale_of(poses[free]), np.tile(mean.mean(axis=0), (int(free.sum()), 1))
        )
    return result


def procrustes_step(
    points: FloatArray,
    normals: FloatArray,
    poses: FloatArray,
    free: BoolArray,
    *,
    scaling: bool,
    tangential_weight: float = 1.0,
) -> FloatArray:
    """Return poses after one iteration of robust generalized Procrustes analysis (Gower 1975).

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
    tangential_weight : float
        Weight of the tangential part of a particle's distance from its mean: 1 for Procrustes analysis; less
        while particles still slide over their surfaces, as a rotated shape whose particles rotated with it
        would keep its pose for long (Chen and Medioni 1992).

    Notes
    -----
    Particles much farther from their mean than the shape's others have little weight (Geman and McClure
    1987): a part that varies independently, such as a slot that wanders, does not rotate the rest.

    Returns
    -------
    (M, 4, 4) float64 array
    """
    known = free if free.all() else ~free
    mean, mean_normals = points[known].mean(axis=0), normals[known].sum(axis=0)
    mean_normals /= np.maximum(np.linalg.norm(mean_normals, axis=1, keepdims=True), 1e-12)
    result = poses.copy()
    for chosen in blocks(free, BLOCK):
        offsets = mean - points[chosen]
        along = np.einsum("mni,ni->mn", offsets, mean_normals)
        squares = tangential_weight * np.square(offsets).sum(axis=2) + (1.0 - tangential_weight) * along**2
        steps = _steps(
            points[chosen], offsets, _robust_weights(squares), scaling, mean_normals, tangential_weight
        )
        result[chosen] = steps @ poses[chosen]
    if scaling and free.all():
        mean_scale = float(np.exp(np.mean(np.log(np.linalg.det(result[:, :3, :3])))) ** (1.0 / 3.0))
        centre = mean.mean(axis=0)
        result[:, :3, :3] /= mean_scale
        result[:, :3, 3] = centre + (result[:, :3, 3] - centre) / mean_scale
    return result


def robust_step(points: FloatArray, targets: FloatArray, *, scaling: bool) -> FloatArray:
    """Return the similarity that aligns points (n, 3) to targets to first order, with robust weights."""
    step: FloatArray = even_steps(points[None], (targets - points)[None], scaling)[0]
    return step


def blocks(free: BoolArray, size: int) -> list[IntArray]:
    """Return the indices of free shapes in blocks of a size."""
    return np.split(np.flatnonzero(free), range(size, np.count_nonzero(free), size))


def even_steps(points: FloatArray, offsets: FloatArray, scaling: bool) -> FloatArray:
    """Return robust steps (see `_steps`) with equal weight in all directions."""
    return _steps(points, offsets, _robust_weights(np.square(offsets).sum(axis=2)), scaling)


def _steps(
    points: FloatArray,
    offsets: FloatArray,
    weights: FloatArray,
    scaling: bool,
    normals: FloatArray | None = None,
    tangential_weight: float = 1.0,
) -> FloatArray:
    """Return the similarities (B, 4, 4) that move points by offsets, to first order.

    Parameters
    ----------
    points, offsets : (B, n, 3) arrays
    weights : (B, n) array
        Of squared distances.
    scaling : bool
        Whether points may grow.
    normals : (n, 3) array, optional
        Directions that count fully.
    tangential_weight : float
        Of all other directions.

    Notes
    -----
    The normal equations follow from moments of the points, which takes a tenth of the time.
    """
    centre = points.mean(axis=1)
    centred = points - centre[:, None]
    weighted = weights[..., None] * centred
    turned = weighted.transpose(0, 2, 1)
    second, cross, first = turned @ centred, turned @ offsets, weighted.sum(axis=1)
    shift = (weights[:, None] @ offsets)[:, 0]
    matrix, right = np.zeros((len(points), 7, 7)), np.zeros((len(points), 7))
    matrix[:, :3, :3] = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    matrix[:, :3, 3:6] = np.cross(np.eye(3), first[:, None])
    matrix[:, 3:6, :3] = matrix[:, :3, 3:6].transpose(0, 2, 1)
    matrix[:, 3:6, 3:6] = weights.sum(axis=1)[:, None, None] * np.eye(3)
    matrix[:, 3:6, 6] = matrix[:, 6, 3:6] = first
    matrix[:, 6, 6] = np.trace(second, axis1=1, axis2=2)
    for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        right[:, axis] = cross[:, i, j] - cross[:, j, i]
    right[:, 3:6], right[:, 6] = shift, np.trace(cross, axis1=1, axis2=2)
    if normals is not None:
        matrix, right = tangential_weight * matrix, tangential_weight * right
        by_pose = np.empty((*points.shape[:2], 7))  # derivative along the normals by turn, shift and growth
        by_pose[..., :3], by_pose[..., 3:6] = np.cross(centred, normals), normals
        by_pose[..., 6] = np.einsum("mni,ni->mn", centred, normals)
        counted = ((1.0 - tangential_weight) * weights[..., None] * by_pose).transpose(0, 2, 1)
        matrix += counted @ by_pose
        right += (counted @ np.einsum("mni,ni->mn", offsets, normals)[..., None])[..., 0]
    size = 7 if scaling else 6
    change = np.linalg.solve(matrix[:, :size, :size], right[:, :size, None])[..., 0].astype(np.float64)
    result = np.tile(np.eye(4), (len(points), 1, 1))
    result[:, :3, :3] = Rotation.from_rotvec(change[:, :3]).as_matrix()
    if scaling:
        result[:, :3, :3] *= np.exp(change[:, 6])[:, None, None]
    result[:, :3, 3] = centre + change[:, 3:6] - (result[:, :3, :3] @ centre[..., None])[..., 0]
    return result


def _robust_weights(squares: FloatArray) -> FloatArray:
    """Return robust weights of particles from their squared distances (Geman and McClure 1987), (B, n)."""
    scale = OUTLIER_RATIO * np.maximum(np.median(squares, axis=1, keepdims=True), 1e-12)
    weights: FloatArray = 1.0 / np.square(1.0 + squares / scale)
    return weights


def _rotation(points: FloatArray, target: FloatArray) -> FloatArray:
    """Return the rotation of centred points to a centred target with least squares (Kabsch 1976)."""
    left, right, _ = fit_rotation(target.T @ points)
    rotation: FloatArray = left @ right
    return rotation
