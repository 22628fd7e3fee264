"""The particles on the device, and one iteration of the optimization."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import BoolArray, DeviceArray, Float32Array, FloatArray, IntArray
from homolog.correspondence.entropy.coherence import Coherence, Neighbourhoods, find_neighbourhoods
from homolog.correspondence.entropy.coupling import coupling
from homolog.correspondence.entropy.means import DeviceMeans, Means
from homolog.correspondence.entropy.sampling import LIST_CUTOFF, LIST_ITERATIONS, Sampling
from homolog.correspondence.kernels import particles as kernels
from homolog.correspondence.kernels import step as step_kernels
from homolog.correspondence.kernels.functions import stencil_cache
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.schedule import Weights
from homolog.correspondence.surface_sets import SurfaceSet
from homolog.geodesics.kernels.lookup import SurfacePoint
from homolog.geometry import rotation_of
from homolog.surfaces.closest import closest_faces
from homolog.surfaces.nearest import nearest_faces
from homolog.threads import cores, in_threads

__all__ = ["Engine", "Particles"]

NEWTON_STEPS = 2
NEIGHBOURHOOD_ITERATIONS = 4 * LIST_ITERATIONS  # between two searches; the mean shape hardly changes in them


@dataclass(frozen=True, slots=True, eq=False)
class Particles:
    """The state of an engine's particles (shapes as in `Checkpoint`)."""

    positions: Float32Array
    widths: Float32Array
    means: Float32Array
    faces: IntArray
    neighbourhoods: Neighbourhoods


_PARAMETERS: Any = kernels.StepParameters
_POSE: Any = kernels.Pose


class Engine:
    """n particles on M shapes on the device, and the iterations that move them.

    Parameters
    ----------
    fields, opening_fields : wp.array of FieldData
        Distances and opening angles, one a shape.
    surface_set : SurfaceSet
        Meshes and geodesic tables.
    particles : Particles or (M, n, 3) array
        As saved by another engine, or positions near the surfaces in the optimizer's coordinates.
    geodesic : bool
        Distances from the geodesic tables, or straight lines.
    area : float
        Mean surface area in squared optimizer lengths.
    launcher : Launcher
        The device.
    poses : (M, 4, 4) array, optional
        Similarities that align the shapes with each other; the identity by default.
    free : (M, n) bool array, optional
        Particles that may move; all by default. The others keep their positions.

    Attributes
    ----------
    second : str or None
        Another CUDA device, that computes H(V).
    """

    second: str | None = None

    positions: DeviceArray
    means: DeviceArray
    faces: DeviceArray
    carrier_faces: DeviceArray
    iteration: DeviceArray
    closest: DeviceArray
    normals: DeviceArray
    openings: DeviceArray
    centred: DeviceArray
    logs: DeviceArray
    poses: FloatArray

    def __init__(
        self,
        fields: DeviceArray,
        opening_fields: DeviceArray,
        surface_set: SurfaceSet,
        particles: Particles | FloatArray,
        *,
        geodesic: bool,
        area: float,
        launcher: Launcher,
        poses: FloatArray | None = None,
        free: BoolArray | None = None,
    ) -> None:
        launcher.forget()
        saved = particles if isinstance(particles, Particles) else None
        positions = particles.positions if isinstance(particles, Particles) else particles
        self.fields, self.opening_fields = fields, opening_fields
        self._lay_out(positions, surface_set, free, geodesic=geodesic, area=area, launcher=launcher)
        self._tie(any_fixed=free is not None)
        self.sampling = Sampling(surface_set, self.layout, launcher)
        self.set_poses(np.tile(np.eye(4), (self.shapes, 1, 1)) if poses is None else poses)
        self.faces = wp.zeros(self.total, dtype=int, device=launcher.device)
        if saved is not None:
            self._restore(saved)
        self._find_carrier_faces()
        self._project(0 if saved is not None else NEWTON_STEPS)
        if saved is None:
            self.find_faces()
            self._take_means()

    def _lay_out(
        self,
        positions: FloatArray | Float32Array,
        surface_set: SurfaceSet,
        free: BoolArray | None,
        *,
        geodesic: bool,
        area: float,
        launcher: Launcher,
    ) -> None:
        self.shapes, self.count = positions.shape[:2]
        self.surface_set, self.launch = surface_set, launcher
        self.total = self.shapes * self.count
        self.width = math.sqrt(area / (self.count * math.pi))
        self.layout = kernels.Layout()
        self.layout.per_shape, self.layout.shapes = self.count, self.shapes
        self.layout.geodesic = int(geodesic)
        self.layout.expected_width = self.width
        self.layout.list_cutoff = LIST_CUTOFF * self.width
        self._allocate(positions)
        flags = np.ones(self.total) if free is None else free.ravel()
        self.free = wp.array(flags, dtype=int, device=launcher.device)

    def _tie(self, *, any_fixed: bool) -> None:
        """Create the coupling of the shapes."""
        self.coupling = coupling(self.layout, self.free, any_fixed, self.launch, self.second)
        self.stiffness = self.coupling.stiffness
        self.coherence = Coherence(self.layout, self.free, self.launch)
        self._compare = (Means if self.launch.device == "cpu" else DeviceMeans)(self.layout, self.launch)

    def _allocate(self, positions: FloatArray | Float32Array) -> None:
        total, on_device = self.total, {"device": self.launch.device}
        self.positions = wp.array(positions.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, **on_device)
        self.shape_operators = wp.zeros(total, dtype=wp.mat33, **on_device)
        self.openings = wp.zeros(total, dtype=wp.vec4, **on_device)
        self.closest = wp.zeros(total, dtype=SurfacePoint, **on_device)
        vectors = [wp.zeros(total, dtype=wp.vec3, **on_device) for _ in range(6)]
        self.normals, self.centred, self.logs = vectors[:3]
        self.ensemble_part, self.normals_part, self.steps = vectors[3:]
        self.iteration = wp.zeros(1, dtype=int, **on_device)
        cached = total if self.launch.device == "cpu" else 0
        self._caches = [stencil_cache(cached, self.launch.device) for _ in range(2)]
        self._poses: DeviceArray = wp.zeros(self.shapes, dtype=kernels.Pose, **on_device)

    def _nearest_faces(self) -> IntArray:
        parts = zip(self.surface_set.meshes, self.host_positions(), self.host_normals(), strict=True)
        faces = []
        for nearest in in_threads(lambda part: nearest_faces(*part), parts, cores()):
            self.launch.poll_cancel()
            faces.append(nearest)
        return np.concatenate(faces)

    def _find_carrier_faces(self) -> None:
        """Find the faces on which the particles of open shapes lie."""
        if (carriers := self.surface_set.carriers) is not None:
            faces = np.zeros((self.shapes, self.count), np.int32)
            for index, (mesh, points) in enumerate(zip(carriers.meshes, self.host_positions(), strict=True)):
                if mesh is not None:
                    faces[index] = closest_faces(mesh, points.astype(np.float64))[0]
            self.carrier_faces = wp.array(faces.ravel(), dtype=int, device=self.launch.device)

    def _take_means(self) -> None:
        normals = self.aligned_normals()
        mean = normals.sum(axis=0)
        is_short = np.linalg.norm(mean, axis=1) < 1e-3  # opposite normals: start from one shape's
        mean[is_short] = normals[0][is_short]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        self.means = wp.array(mean, dtype=wp.vec3, device=self.launch.device)

    def _restore(self, saved: Particles) -> None:
        on_device = {"device": self.launch.device}
        self.sampling.widths = wp.array(saved.widths.ravel(), dtype=float, **on_device)
        self.means = wp.array(saved.means, dtype=wp.vec3, **on_device)
        self.faces = wp.array(saved.faces.ravel(), dtype=int, **on_device)
        self._restore_neighbourhoods(saved)

    def _restore_neighbourhoods(self, saved: Particles) -> None:
        if saved.neighbourhoods[0].size:
            self.coherence.set(saved.neighbourhoods)

    def mean_shape(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean positions and normals of the particles, (n, 3) each."""
        return self.aligned_positions().mean(axis=0), self.host_means()

    def _find_neighbourhoods(self, times: int) -> None:
        """Find the neighbourhoods again if that is due in this iteration, and count those that follow."""
        if self.is_coherent and (
            self._done % NEIGHBOURHOOD_ITERATIONS == 0 or self.coherence.neighbourhoods is None
        ):
            centres, normals = self.mean_shape()
            if np.isfinite(centres).all():  # else the next record of the energies says so
                self.coherence.set(find_neighbourhoods(centres, normals))
        self._done += times

    def set_poses(self, poses: FloatArray) -> None:
        """Set the similarities (M, 4, 4) that align the shapes."""
        self.poses = poses
        packed: Any = np.zeros(self.shapes, dtype=_POSE.numpy_dtype())
        packed["linear"] = poses[:, :3, :3]
        packed["rotation"] = rotation_of(poses)
        packed["shift"] = poses[:, :3, 3]
        self._poses.assign(wp.array(packed, dtype=kernels.Pose, device=self.launch.device))

    def particles(self) -> Particles:
        """Return a copy of the state, from which another engine can continue."""
        shape = (self.shapes, self.count)
        return Particles(
            self.host_positions(),
            self.sampling.widths.numpy().reshape(shape).copy(),
            self.means.numpy().copy(),
            self.faces.numpy().reshape(shape).copy(),
            self.neighbourhoods(),
        )

    def neighbourhoods(self) -> Neighbourhoods:
        """Return the neighbourhoods on the mean shape; empty ones before the first iteration."""
        known = self.coherence.neighbourhoods
        return known or (np.zeros((self.count, 0), np.int32), np.zeros((self.count, 0), np.float32))

    def host_positions(self) -> Float32Array:
        """Return the particles in the optimizer's coordinates, shape (M, n, 3)."""
        result: Float32Array = self.positions.numpy().reshape(self.shapes, self.count, 3).copy()
        return result

    def host_normals(self) -> Float32Array:
        """Return the outward unit normals there, shape (M, n, 3)."""
        result: Float32Array = self.normals.numpy().reshape(self.shapes, self.count, 3).copy()
        return result

    def host_means(self) -> FloatArray:
        """Return the mean normals in the aligned frame, shape (n, 3)."""
        result: FloatArray = self.means.numpy().astype(np.float64)
        return result

    def aligned_positions(self) -> FloatArray:
        """Return the aligned particles, shape (M, n, 3)."""
        rotated = np.einsum("mij,mnj->mni", self.poses[:, :3, :3], self.host_positions().astype(np.float64))
        result: FloatArray = rotated + self.poses[:, None, :3, 3]
        return result

    def aligned_normals(self) -> FloatArray:
        """Return the aligned normals, shape (M, n, 3)."""
        result: FloatArray = np.einsum("mij,mnj->mni", rotation_of(self.poses), self.host_normals())
        return result

    def start_stage(self, weights: Sequence[Weights], done: int = 0) -> None:
        """Load the parameters of a stage's iterations; the first `done` have been run."""
        parameters: Any = np.zeros(len(weights), dtype=_PARAMETERS.numpy_dtype())
        parameters["step"] = [w.step * self.width**2 for w in weights]
        parameters["max_step"] = 0.25
        parameters["ensemble_weight"] = [w.ensemble.weight for w in weights]
        parameters["coherence"] = [w.coherence / self.width**2 for w in weights]
        parameters["normals_weight"] = [w.normals.weight for w in weights]
        parameters["regularization"] = [w.ensemble.regularization for w in weights]
        parameters["normals_regularization"] = [w.normals.regularization for w in weights]
        self.stage = wp.array(parameters, dtype=kernels.StepParameters, device=self.launch.device)
        self.iteration.fill_(done)
        self._graph = None
        self._done = done
        self.is_coherent = any(w.coherence > 0.0 for w in weights)

    def iterate(self, times: int = LIST_ITERATIONS) -> None:
        """Rebuild the neighbour lists, then move all particles `times` times."""
        self._find_neighbourhoods(times)
        self.locate()
        self.sampling.rebuild_neighbour_lists(self.positions, self.faces, self.closest)
        if self.launch.device == "cpu" or times != LIST_ITERATIONS:
            for _ in range(times):
                self._move()
            return
        if self._graph is None:
            with wp.ScopedCapture(device=self.launch.device) as capture:
                for _ in range(times):
                    self._move()
            self._graph = capture.graph
        wp.capture_launch(self._graph)

    def energy(self, coherence: float = 0.0) -> FloatArray:
        """Return H(P), H(Z) and H(V) of the last iteration, per particle and shape, (3,).

        H(Z) contains the coherence with the neighbours, whose weight relative to that of H(Z) is given.
        H(P) is -(mean log density); the objective is the weighted sum of the three. Shapes on which all
        particles are fixed contribute nothing.
        """
        sampling = float(self.sampling.energies.numpy().mean(dtype=np.float64))
        return np.array([sampling, *self.coupling.entropies()]) + self._coherence_part(coherence)

    def _coherence_part(self, weight: float) -> FloatArray:
        """Return what coherence adds to the three parts of the energy."""
        roughness = self.coherence.roughness() / self.width**2 if weight > 0.0 else 0.0
        return np.array([0.0, weight * roughness, 0.0])

    def set_positions(self, positions: FloatArray) -> None:
        """Set the positions (M, n, 3); free particles are projected onto the surfaces."""
        self.positions.assign(positions.reshape(-1, 3).astype(np.float32))
        self._find_carrier_faces()
        self._project()
        self.find_faces()

    def find_faces(self) -> None:
        """Search every particle's face in space, for walks that were trapped."""
        if self.launch.device == "cpu":
            self.faces.assign(self._nearest_faces())
        else:
            given = [self.count, self.surface_set.surfaces, self.positions, self.normals]
            self.launch(kernels.find_faces, self.total, [*given, self.faces])

    def surface_distances(self) -> FloatArray:
        """Return each particle's distance from its mesh, (M, n), in optimizer lengths; inf if not finite."""
        self.locate()
        offsets = self.positions.numpy() - self.closest.numpy()["position"]
        distances: FloatArray = np.linalg.norm(offsets, axis=1).reshape(self.shapes, self.count)
        return np.where(np.isfinite(distances), distances, np.inf)

    def _project(self, newton_steps: int = NEWTON_STEPS, *, only_free: bool = False) -> None:
        given = [self.count, newton_steps, int(only_free), self.free]
        given += [self.fields, self.opening_fields, *self._caches]
        made = [self.positions, self.normals, self.shape_operators, self.openings]
        self.launch(kernels.project, self.total, [*given, *made])
        if (carriers := self.surface_set.carriers) is not None:
            given = [self.count, int(only_free), self.free, carriers.surfaces, self.carrier_faces]
            self.launch(kernels.project_on_mesh, self.total, [*given, *made[:3]])

    def locate(self) -> None:
        """Find the closest point of the mesh for each particle."""
        self.launch(
            kernels.locate,
            self.total,
            [self.count, self.surface_set.surfaces, self.positions, self.normals, self.faces, self.closest],
        )

    def compare(self) -> None:
        """Centre positions, and the Logs of normals, over the shapes."""
        surface = (self.positions, self.normals, self.openings)
        self._compare(self._poses, surface, self.means, (self.centred, self.logs))

    def _move(self) -> None:
        self.compare()
        with self.launch.beside(self.compute_forces, self.count):
            self.coupling.gradients(
                self.stage, self.iteration, (self.centred, self.logs), (self.ensemble_part, self.normals_part)
            )
        if self.is_coherent:
            self.coherence.add_gradient(self.stage, self.iteration, self.centred, self.ensemble_part)
        self.combine()
        self.coupling.damp(self.stage, self.iteration, self.steps, self.ensemble_part)
        if self.is_coherent:
            self.coherence.damp(self.stage, self.iteration, self.ensemble_part)
        self.launch.in_order(self.take_step, self.count)
        self.count_iteration()

    def compute_forces(self) -> None:
        """Compute the forces of the sampling entropy."""
        self.locate()
        self.sampling.compute_forces(self.positions, self.normals, self.faces, self.closest)

    def combine(self) -> None:
        """Sum the forces on every particle."""
        surface = [self._poses, self.normals, self.means, self.shape_operators, self.openings]
        forces = [self.sampling.forces, self.ensemble_part, self.normals_part]
        self.launch(
            step_kernels.combine,
            self.total,
            [
                self.layout,
                self.stage,
                self.iteration,
                self.free,
                self.stiffness,
                self.surface_set.surfaces,
                *surface,
                *forces,
                self.steps,
            ],
        )

    def take_step(self) -> None:
        """Move every particle by its damped step."""
        parameters = [self.count, self.stage, self.iteration, self.ensemble_part, self._poses, self.normals]
        widths = [self.sampling.widths, self.sampling.next_widths]
        self.launch(step_kernels.move, self.total, [*parameters, *widths, self.positions])
        self._project(only_free=True)

    def count_iteration(self) -> None:
        """Advance to the parameters of the next iteration."""
        wp.launch(step_kernels.next_iteration, dim=1, inputs=[self.iteration], device=self.launch.device)
