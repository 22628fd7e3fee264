"""The particles on the device, and one iteration of the optimizer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import BoolArray, DeviceArray, Float32Array, FloatArray, IntArray
from homolog.correspondence import kernels, sampling_kernels
from homolog.correspondence.coupling import coupling
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.surfaces import Level, nearest_faces
from homolog.geodesics.lookup import SurfacePoint

__all__ = ["LIST_LIFE", "REACH", "Engine", "Particles", "Weights"]

ROW = 64  # neighbours that a row holds; an even layout needs 20
NEWTON_STEPS = 2
SKIN = 1.08  # neighbour lists reach this much farther than forces, and last this many iterations:
LIST_LIFE = 5
REACH = sampling_kernels.CUTOFF * sampling_kernels.WIDEST * SKIN
"""Longest distance that a neighbour list needs, in even Parzen widths."""


@dataclass(frozen=True, slots=True)
class Weights:
    """What the schedule sets for one iteration (lengths in the optimizer's unit).

    Attributes
    ----------
    ensemble, normals : float
        Weights of H(Z) and H(V).
    regularization : float
        Of the ensemble's dual, a squared length.
    normals_regularization : float
        Of the normals' dual [rad²].
    step : float
        tau over the squared Parzen width.
    """

    ensemble: float
    normals: float
    regularization: float
    normals_regularization: float
    step: float


@dataclass(frozen=True, slots=True, eq=False)
class Particles:
    """What must be known of particles to go on with them (shapes as in `Checkpoint`)."""

    positions: Float32Array
    widths: Float32Array
    means: Float32Array
    faces: IntArray


_KNOBS: Any = kernels.Knobs


class Engine:
    """Positions of n particles on M shapes, and how they move.

    Parameters
    ----------
    fields : wp.array of FieldData
        One a shape.
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
    movable : (M, n) bool array, optional
        Particles that may move; all if not given. The others' positions are taken as they are.
    """

    positions: DeviceArray
    widths: DeviceArray
    means: DeviceArray
    faces: DeviceArray
    energies: DeviceArray
    iteration: DeviceArray
    counts: DeviceArray
    feet: DeviceArray
    normals: DeviceArray

    def __init__(
        self,
        fields: DeviceArray,
        level: Level,
        particles: Particles | FloatArray,
        *,
        geodesic: bool,
        area: float,
        launcher: Launcher,
        movable: BoolArray | None = None,
    ) -> None:
        saved = particles if isinstance(particles, Particles) else None
        positions = particles.positions if isinstance(particles, Particles) else particles
        self.shapes, self.count = positions.shape[:2]
        self.fields, self.level, self.launch = fields, level, launcher
        self.total = self.shapes * self.count
        self.width = math.sqrt(area / (self.count * math.pi))
        self.layout = kernels.Layout()
        self.layout.per_shape, self.layout.shapes, self.layout.geodesic = (
            self.count,
            self.shapes,
            int(geodesic),
        )
        self.layout.expected_width = self.width
        self.layout.reach = REACH * self.width
        self._allocate(positions)
        free = np.ones(self.total) if movable is None else movable.ravel()
        self.movable = wp.array(free, dtype=int, device=launcher.device)
        self.coupling = coupling(self.layout, self.movable, movable is not None, launcher)
        self._project(0 if saved is not None else NEWTON_STEPS)
        if saved is not None:
            self._restore(saved)
        else:
            self._start_walks()

    def _allocate(self, positions: FloatArray | Float32Array) -> None:
        total, make = self.total, {"device": self.launch.device}
        self.positions = wp.array(positions.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, **make)
        self.bends = wp.zeros(total, dtype=wp.mat33, **make)
        self.feet = wp.zeros(total, dtype=SurfacePoint, **make)
        self.widths = wp.full(total, self.width, dtype=float, **make)
        self.next_widths = wp.full(total, self.width, dtype=float, **make)
        self.masses = wp.zeros(total, dtype=float, **make)
        self.energies = wp.zeros(total, dtype=float, **make)
        self.neighbors = wp.zeros((total, ROW), dtype=int, **make)
        self.counts = wp.zeros(total, dtype=int, **make)
        self.pairs = wp.zeros((total, ROW), dtype=wp.vec4, **make)
        vectors = [wp.zeros(total, dtype=wp.vec3, **make) for _ in range(8)]
        self.normals, self.forces, self.centred, self.logs = vectors[:4]
        self.ensemble_part, self.normals_part, self.steps, self.spread = vectors[4:]
        self.iteration = wp.zeros(1, dtype=int, **make)
        self.grid = wp.HashGrid(64, 64, 64, device=self.launch.device)

    def _start_walks(self) -> None:
        normals = self.host_normals()
        faces = [
            nearest_faces(mesh, p, n)
            for mesh, p, n in zip(self.level.meshes, self.host_positions(), normals, strict=True)
        ]
        self.faces = wp.array(np.concatenate(faces), dtype=int, device=self.launch.device)
        mean = normals.sum(axis=0)
        short = np.linalg.norm(mean, axis=1) < 1e-3  # opposite normals: start from one shape's
        mean[short] = normals[0][short]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        self.means = wp.array(mean, dtype=wp.vec3, device=self.launch.device)

    def _restore(self, saved: Particles) -> None:
        make = {"device": self.launch.device}
        self.widths = wp.array(saved.widths.ravel(), dtype=float, **make)
        self.means = wp.array(saved.means, dtype=wp.vec3, **make)
        self.faces = wp.array(saved.faces.ravel(), dtype=int, **make)

    def particles(self) -> Particles:
        """Return a copy of what a later engine needs to go on."""
        shape = (self.shapes, self.count)
        return Particles(
            self.host_positions(),
            self.widths.numpy().reshape(shape).copy(),
            self.means.numpy().copy(),
            self.faces.numpy().reshape(shape).copy(),
        )

    def host_positions(self) -> Float32Array:
        """Return the particles in the optimizer's coordinates, shape (M, n, 3)."""
        result: Float32Array = self.positions.numpy().reshape(self.shapes, self.count, 3).copy()
        return result

    def host_normals(self) -> Float32Array:
        """Return the outward unit normals, shape (M, n, 3)."""
        result: Float32Array = self.normals.numpy().reshape(self.shapes, self.count, 3).copy()
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
        self._relink()
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
        return np.array([float(self.energies.numpy().mean(dtype=np.float64)), *self.coupling.entropies()])

    def gaps(self) -> FloatArray:
        """Return how far the farthest particle of each shape is from its mesh, (M,), in optimizer lengths."""
        self._locate()
        away = self.positions.numpy() - self.feet.numpy()["position"]
        longest: FloatArray = np.linalg.norm(away, axis=1).reshape(self.shapes, -1).max(axis=1)
        return longest

    def _project(self, newton_steps: int = NEWTON_STEPS) -> None:
        self.launch(
            kernels.project,
            self.total,
            [self.count, newton_steps, self.movable, self.fields, self.positions, self.normals, self.bends],
        )

    def _locate(self) -> None:
        self.launch(
            kernels.locate,
            self.total,
            [self.count, self.level.surfaces, self.positions, self.faces, self.feet],
        )

    def _relink(self) -> None:
        apart = 2.4 * self.level.extent + 2.0 * self.layout.reach
        wp.launch(
            sampling_kernels.spread,
            dim=self.total,
            inputs=[self.count, apart, self.positions, self.spread],
            device=self.launch.device,
        )
        self.grid.build(self.spread, min(self.layout.reach, 2.0 * self.level.extent))
        self.launch(
            sampling_kernels.link_neighbors,
            self.total,
            [
                self.layout,
                self.grid.id,
                self.level.surfaces,
                self.spread,
                self.feet,
                self.neighbors,
                self.counts,
            ],
        )

    def _repel(self) -> None:
        self.launch(
            sampling_kernels.repel,
            self.total,
            [
                self.layout,
                self.level.surfaces,
                self.positions,
                self.normals,
                self.feet,
                self.neighbors,
                self.counts,
                self.widths,
                self.next_widths,
                self.masses,
                self.pairs,
                self.forces,
                self.energies,
            ],
        )
        self.launch(
            sampling_kernels.yield_back,
            self.total,
            [
                self.layout,
                self.normals,
                self.neighbors,
                self.counts,
                self.widths,
                self.masses,
                self.pairs,
                self.forces,
            ],
        )

    def _move(self) -> None:
        layout = self.layout
        knobs = (self.stage, self.iteration)
        self._locate()
        self._repel()
        self.launch(
            kernels.mean_normals,
            self.count,
            [layout, self.positions, self.normals, self.means, self.centred, self.logs],
        )
        self.coupling.solve(*knobs, self.centred, self.logs)
        self.coupling.directions(self.centred, self.logs, self.ensemble_part, self.normals_part)
        self.launch(
            kernels.combine,
            self.total,
            [
                layout,
                *knobs,
                self.movable,
                self.coupling.stiffness,
                self.normals,
                self.means,
                self.bends,
                self.forces,
                self.ensemble_part,
                self.normals_part,
                self.steps,
            ],
        )
        self.coupling.damp(*knobs, self.steps, self.ensemble_part)
        self.launch(
            kernels.move,
            self.total,
            [*knobs, self.ensemble_part, self.normals, self.widths, self.next_widths, self.positions],
        )
        self._project()
        wp.launch(kernels.advance, dim=1, inputs=[self.iteration], device=self.launch.device)
