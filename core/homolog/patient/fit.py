"""A robust fit of a model to one surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.geometry import inverse_matrices, rotation_of, transform_points
from homolog.patient.mesh_graph import remove_spikes
from homolog.patient.surface_model import SurfaceModel
from homolog.patient.target import Target
from homolog.progress import Tick, no_tick
from homolog.registration.icp import oriented_points, registered
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import normals_at

__all__ = ["CutEnd", "SurfaceFit", "fit_surface"]

_ROUNDS = 40
_SETTLED = 0.002
"""Root mean square change of the model's points at which the fit ends, relative to the residual."""
_TOLERANT = 2.0
"""Multiple of the median residual beyond which vertices have little weight (Geman and McClure 1987)."""
_INDEPENDENT = 200.0
"""Number of independent measurements in a surface: residuals of neighbouring vertices are correlated."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit:
    """Fit of a model to a surface; arrays are read-only.

    Attributes
    ----------
    pose : (4, 4) array
        Rigid motion from the surface's frame to the model's.
    scores : (K,) array
        Scores in the modes [mm].
    expected : (P, 3) array
        The model's approximation of the shape: vertices, then particles, in the model's frame [mm].
    residual : (V,) array
        Distance of the surface from the expected one along its normals [mm], outward positive.
    met : (V,) bool array
        Whether the line along the normal meets the surface; otherwise a part is missing or too far away.
    weights : (V,) array
        Weight of each vertex in the fit, in [0, 1].
    particles : (N, 3) array
        Particles on the surface, in its own frame [mm].
    registered : (N, 3) array
        Particles of the mean, mapped to the surface by rigid registration alone, in the same frame [mm].
    """

    pose: FloatArray
    scores: FloatArray
    expected: FloatArray
    residual: FloatArray
    met: BoolArray
    weights: FloatArray
    particles: FloatArray
    registered: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class CutEnd:
    """A flat end of a surface, where the border of its image cuts the shape off.

    Attributes
    ----------
    direction : (3,) array
        Unit vector out of the image, in the surface's frame.
    height : float
        Outward extent of the surface [mm].
    depth : float
        Depth to which grooming rounds its rim [mm].
    cap : (n,) bool array
        The surface's vertices on the border.
    """

    direction: FloatArray
    height: float
    depth: float
    cap: BoolArray

    def beyond(self, points: FloatArray, inward: float = 0.0) -> BoolArray:
        """Return which points (n, 3) lie outside the image, or inside by at most `inward` [mm]."""
        outside: BoolArray = points @ self.direction > self.height - inward
        return outside


def fit_surface(
    model: SurfaceModel,
    mesh: TriangleMesh,
    coarse: TriangleMesh,
    columns: FloatArray,
    tick: Tick = no_tick,
    *,
    pose: FloatArray | None = None,
    ends: Sequence[CutEnd] = (),
) -> SurfaceFit:
    """Fit a model to a surface by pose and modes, with little weight on outliers.

    Two steps alternate: closest points in position and normal, and the maximum a posteriori pose and scores
    from point-to-plane distances with the weights of Geman and McClure (1987).

    Parameters
    ----------
    model : SurfaceModel
    mesh, coarse : TriangleMesh
        The groomed surface [mm], and the same surface with few vertices for the initial registration.
    columns : (c,) array
        The subject's standardised covariates.
    tick : Tick
    pose : (4, 4) array, optional
        Initial rigid motion to the model's frame; by default from registration.
    ends : sequence of CutEnd
        Ends at which the surface is cut off; the fit ignores them and everything beyond.

    Returns
    -------
    SurfaceFit
    """
    tick(0.0, "aligning")
    target, shape = Target(mesh), model.expected(columns)
    areas = model.surface(shape).vertex_areas
    share = _INDEPENDENT * areas / areas.sum()
    pose = first_pose(model.surface(shape), coarse) if pose is None else pose
    first = _on_surface(model, target, pose, shape)
    scores = np.zeros(len(model.variances))
    weights = np.ones(model.vertices)
    points = shape
    for number in range(_ROUNDS):
        tick(number / (_ROUNDS + 5), "fitting")
        normals = model.surface(points).vertex_normals
        local = transform_points(inverse_matrices(pose), points[: model.vertices])
        nearest = target.nearest(local, normals @ pose[:3, :3])[1]
        goals = transform_points(pose, target.points[nearest])
        planes = target.normals[nearest] @ pose[:3, :3].T
        apart = np.einsum("vi,vi->v", goals - points[: model.vertices], planes)
        weights = _robust(apart / model.residual)
        for end in ends:
            weights = np.where(end.cap[nearest] | end.beyond(local), 0.0, weights)
        turn, shift, change = _step(
            model, goals, planes, apart, share * weights / np.square(model.residual), scores
        )
        scores = scores + change
        pose = _moved(pose, turn, shift, goals.mean(axis=0))
        before, points = points, shape + np.tensordot(scores, model.components, axes=1)
        moved = np.linalg.norm(turn) * target.size + np.linalg.norm(shift)
        moved += float(np.sqrt(np.square(points - before).sum(axis=1).mean()))
        if moved < _SETTLED * float(model.residual.mean()):
            break
    return _measured(model, target, pose, scores, points, weights, first)


def first_pose(surface: TriangleMesh, coarse: TriangleMesh) -> FloatArray:
    """Return a coarse rigid motion (4, 4) of a surface to another, from any orientation."""
    moving, fixed = oriented_points(coarse), oriented_points(surface)
    pose = registered(moving.scaled(1.0 / moving.size), fixed.scaled(1.0 / fixed.size)).pose
    result = np.eye(4)
    result[:3, :3] = rotation_of(pose)
    result[:3, 3] = fixed.centre + fixed.size * pose[:3, 3] - result[:3, :3] @ moving.centre
    return result


def _robust(ratios: FloatArray) -> FloatArray:
    """Return robust weights of residuals relative to their scale."""
    scale = max(float(np.median(np.abs(ratios))) / 0.6745, 1.0)
    weights: FloatArray = 1.0 / np.square(1.0 + np.square(ratios / (_TOLERANT * scale)))
    return weights


def _step(
    model: SurfaceModel,
    goals: FloatArray,
    planes: FloatArray,
    apart: FloatArray,
    weights: FloatArray,
    scores: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the turn (3,), shift (3,) of the goals and change of scores (K,) of one Gauss-Newton step."""
    centred = goals - goals.mean(axis=0)
    normal_part = np.einsum("kvi,vi->vk", model.components[:, : model.vertices], planes)
    columns = np.hstack([np.cross(centred, planes), planes, -normal_part])
    weighted = columns * weights[:, None]
    matrix = columns.T @ weighted
    right = -weighted.T @ apart
    prior = np.arange(len(scores)) + 6
    matrix[prior, prior] += 1.0 / model.variances
    right[6:] -= scores / model.variances
    matrix[np.arange(6), np.arange(6)] += 1e-9 * np.trace(matrix[:6, :6])  # for spheres, which rotate freely
    change: FloatArray = np.asarray(np.linalg.solve(matrix, right), np.float64)
    return change[:3], change[3:6], change[6:]


def _moved(pose: FloatArray, turn: FloatArray, shift: FloatArray, centre: FloatArray) -> FloatArray:
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    step[:3, 3] = centre + shift - step[:3, :3] @ centre
    result: FloatArray = step @ pose
    return result


def _measured(
    model: SurfaceModel,
    target: Target,
    pose: FloatArray,
    scores: FloatArray,
    points: FloatArray,
    weights: FloatArray,
    first: FloatArray,
) -> SurfaceFit:
    """Measure residuals, and project the particles onto the surface."""
    surface = model.surface(points)
    normals = surface.vertex_normals
    back = inverse_matrices(pose)
    local = transform_points(back, points)
    own = normals @ pose[:3, :3]
    residual, met = target.along_normals(local[: model.vertices], own)
    residual = remove_spikes(residual, model.faces, surface.mean_edge)
    particles = local[model.vertices :]
    above = normals_at(surface, points[model.vertices :]) @ pose[:3, :3]
    far, _ = target.along_normals(particles, above)
    particles = particles + far[:, None] * above
    nearest = target.nearest(particles, above)[1]
    planes = target.normals[nearest]
    off = np.einsum("ni,ni->n", particles - target.points[nearest], planes)
    particles = particles - off[:, None] * planes
    return SurfaceFit(pose, scores, points, residual, met, weights, particles, first)


def _on_surface(model: SurfaceModel, target: Target, pose: FloatArray, points: FloatArray) -> FloatArray:
    """Return the surface's vertices nearest to particles in position and normal (N, 3)."""
    surface, particles = model.surface(points), points[model.vertices :]
    normals = normals_at(surface, particles)
    return target.points[
        target.nearest(transform_points(inverse_matrices(pose), particles), normals @ pose[:3, :3])[1]
    ]
