"""The shape model of a result as a surface that moves, and preliminary ones of a run in progress."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from homolog.arrays import Array, Float32Array, FloatArray, IntArray, frozen
from homolog.errors import InputError
from homolog.geometry import scale_of
from homolog.io.project import ProjectFolder
from homolog.io.results import Result, read_result
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import Method
from homolog.statistics.parallel import ParallelAnalysis, parallel_analysis
from homolog.statistics.reconstruction import warp_surface
from homolog.statistics.shape_model import ShapeModel
from homolog.statistics.thin_plate import farthest_points
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.colours import common_limit

__all__ = [
    "ModelShape",
    "PreliminaryModel",
    "RigidModes",
    "facing",
    "fit_model_shape",
    "placement",
    "read_model_shape",
]


_ARROWS = 240
_METHODS = {Method.GEODESIC_NORMALS: "geodesics and normals", Method.EUCLIDEAN: "Euclidean"}
_LIMIT_AT = 2.0
"""Limit of the colour scale in standard deviations of the first mode."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidModes:
    """Modes along which each of S structures only turns and moves. Arrays are read-only.

    Attributes
    ----------
    turns, shifts : (K, S, 3) arrays
        Rotation vector [rad] and translation [mm] of each structure for one standard deviation of a mode.
    centres : (S, 3) array
        Centres of the rotations [mm].
    """

    turns: FloatArray
    shifts: FloatArray
    centres: FloatArray

    @classmethod
    def of(cls, model: ShapeModel, result: Result) -> "RigidModes":
        """Return the rigid motions that equal a model's modes to first order."""
        turns, shifts, centres = [], [], []
        moves = model.components_ * model.standard_deviations_[:, None, None]
        for part in result.parts:
            points = model.mean_[part.particles]
            centre, own = points.mean(axis=0), moves[:, part.particles]
            away = points - centre
            inertia = np.square(away).sum() * np.eye(3) - away.T @ away
            turns.append(np.linalg.solve(inertia, np.cross(away, own).sum(axis=1).T).T)
            shifts.append(own.mean(axis=1))
            centres.append(centre)
        return cls(np.stack(turns, axis=1), np.stack(shifts, axis=1), np.array(centres))

    def to_first_order(self, points: Array, parts: Sequence[slice]) -> Float32Array:
        """Return displacements (K, n, 3) for one standard deviation [mm], linear as those of shapes."""
        moves = np.empty((len(self.turns), *points.shape), dtype=np.float32)
        for place, part in enumerate(parts):
            away = points[part] - self.centres[place]
            moves[:, part] = np.cross(self.turns[:, place, None], away) + self.shifts[:, place, None]
        return moves

    def moved(self, points: Array, parts: Sequence[slice], deviations: FloatArray) -> FloatArray:
        """Return points (n, 3), those of the structures one after another, at deviations (k,) [SD]."""
        count = len(deviations)
        turns, shifts = (np.tensordot(deviations, way[:count], 1) for way in (self.turns, self.shifts))
        moved = np.array(points, dtype=np.float64)
        for part, turn, shift, centre in zip(parts, turns, shifts, self.centres, strict=True):
            moved[part] = Rotation.from_rotvec(turn).apply(moved[part] - centre) + centre + shift
        return moved


@dataclass(frozen=True, slots=True, eq=False)
class ModelShape:
    """The mean surface of a result and its displacement by the modes. Arrays are read-only.

    Attributes
    ----------
    name : str
        Name of the project.
    method : Method
        The method that placed the particles.
    result : Result
    model : ShapeModel
    parallel : ParallelAnalysis
        The retained modes.
    mean : TriangleMesh
        The mean surface, V vertices.
    mean_normals : (V, 3) float32 array
        Unit normals of the mean surface.
    moves : (K, 3 V) float32 array
        Displacement of the vertices for one standard deviation of each mode [mm].
    faces : (3, F) int array
        First, second and third corner of each face.
    corners : (V, F) sparse float32 array
        One where a vertex is a corner of a face; the matrix sums face normals at vertices.
    arrows_at : (A,) int array
        Vertices where arrows are drawn, evenly spread.
    limit : float
        End of the colour scale of displacements [mm].
    rigid : RigidModes or None
        The modes of relative pose, which move whole structures.
    """

    name: str
    method: Method
    result: Result
    model: ShapeModel
    parallel: ParallelAnalysis
    mean: TriangleMesh
    mean_normals: Float32Array
    moves: Float32Array
    faces: IntArray
    corners: "sparse.csr_array"
    arrows_at: IntArray
    limit: float
    rigid: RigidModes | None = None

    @property
    def modes(self) -> int:
        """Number of modes."""
        return len(self.moves)

    @property
    def title(self) -> str:
        """The project, for captions."""
        return f"{self.name} ({self.result.mirrored} mirrored)" if self.result.mirrored else self.name

    def title_among(self, models: "Sequence[ModelShape]") -> str:
        """Return the title; with the method, if another model is compared."""
        method = _METHODS.get(self.method, self.method.value.replace("-", " "))
        return f"{self.title} ({method})" if len(models) > 1 else self.title

    def moved(self, deviations: FloatArray) -> Float32Array:
        """Return displacements from the mean (V, 3) [mm] at multiples (k,) of the modes' deviations."""
        if self.rigid is not None:
            parts = [part.vertices for part in self.result.parts]
            away = self.rigid.moved(self.mean.vertices, parts, deviations) - self.mean.vertices
            return np.asarray(away, dtype=np.float32)
        # Without BLAS: waking its threads would take longer than this small product.
        amounts = np.asarray(deviations, dtype=np.float32)
        flat: Float32Array = np.einsum("k,kv->v", amounts, self.moves[: len(amounts)])
        return flat.reshape(-1, 3)

    def particles(self, deviations: FloatArray) -> FloatArray:
        """Return the particles (N, 3) [mm] at multiples (k,) of the modes' deviations."""
        if self.rigid is None:
            return self.model.instance(deviations)
        return self.rigid.moved(self.model.mean_, [part.particles for part in self.result.parts], deviations)

    def distances_along(self, mode: int, amounts: FloatArray, pair: tuple[int, int]) -> FloatArray:
        """Return the distances (n,) [mm] of two particles at positions (n,) [SD] along a mode."""
        steps = [self.particles(amount * np.eye(mode + 1)[mode])[list(pair)] for amount in amounts]
        return np.asarray([np.linalg.norm(second - first) for first, second in steps])

    def outward(self, displacement: Array) -> Float32Array:
        """Return the part of displacements (V, 3) along the mean's outward normals [mm], shape (V,)."""
        part: Float32Array = np.einsum("vi,vi->v", displacement, self.mean_normals)
        return part

    def normals(self, vertices: Array) -> Float32Array:
        """Return outward unit normals (V, 3) of the surface with these vertices (V, 3)."""
        return _normals(vertices, self.faces, self.corners)

    def carried(self, displacements: FloatArray) -> Float32Array:
        """Return displacements of the vertices (m, V, 3) for those of the particles (m, N, 3) [mm].

        This is slow, because it solves the spline.
        """
        return _carried(self.result, displacements)


def read_model_shape(folder_name: str, project: ProjectFolder, tick: Tick) -> ModelShape:
    """Read a project's result and fit its model.

    Raises
    ------
    InputError
        If the folder is not a project, or has no result.
    """
    tick(0.0, f"reading {folder_name}")
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result yet; run it first")
    result, method = read_result(project), record.settings.optimize.method
    return fit_model_shape(folder_name, method, result, part_of(tick, 0.2, 1.0))


def fit_model_shape(
    name: str, method: Method, result: Result, tick: Tick = no_tick, *, rigid: bool = False
) -> ModelShape:
    """Fit the shape model of a result, and map its modes to the mean surface.

    Parameters
    ----------
    name, method
        See `ModelShape`.
    result : Result
    tick : Tick
        Progress and cancellation.
    rigid : bool
        Whether the modes are those of relative pose.
    """
    import homolog_app.plots  # noqa: F401 - slow: imported by the thread that fits, not by the first plot

    model = ShapeModel().fit(result.world, names=result.names)
    parallel = parallel_analysis(result.world, tick=part_of(tick, 0.0, 0.6))
    tick(0.6, "mapping the modes to the mean surface")
    mesh = result.mean_surface
    motions = RigidModes.of(model, result) if rigid else None
    if motions is None:
        moves = _carried(result, model.components_ * model.standard_deviations_[:, None, None])
    else:
        moves = motions.to_first_order(mesh.vertices, [part.vertices for part in result.parts])
    tick(0.9, "normals of the mean surface")
    corners = _corners(mesh.faces, len(mesh.vertices))
    faces = np.ascontiguousarray(mesh.faces.T, dtype=np.intp)
    normals = _normals(mesh.vertices.astype(np.float32), faces, corners)
    leading = _LIMIT_AT * np.einsum("kvi,vi->kv", moves[: max(1, parallel.n_retained)], normals)
    return ModelShape(
        name=name,
        method=method,
        result=result,
        model=model,
        parallel=parallel,
        mean=mesh,
        mean_normals=frozen(normals),
        moves=frozen(moves.reshape(len(moves), -1)),
        faces=frozen(faces),
        corners=corners,
        arrows_at=farthest_points(mesh.vertices, _ARROWS),
        limit=common_limit([max(leading, key=lambda displacement: float(np.abs(displacement).max()))]),
        rigid=motions,
    )


def facing(of: ModelShape, beside: ModelShape) -> ModelShape:
    """Return a model with the signs of its modes matched to another's (signs are arbitrary).

    Signs follow from the scores of common subjects; further modes are not changed.
    """
    pairs = [
        (index, beside.result.names.index(name))
        for index, name in enumerate(of.result.names)
        if name in beside.result.names
    ]
    if not pairs:
        return of
    mine, theirs = (list(indices) for indices in zip(*pairs, strict=True))
    signs = np.ones(of.modes)
    shared = min(of.modes, beside.modes)
    products = of.model.scores_[mine][:, :shared] * beside.model.scores_[theirs][:, :shared]
    signs[:shared] = np.where(products.sum(axis=0) < 0.0, -1.0, 1.0)
    before = of.model
    model = ShapeModel.from_arrays(
        before.mean_,
        before.components_ * signs[:, None, None],
        before.explained_variance_,
        before.scores_ * signs,
        before.explained_variance_ratio_,
    )
    moves = frozen(of.moves * signs[:, None], np.float32)
    return replace(of, model=model, moves=moves, rigid=of.rigid and RigidModes.of(model, of.result))


def placement(of: ModelShape, beside: ModelShape) -> FloatArray:
    """Return the rigid motion (4, 4) that aligns a model with another by their common subjects.

    The identity if they have no subject in common.
    """
    for index, name in enumerate(of.result.names):
        if name in beside.result.names:
            alignment = beside.result.alignments[beside.result.names.index(name)]
            motion = alignment @ np.linalg.inv(of.result.alignments[index])
            motion[:3, :3] /= scale_of(motion)
            return np.asarray(motion)
    return np.eye(4)


def _carried(result: Result, displacements: FloatArray) -> Float32Array:
    mean, vertices = result.world.mean(axis=0), result.mean_surface.vertices
    return warp_surface(mean, vertices, displacements, result.smoothing, result.pieces).astype(np.float32)


def _corners(faces: IntArray, vertices: int) -> "sparse.csr_array":
    rows, columns = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
    ones = np.ones(len(rows), dtype=np.float32)
    return sparse.csr_array((ones, (rows, columns)), shape=(vertices, len(faces)))


def _normals(vertices: Array, faces: IntArray, corners: "sparse.csr_array") -> Float32Array:
    a, b, c = (vertices.take(corner, axis=0) for corner in faces)
    side, other = b - a, c - a
    across = np.empty_like(a)
    for axis, (left, right) in enumerate(((1, 2), (2, 0), (0, 1))):
        across[:, axis] = side[:, left] * other[:, right] - side[:, right] * other[:, left]
    sums: Float32Array = corners @ across
    sums /= np.maximum(np.sqrt(np.einsum("vi,vi->v", sums, sums)), 1e-30)[:, None]
    return sums


@dataclass(frozen=True, slots=True, eq=False)
class PreliminaryModel:
    """A shape model of a run that has not finished.

    Attributes
    ----------
    shape : ModelShape
    particles, wanted : int
        Numbers of particles on each shape, now and at the end of the run.
    iteration : int
    """

    shape: "ModelShape"
    particles: int
    wanted: int
    iteration: int

    @property
    def description(self) -> str:
        """The progress of the run."""
        return f"preliminary: {self.particles} of {self.wanted} particles, iteration {self.iteration}"
