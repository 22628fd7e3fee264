"""The particles on the device, and one iteration of the optimizer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import BoolArray, DeviceArray, Float32Array, FloatArray, IntArray
from homolog.correspondence import kernels, step_kernels
from homolog.correspondence.coupling import coupling
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.sampling import LIST_LIFE, REACH, Sampling
from homolog.correspondence.schedule import Weights
from homolog.correspondence.surfaces import Level, nearest_faces
from homolog.geodesics.kernels.lookup import SurfacePoint

__all__ = ["Engine", "Particles", "turns_of"]

NEWTON_STEPS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Particles:
    """What must be known of particles to go on with them (shapes as in `Checkpoint`)."""

    positions: Float32Array
    widths: Float32Array
    means: Float32Array
    faces: IntArray


_KNOBS: Any = kernels.Knobs
_POSE: Any = kernels.Pose


class Engine:
    """Positions of n particles on M shapes, and how they move.

    Parameters
    ----------
    fields, reliefs : wp.array of FieldData
        Distances and opening angles, one a shape.
    level : Level
        Meshes and tables to measure distances on.
    particles : Particles or (M, n, 3) array
        As saved by another engine, or positions near the surfaces in the optimizer's coordinates.
    geodesic : bool
        Distances from the level's tables, or straight lines.
    area : float
        Mean surface area in squared optimizer lengths.
    launcher : Launcher
        The device.
    poses : (M, 4, 4) array, optional
        Similarities under which the shapes are compared with each other; none if not given.
    movable : (M, n) bool array, optional
        Particles that may move; all if not given. The others' positions are taken as they are.
    """

    positions: DeviceArray
    means: DeviceArray
    faces: DeviceArray
    iteration: DeviceArray
    feet: DeviceArray
    normals: DeviceArray
    poses: FloatArray

    def __init__(
        self,
        fields: DeviceArray,
        reliefs: DeviceArray,
        level: Level,
        particles: Particles | FloatArray,
        *,
        geodesic: bool,
        area: float,
        launcher: Launcher,
        poses: FloatArray | None = None,
        movable: BoolArray | None = None,
    ) -> None:
        saved = particles if isinstance(particles, Particles) else None
        positions = particles.positions if isinstance(particles, Particles) else particles
        self.shapes, self.count = positions.shape[:2]
        self.fields, self.reliefs, self.level, self.launch = fields, reliefs, level, launcher
        self.total = self.shapes * self.count
        self.width = math.sqrt(area / (self.count * math.pi))
        self.layout = kernels.Layout()
        self.layout.per_shape, self.layout.shapes = self.count, self.shapes
        self.layout.geodesic = int(geodesic)
        self.layout.expected_width = self.width
        self.layout.reach = REACH * self.width
        self._allocate(positions)
        self.sampling = Sampling(level, self.layout, launcher)
        free = np.ones(self.total) if movable is None else movable.ravel()
        self.movable = wp.array(free, dtype=int, device=launcher.device)
        self.coupling = coupling(self.layout, self.movable, movable is not None, launcher)
        self.pose(np.tile(np.eye(4), (self.shapes, 1, 1)) if poses is None else poses)
        self._project(0 if saved is not None else NEWTON_STEPS)
        if saved is not None:
            self._restore(saved)
        else:
            self._start_walks()

    def _allocate(self, positions: FloatArray | Float32Array) -> None:
        total, make = self.total, {"device": self.launch.device}
        self.positions = wp.array(positions.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, **make)
        self.bends = wp.zeros(total, dtype=wp.mat33, **make)
        self.openings = wp.zeros(total, dtype=wp.vec4, **make)
        self.feet = wp.zeros(total, dtype=SurfacePoint, **make)
        vectors = [wp.zeros(total, dtype=wp.vec3, **make) for _ in range(6)]
        self.normals, self.centred, self.logs = vectors[:3]
        self.ensemble_part, self.normals_part, self.steps = vectors[3:]
        self.iteration = wp.zeros(1, dtype=int, **make)
        self._poses: DeviceArray = wp.zeros(self.shapes, dtype=kernels.Pose, **make)

    def _nearest_faces(self) -> IntArray:
        faces = []
        for parts in zip(self.level.meshes, self.host_positions(), self.host_normals(), strict=True):
            self.launch.breathe()
            faces.append(nearest_faces(*parts))
        return np.concatenate(faces)

    def _start_walks(self) -> None:
        self.faces = wp.array(self._nearest_faces(), dtype=int, device=self.launch.device)
        normals = self.posed_normals()
        mean = normals.sum(axis=0)
        short = np.linalg.norm(mean, axis=1) < 1e-3  # opposite normals: start from one shape's
        mean[short] = normals[0][short]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        self.means = wp.array(mean, dtype=wp.vec3, device=self.launch.device)

    def _restore(self, saved: Particles) -> None:
        make = {"device": self.launch.device}
        self.sampling.widths = wp.array(saved.widths.ravel(), dtype=float, **make)
        self.means = wp.array(saved.means, dtype=wp.vec3, **make)
        self.faces = wp.array(saved.faces.ravel(), dtype=int, **make)

    def pose(self, poses: FloatArray) -> None:
        """Compare the shapes under these similarities (M, 4, 4) from now on."""
        self.poses = poses
        packed: Any = np.zeros(self.shapes, dtype=_POSE.numpy_dtype())
        packed["linear"] = poses[:, :3, :3]
        packed["turn"] = turns_of(poses)
        packed["shift"] = poses[:, :3, 3]
        self._poses.assign(wp.array(packed, dtype=kernels.Pose, device=self.launch.device))

    def particles(self) -> Particles:
        """Return a copy of what a later engine needs to go on."""
        shape = (self.shapes, self.count)
        return Particles(
            self.host_positions(),
            self.sampling.widths.numpy().reshape(shape).copy(),
            self.means.numpy().copy(),
            self.faces.numpy().reshape(shape).copy(),
        )

    def host_positions(self) -> Float32Array:
        """Return the particles in the optimizer's coordinates, shape (M, n, 3)."""
        result: Float32Array = self.positions.numpy().reshape(self.shapes, self.count, 3).copy()
        return result

    def host_normals(self) -> Float32Array:
        """Return the outward unit normals there, shape (M, n, 3)."""
        result: Float32Array = self.normals.numpy().reshape(self.shapes, self.count, 3).copy()
        return result

    def host_means(self) -> FloatArray:
        """Return the mean normals as the shapes are compared, shape (n, 3)."""
        result: FloatArray = self.means.numpy().astype(np.float64)
        return result

    def posed_positions(self) -> FloatArray:
        """Return the particles as they are compared, shape (M, n, 3)."""
        turned = np.einsum("mij,mnj->mni", self.poses[:, :3, :3], self.host_positions().astype(np.float64))
        result: FloatArray = turned + self.poses[:, None, :3, 3]
        return result

    def posed_normals(self) -> FloatArray:
        """Return the normals as they are compared, shape (M, n, 3)."""
        result: FloatArray = np.einsum("mij,mnj->mni", turns_of(self.poses), self.host_normals())
        return result

    def start_stage(self, weights: Sequence[Weights], done: int = 0) -> None:
        """Load the knobs of a stage's iterations, one element each, the first `done` of which are behind."""
        knobs: Any = np.zeros(len(weights), dtype=_KNOBS.numpy_dtype())
        knobs["step"] = [w.step * self.width**2 for w in weights]
        knobs["most"] = 0.25
        knobs["ensemble_weight"] = [w.ensemble for w in weights]
        knobs["normals_weight"] = [w.normals for w in weights]
        knobs["regularization"] = [w.regularization for w in weights]
        knobs["normals_regularization"] = [w.normals_regularization for w in weights]
        self.stage = wp.array(knobs, dtype=kernels.Knobs, device=self.launch.device)
        self.iteration.fill_(done)
        self._graph = None

    def iterate(self, times: int = LIST_LIFE) -> None:
        """Relink the neighbours, then move every particle so many times."""
        self._locate()
        self.sampling.relink(self.positions, self.feet)
        if self.launch.device == "cpu" or times != LIST_LIFE:
            for _ in range(times):
                self._move()
            return
        if self._graph is None:
            with wp.ScopedCapture(device=self.launch.device) as capture:
                for _ in range(times):
                    self._move()
            self._graph = capture.graph
        wp.capture_launch(self._graph)

    def energy(self) -> FloatArray:
        """Return H(P), H(Z) and H(V) of the last iteration, per particle and shape, (3,).

        H(P) counts as -(mean log density): the objective adds the three with their weights. Shapes on which
        no particle may move add nothing to it.
        """
        sampling = float(self.sampling.energies.numpy().mean(dtype=np.float64))
        return np.array([sampling, *self.coupling.entropies()])

    def place(self, positions: FloatArray) -> None:
        """Put the particles that may move there, (M, n, 3) near the surfaces."""
        self.positions.assign(positions.reshape(-1, 3).astype(np.float32))
        self._project()
        self.find_again()

    def find_again(self) -> None:
        """Look for every particle's face in space, as at the start: walks along the mesh went astray."""
        self.faces.assign(self._nearest_faces())

    def gaps(self) -> FloatArray:
        """Return how far each particle is from its mesh, (M, n), in optimizer lengths; inf if nowhere."""
        self._locate()
        away = self.positions.numpy() - self.feet.numpy()["position"]
        distances: FloatArray = np.linalg.norm(away, axis=1).reshape(self.shapes, self.count)
        return np.where(np.isfinite(distances), distances, np.inf)

    def _project(self, newton_steps: int = NEWTON_STEPS) -> None:
        given = [self.count, newton_steps, self.movable, self.fields, self.reliefs]
        made = [self.positions, self.normals, self.bends, self.openings]
        self.launch(kernels.project, self.total, [*given, *made])

    def _locate(self) -> None:
        self.launch(
            kernels.locate,
            self.total,
            [self.count, self.level.surfaces, self.positions, self.normals, self.faces, self.feet],
        )

    def _move(self) -> None:
        layout, knobs = self.layout, (self.stage, self.iteration)
        sampling, coupling = self.sampling, self.coupling
        surface = [self._poses, self.positions, self.normals]
        self._locate()
        sampling.repel(self.positions, self.normals, self.feet)
        compared = [self.openings, self.means, self.centred, self.logs]
        self.launch(step_kernels.mean_normals, self.count, [layout, *surface, *compared])
        coupling.solve(*knobs, self.centred, self.logs)
        coupling.directions(self.centred, self.logs, self.ensemble_part, self.normals_part)
        parts = [sampling.forces, self.ensemble_part, self.normals_part]
        self.launch(
            step_kernels.combine,
            self.total,
            [
                layout,
                *knobs,
                self.movable,
                coupling.stiffness,
                self.level.surfaces,
                self._poses,
                self.normals,
                self.means,
                self.bends,
                self.openings,
                *parts,
                self.steps,
            ],
        )
        coupling.damp(*knobs, self.steps, self.ensemble_part)
        widths = [sampling.widths, sampling.next_widths]
        self.launch(
            step_kernels.move,
            self.total,
            [self.count, *knobs, self.ensemble_part, self._poses, self.normals, *widths, self.positions],
        )
        self._project()
        wp.launch(step_kernels.advance, dim=1, inputs=[self.iteration], device=self.launch.device)


def turns_of(poses: FloatArray) -> FloatArray:
    """Return the rotations of similarities, (M, 3, 3)."""
    linear = poses[:, :3, :3]
    turns: FloatArray = linear / np.cbrt(np.linalg.det(linear))[:, None, None]
    return turns
