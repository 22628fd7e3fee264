"""Shapes divided among several devices of one machine.

Every device has the surfaces and tables of its shapes and moves their particles. Quantities across shapes
are computed for all of them: the mean normals and the dual of H(Z) on the first device, the dual of H(V) on
the second, which also damps the steps of half of the shapes. In an iteration the first gets positions,
normals and opening angles from the others while all compute forces, gives them mean normals and gradients,
gets steps and gives damped ones: about 26 numbers a particle in all. As two of the three matrices are its
own, the first device has fewer shapes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations

import numpy as np
import warp as wp

from homolog.arrays import BoolArray, DeviceArray, FloatArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.entropy.coherence import Neighbourhoods
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.fields import opening_scale
from homolog.correspondence.launcher import Launcher, Transfer, copy_between
from homolog.correspondence.prepared_cohort import (
    MEAN_AREA,
    PreparedCohort,
    SurfaceSets,
    prepare_cohort,
)
from homolog.correspondence.schedule import Weights
from homolog.correspondence.surface_sets import Similarity, SurfaceSet, length_unit
from homolog.correspondence.types import Shape
from homolog.geodesics import GeodesicSolver, solve_tables
from homolog.memory import Store, in_memory
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings

__all__ = ["DividedCohort", "make_engine", "prepare_on"]

FIRST_SHARE = 0.75
"""Shapes of the first device, relative to those of the others."""


@dataclass(frozen=True, slots=True, eq=False)
class DividedCohort(PreparedCohort):
    """A cohort whose shapes lie on several devices; `device` is the first of them.

    Attributes
    ----------
    parts : tuple of PreparedCohort
        Successive shapes, each on its device.
    """

    parts: tuple[PreparedCohort, ...]


class _DividedSets(SurfaceSets):
    """The surface sets of all parts as one, whose surfaces are those of the parts."""

    def __init__(self, parts: Sequence[PreparedCohort]) -> None:
        self._parts = parts

    def of(self, count: int, tick: Tick) -> SurfaceSet:
        """Return the sets for a number of particles as one."""
        total = len(self._parts)
        sets = [
            part.surface_set(count, part_of(tick, index / total, (index + 1) / total))
            for index, part in enumerate(self._parts)
        ]
        return SurfaceSet(
            surfaces=None,
            meshes=[mesh for item in sets for mesh in item.meshes],
            carriers=None,
            has_rims=any(item.has_rims for item in sets),
            extent=max(item.extent for item in sets),
            sizes=np.concatenate([item.sizes for item in sets]),
            references=[],
        )


def prepare_on(
    devices: Sequence[str],
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    *,
    counts: Sequence[int],
    free_shapes: BoolArray | None = None,
    solve: GeodesicSolver = solve_tables,
    store: Store = in_memory,
    tick: Tick = no_tick,
) -> PreparedCohort:
    """Prepare shapes on one or several devices (see `prepare_cohort`).

    Parameters
    ----------
    devices : sequence of str
        Warp aliases. The first one gets three quarters of the number of shapes that the others get.
    shapes, settings, counts, free_shapes, solve, store, tick
        As of `prepare_cohort`.
    """
    if len(devices) == 1:
        return prepare_cohort(
            shapes,
            settings,
            device=devices[0],
            counts=counts,
            free_shapes=free_shapes,
            solve=solve,
            store=store,
            tick=tick,
        )
    _connect(devices)
    unit = length_unit(shapes)
    opening = settings.opening_weight if settings.method.uses_normals else 0.0
    ways = [Similarity.of(shape.alignment, unit) for shape in shapes]
    openings = 0.0
    if opening:
        openings = opening_scale(shapes, ways, opening, part_of(tick, 0.0, 0.05), device=devices[0])
    spans = _spans(len(shapes), len(devices))
    free = np.full(len(shapes), True) if free_shapes is None else free_shapes
    parts = tuple(
        prepare_cohort(
            shapes[own],
            settings,
            device=device,
            counts=counts,
            free_shapes=free[own],
            solve=solve,
            unit=unit,
            opening_scale=openings,
            store=store,
            tick=part_of(tick, 0.05 + 0.95 * own.start / len(shapes), 0.05 + 0.95 * own.stop / len(shapes)),
        )
        for device, own in zip(devices, spans, strict=False)  # no more devices than shapes
    )
    return DividedCohort(
        names=tuple(shape.name for shape in shapes),
        unit=unit,
        to_optimizer=tuple(way for part in parts for way in part.to_optimizer),
        fields=None,
        opening_fields=None,
        sets=_DividedSets(parts),
        geodesic=settings.method.uses_geodesics,
        device=devices[0],
        parts=parts,
    )


def _connect(devices: Sequence[str]) -> None:
    """Enable peer access between GPUs where possible; otherwise copies pass through the host."""
    for target, peer in permutations(set(devices), 2):
        if wp.is_mempool_access_supported(target, peer):
            wp.set_mempool_access_enabled(target, peer, True)


def _spans(shapes: int, devices: int) -> list[slice]:
    """Return the shapes of each device, at least one, and none for devices beyond the number of shapes."""
    used = min(devices, shapes)
    ends = np.round(shapes * np.cumsum([FIRST_SHARE] + [1.0] * (used - 1)) / (FIRST_SHARE + used - 1))
    bounds = [0, *np.maximum(ends, np.arange(1, used + 1)).astype(int).tolist()]
    return [slice(begin, end) for begin, end in pairwise(bounds)]


def make_engine(
    cohort: PreparedCohort,
    particles: Particles | FloatArray,
    launcher: Launcher,
    poses: FloatArray,
    free: BoolArray | None,
) -> Engine:
    """Return the engine of a cohort's particles, on the devices where the cohort lies (see `Engine`)."""
    if isinstance(cohort, DividedCohort):
        return DividedEngine(cohort, particles, launcher, poses, free)
    return _engine(Engine, cohort, particles, launcher, poses, free)


def _engine(
    kind: type[Engine],
    cohort: PreparedCohort,
    particles: Particles | FloatArray,
    launcher: Launcher,
    poses: FloatArray,
    free: BoolArray | None,
) -> Engine:
    count = _positions(particles).shape[1]
    return kind(
        cohort.fields,
        cohort.opening_fields,
        cohort.surface_set(count),
        particles,
        geodesic=cohort.geodesic,
        area=MEAN_AREA,
        launcher=launcher,
        poses=poses,
        free=free,
    )


def _positions(particles: Particles | FloatArray) -> FloatArray:
    return np.asarray(particles.positions if isinstance(particles, Particles) else particles)


class _PartEngine(Engine):
    """The particles of the shapes on one device, whose gradients are given."""

    def _tie(self, *, any_fixed: bool) -> None:
        self.stiffness = wp.zeros(1, dtype=float, device=self.launch.device)

    def _restore_neighbourhoods(self, saved: Particles) -> None:
        """Leave them to the engine of all shapes."""

    def neighbourhoods(self) -> Neighbourhoods:
        """Return none."""
        return np.zeros((self.count, 0), np.int32), np.zeros((self.count, 0), np.float32)


class DividedEngine(Engine):
    """The particles of a divided cohort: one engine couples them, and one on each device moves its own."""

    def __init__(
        self,
        cohort: DividedCohort,
        particles: Particles | FloatArray,
        launcher: Launcher,
        poses: FloatArray,
        free: BoolArray | None,
    ) -> None:
        positions = _positions(particles)
        self._spans = _spans(len(positions), len(cohort.parts))
        self._parts = [
            _engine(
                _PartEngine,
                part,
                _of_span(particles, own),
                launcher
                if part.device == launcher.device
                else Launcher(part.device, poll_cancel=launcher.poll_cancel),
                poses[own],
                None if free is None else free[own],
            )
            for part, own in zip(cohort.parts, self._spans, strict=True)
        ]
        self._lay_out(
            positions,
            cohort.surface_set(positions.shape[1]),
            free,
            geodesic=cohort.geodesic,
            area=MEAN_AREA,
            launcher=launcher,
        )
        self.second = cohort.parts[1].device
        self._transfers = [Transfer(part.device, launcher.device) for part in cohort.parts]
        self._tie(any_fixed=free is not None)
        super().set_poses(poses)
        self._gather_surface()
        if isinstance(particles, Particles):
            self.means = wp.array(particles.means, dtype=wp.vec3, device=launcher.device)
            self._restore_neighbourhoods(particles)
        else:
            self._take_means()

    def set_poses(self, poses: FloatArray) -> None:
        """Set the similarities (M, 4, 4) that align the shapes."""
        super().set_poses(poses)
        for part, own in self._by_part():
            part.set_poses(poses[own])

    def particles(self) -> Particles:
        """Return a copy of the state, from which another engine can continue."""
        parts = [part.particles() for part in self._parts]
        widths, faces = (
            np.concatenate([getattr(item, name) for item in parts]) for name in ("widths", "faces")
        )
        return Particles(
            self.host_positions(), widths, self.means.numpy().copy(), faces, self.neighbourhoods()
        )

    def start_stage(self, weights: Sequence[Weights], done: int = 0) -> None:
        """Load the parameters of a stage's iterations; the first `done` have been run."""
        super().start_stage(weights, done)
        for part in self._parts:
            part.start_stage(weights, done)

    def iterate(self, times: int = LIST_ITERATIONS) -> None:
        """Rebuild the neighbour lists, then move all particles `times` times."""
        self._find_neighbourhoods(times)
        for part in self._parts:
            part.locate()
            part.sampling.rebuild_neighbour_lists(part.positions, part.faces, part.closest)
        for _ in range(times):
            self._move()
        self._receive_surface()

    def energy(self, coherence: float = 0.0) -> FloatArray:
        """Return H(P), H(Z) and H(V) of the last iteration, per particle and shape, (3,)."""
        energies = np.concatenate([part.sampling.energies.numpy() for part in self._parts])
        parts = np.array([energies.mean(dtype=np.float64), *self.coupling.entropies()])
        return parts + self._coherence_part(coherence)

    def set_positions(self, positions: FloatArray) -> None:
        """Set the positions (M, n, 3); free particles are projected onto the surfaces."""
        for part, own in self._by_part():
            part.set_positions(positions[own])
        self._gather_surface()

    def find_faces(self) -> None:
        """Search every particle's face in space, for walks that were trapped."""
        for part in self._parts:
            part.find_faces()

    def surface_distances(self) -> FloatArray:
        """Return each particle's distance from its mesh, (M, n), in optimizer lengths; inf if not finite."""
        return np.concatenate([part.surface_distances() for part in self._parts])

    def _move(self) -> None:
        for part in self._parts:
            part.compute_forces()
        self._receive_surface()
        self.compare()
        self.coupling.gradients(
            self.stage, self.iteration, (self.centred, self.logs), (self.ensemble_part, self.normals_part)
        )
        if self.is_coherent:
            self.coherence.add_gradient(self.stage, self.iteration, self.centred, self.ensemble_part)
        self._scatter("ensemble_part")
        kept = self.coupling.kept_gradient
        self._give("normals_part", self.normals_part if kept is None else kept)
        for part in self._parts:
            copy_between(part.means, self.means)
            copy_between(part.stiffness, self.stiffness)
            part.combine()
        self._gather("steps")
        self.coupling.damp(self.stage, self.iteration, self.steps, self.ensemble_part)
        if self.is_coherent:
            self.coherence.damp(self.stage, self.iteration, self.ensemble_part)
        self._scatter("ensemble_part")
        for part in self._parts:
            part.take_step()
        for engine in (self, *self._parts):
            engine.count_iteration()
        self._send_surface()

    def _gather_surface(self) -> None:
        self._send_surface()
        self._receive_surface()

    def _send_surface(self) -> None:
        """Begin to copy positions and normals from the parts, while the devices go on with other work."""
        for transfer, (part, own) in zip(self._transfers, self._by_part(), strict=True):
            transfer.start()
            for name in ("positions", "normals", "openings"):
                transfer.copy(getattr(self, name), getattr(part, name), own.start * self.count, part.total)

    def _receive_surface(self) -> None:
        """Let later launches wait for these copies."""
        for transfer in self._transfers:
            transfer.finish()

    def _gather(self, *names: str) -> None:
        """Copy arrays of the parts to this engine's."""
        for part, own in self._by_part():
            for name in names:
                copy_between(getattr(self, name), getattr(part, name), own.start * self.count, 0, part.total)

    def _scatter(self, *names: str) -> None:
        """Copy arrays of this engine to those of the parts."""
        for name in names:
            self._give(name, getattr(self, name))

    def _give(self, name: str, source: DeviceArray) -> None:
        """Copy each part's share of an array of all particles to the part."""
        for part, own in self._by_part():
            copy_between(getattr(part, name), source, 0, own.start * self.count, part.total)

    def _by_part(self) -> list[tuple[Engine, slice]]:
        return list(zip(self._parts, self._spans, strict=True))


def _of_span(particles: Particles | FloatArray, own: slice) -> Particles | FloatArray:
    """Return the particles of some of the shapes."""
    if not isinstance(particles, Particles):
        return particles[own]
    return replace(
        particles,
        positions=particles.positions[own],
        widths=particles.widths[own],
        faces=particles.faces[own],
    )
