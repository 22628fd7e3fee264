"""The optimization loop: initial particles, iterations, splits, repairs, convergence."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.divided import make_engine
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.entropy.dual import ensemble_entropy
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.entropy.weight import with_weight
from homolog.correspondence.initialization.registration import InitialRegistration
from homolog.correspondence.initialization.splitting import split
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.misplaced import relocate, repairs_text
from homolog.correspondence.prepared_cohort import PreparedCohort, landmarks_on_device
from homolog.correspondence.recorder import CheckpointCallback, RunRecorder
from homolog.correspondence.schedule import StagePlan, TimeShares, plan_stages
from homolog.correspondence.start import Start
from homolog.correspondence.types import (
    Checkpoint,
    FrameCallback,
    InitialParticles,
    OptimizedParticles,
    Reason,
    Shape,
    Stage,
)
from homolog.errors import Cancelled, InputError, NumericalError
from homolog.geometry import inverse_matrices, rotation_of, scale_of, transform_points
from homolog.progress import LatestTick, Tick, part_of
from homolog.registration.entropy import entropy_step
from homolog.registration.procrustes import (
    alignments_of_particles,
    largest_turn,
    poses_of_particles,
    procrustes_step,
)
from homolog.settings import OptimizeSettings, Procrustes
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["OptimizationLoop"]

RECORD_INTERVAL = 20  # iterations between two records of the energies
PLATEAU_RECORDS = 10  # records whose mean is compared with that of the same number before
LOST_DISTANCE = 2.5  # distance from the mesh [optimizer lengths] from which a particle has left the surface
MAX_LOST_FRACTION = 0.3  # of a shape's particles; beyond it mesh and distance field disagree
SPLIT_OFFSET = 0.25  # of the Parzen width
ALIGNING_STEPS = 5  # by the first particles, where poses are free
MAX_POSE_REGULARIZATION = 0.1  # of H(Z) in the steps of the poses: few modes should explain the shapes
DOUBTFUL_TURN = np.radians(15.0)  # away from the registered alignment, while particles are few
CLEARLY_LOWER = 0.95  # of H(Z): when poses that were turned so far are given up
TANGENTIAL_WEIGHT = 0.01  # of tangential distances in pose steps while particles are few


class OptimizationLoop:
    """The loop over stages and iterations.

    Parameters
    ----------
    shapes : sequence of Shape
        Those of the prepared cohort.
    alignments : (M, 4, 4) array
        As given by the caller. The result keeps their scales unless size is removed.
    cohort : PreparedCohort
    settings : OptimizeSettings
    stages : sequence of StagePlan
    initial : InitialParticles or None
        None: particles are initialized by registration.
    tick, observe, on_checkpoint
        As in `homolog.correspondence.optimize`.
    counts : sequence of int, optional
        See `plan_stages`.

    Attributes
    ----------
    engine : Engine
        The particles; replaced at every split.
    free : (M, n) or (M, 1) bool array
        Particles that may move.
    repaired : (M, n) int32 array
        Iteration at which each particle was relocated, 0 if never; replaced with the engine.
    start : Start
        What the first particles told.
    """

    engine: Engine
    repaired: IntArray
    start: Start

    def __init__(
        self,
        shapes: Sequence[Shape],
        alignments: FloatArray,
        cohort: PreparedCohort,
        settings: OptimizeSettings,
        stages: Sequence[StagePlan],
        shares: TimeShares,
        initial: InitialParticles | None,
        tick: Tick,
        observe: FrameCallback | None = None,
        on_checkpoint: CheckpointCallback | None = None,
        counts: Sequence[int] | None = None,
    ) -> None:
        self.counts = counts
        self.cohort, self.settings, self.initial, self.stages = cohort, settings, initial, stages
        self.shapes, self.alignments = shapes, alignments
        scales = None if settings.procrustes is Procrustes.SHAPE else scale_of(alignments)
        compared = np.array([shape.alignment for shape in shapes]) if shapes else alignments
        self.log = RunRecorder(compared, scales, cohort.unit, observe, on_checkpoint)
        self.log.tangential_weight = TANGENTIAL_WEIGHT
        self.landmarks = landmarks_on_device(shapes, cohort, stages[0].count)
        self.shares, first = shares, shares.first_particles
        latest = LatestTick(tick, "first particles")
        self.initial_tick, self.tick = part_of(latest, 0.0, first), part_of(latest, first, 1.0)
        self.launcher = Launcher(cohort.device, poll_cancel=latest.repeat)
        free = None if initial is None else initial.free
        self.free = np.ones((len(cohort.names), 1), dtype=bool) if free is None else free
        self.tolerance = settings.tolerance * float(self.free.mean())  # the objective is per particle
        self.poses = np.tile(np.eye(4), (len(cohort.names), 1, 1))
        self.aligns = settings.procrustes not in (Procrustes.OFF, Procrustes.AUTO)
        self.scaling = settings.procrustes.takes_size_out
        self.free_poses: BoolArray = np.all(self.free, axis=1)  # shapes whose pose may change

    def run(self, resume: Checkpoint | None) -> Reason:
        """Run all stages, or the remaining ones of a checkpoint."""
        begin, done = 0, 0
        if resume is None:
            self.initialize(self.stages[0].count, self.initial_tick)
            self.begin(Start.of(self.compared_positions()))
        else:
            self.begin(Start(resume.parts, resume.variance, resume.left_out))
            begin, done = self.restore(resume), resume.done
        reason = Reason.ITERATIONS
        for index in range(begin, len(self.stages)):
            plan = self.stages[index]
            if self.needs_split(index):
                self.split_particles(index)
            begun = self.log.iteration - done
            reason = self._stage(index, done)
            self.repair(index, self.log.iteration - begun)
            if self._is_worse(index):
                return self.register_again(index)
            self.log.emit_frame(plan.stage, self.engine, ends_stage=index < len(self.stages) - 1)
            done = 0
        return reason

    def restore(self, resume: Checkpoint) -> int:
        """Continue from a checkpoint; return the number of its stage."""
        begin = self._stage_of(resume)
        self.log.restore(resume)
        self.poses = resume.poses
        saved = Particles(
            resume.positions,
            resume.widths,
            resume.means,
            resume.faces,
            (resume.neighbours, resume.coefficients),
        )
        self._set_particles(self.stages[begin].count, saved, resume.repaired.copy())
        return begin

    def compared_positions(self) -> FloatArray:
        """Return the particles as they are compared with each other, (M, n, 3) [optimizer lengths]."""
        return self.engine.aligned_positions()

    def begin(self, start: Start) -> None:
        """Use the weight of H(Z) that the first particles tell, if the settings had none."""
        self.start = start
        if self.settings.ensemble_weight is None:
            present = None if self.initial is None else self.initial.local.shape[1]
            self.settings = with_weight(self.settings, start.parts)
            self.stages = plan_stages(self.settings, present, len(self.shapes), self.counts)

    def _is_worse(self, index: int) -> bool:
        """Return whether a stage made the first particles predict each other worse than they did."""
        after = self.stages[index + 1].count if index + 1 < len(self.stages) else 0
        count = self.engine.count
        if self.initial is not None or not self.stages[0].count == count != after:
            return False  # compared are as many particles as were registered, when these are done
        return self.start.is_better_than(self.compared_positions())

    def register_again(self, index: int) -> Reason:
        """Register all particles, and leave them there."""
        self.poses = np.tile(np.eye(4), (len(self.cohort.names), 1, 1))
        self.stages = self.stages[: index + 1]
        done = self.shares.done(index, 1.0)
        self.log.tangential_weight = TANGENTIAL_WEIGHT
        self.initialize(self.settings.particles, part_of(self.tick, done, 1.0))
        return Reason.REGISTRATION

    def initialize(self, count: int, tick: Tick) -> None:
        """Place the initial particles."""
        if self.initial is not None:
            pairs = zip(self.cohort.to_optimizer, self.initial.local, strict=True)
            points = np.stack([similarity.apply(local) for similarity, local in pairs])
            if self.aligns:
                self.poses = poses_of_particles(points, self.poses, self.free_poses, scaling=self.scaling)
            self._set_particles(count, points)
            return
        start = self.poses
        registration = InitialRegistration(
            [
                TriangleMesh(similarity.apply(shape.mesh.vertices), shape.mesh.faces)
                for similarity, shape in zip(self.cohort.to_optimizer, self.shapes, strict=True)
            ],
            count,
            self.settings.seed,
            self.landmarks,
            part_of(tick, 0.0, 0.1),
        )
        first = 0.5 if self.aligns else 1.0  # of the progress; the rest is of a second try, if one is made
        self._register(registration, TANGENTIAL_WEIGHT, part_of(tick, 0.1, first))
        if not self.aligns or largest_turn(self.poses) < DOUBTFUL_TURN:
            return
        # The surface of a shape that differs much from the mean may lie nearest when it is turned over.
        turned, engine = self.poses, self.engine
        self.poses, self.log.tangential_weight = start, 1.0
        self._register(registration, 1.0, part_of(tick, first, 1.0))
        before, after = (
            ensemble_entropy(item.aligned_positions(), MAX_POSE_REGULARIZATION)
            for item in (engine, self.engine)
        )
        if after > CLEARLY_LOWER * before:
            self.poses, self.engine, self.log.tangential_weight = turned, engine, TANGENTIAL_WEIGHT

    def _register(self, registration: InitialRegistration, tangential_weight: float, tick: Tick) -> None:
        """Place particles by registration, and align the shapes by them.

        Only once: particles that slide turn the poses, and registered again in these they slide further.
        """
        points = registration.particles(self.poses, tick)
        self._set_particles(points.shape[1], points)
        for _ in range(ALIGNING_STEPS):
            self.align(tangential_weight)
        self.log.emit_frame(
            Stage.SPLITTING, self.engine, ends_stage=True
        )  # a first model, long before another

    def _stage_of(self, resume: Checkpoint) -> int:
        index = len(self.stages) - 1 - resume.left
        expected = (len(self.cohort.names), self.stages[max(index, 0)].count)
        fits = index >= 0 and resume.positions.shape[:2] == expected and len(resume.poses) == expected[0]
        fits = fits and bool((resume.neighbours < expected[1]).all())
        if fits:  # kernels do not check these indices
            meshes = self.cohort.surface_set(expected[1]).meshes
            rows = zip(resume.faces, meshes, strict=True)
            fits = all(row.min() >= 0 and row.max() < len(mesh.faces) for row, mesh in rows)
        if not fits:
            raise InputError("the checkpoint belongs to another cohort or other settings; start a new run")
        return index

    def _set_particles(
        self, count: int, particles: Particles | FloatArray, repaired: IntArray | None = None
    ) -> None:
        """Replace the engine; without `repaired` no particle counts as repaired."""
        zeros = np.zeros((len(self.cohort.names), count), np.int32)
        self.repaired = zeros if repaired is None else repaired
        free = None if self.initial is None else self.initial.free
        self.engine = make_engine(self.cohort, particles, self.launcher, self.poses, free)

    def align(self, tangential_weight: float = 1.0, regularization: float | None = None) -> None:
        """Align the shapes during the run: by Procrustes analysis, or to lower H(Z)."""
        if not self.aligns or not self.free_poses.any():
            return
        aligned = self.engine.aligned_positions()
        if regularization is not None:
            self.poses = entropy_step(
                aligned,
                self.poses,
                self.free_poses,
                scaling=self.scaling,
                regularization=regularization,
                compiled=self.launcher.device != "cpu",
            )
        else:
            self.poses = procrustes_step(
                aligned,
                self.engine.aligned_normals(),
                self.poses,
                self.free_poses,
                scaling=self.scaling,
                tangential_weight=tangential_weight,
            )
        self.engine.set_poses(self.poses)

    def needs_split(self, index: int) -> bool:
        """Return whether a stage has another number of particles than now."""
        return bool(self.stages[index].count != self.engine.count)

    def split_particles(self, index: int) -> None:
        """Replace the engine by one of more particles; its surfaces are released before others are made."""
        plan, old = self.stages[index], self.engine
        random = np.random.default_rng([self.settings.seed, plan.count])
        offset = SPLIT_OFFSET * old.width * scale_of(self.poses) * old.surface_set.sizes
        aligned = split(old.aligned_positions(), old.aligned_normals(), plan.count, offset, random)
        particles, repaired = old.particles(), self.repaired
        del old, self.engine
        self.launcher.forget()
        try:
            self.cohort.surface_set(
                plan.count, part_of(self.tick, self.shares.before(index), self.shares.done(index))
            )
            self._set_particles(plan.count, transform_points(inverse_matrices(self.poses), aligned))
        except Cancelled:
            self.repaired = repaired
            if index > 0:
                self._checkpoint(index - 1, self.stages[index - 1].iterations, [particles])
            raise

    def _stage(self, index: int, done: int) -> Reason:
        plan = self.stages[index]
        self.engine.start_stage([plan.weights(i) for i in range(plan.iterations)], done)
        self.log.begin_stage()
        if done == 0:
            self._checkpoint(index, done)
        elif self._has_converged(plan, done):
            return Reason.CONVERGED  # the run was cancelled while lost particles were relocated
        while done < plan.iterations:
            times = min(LIST_ITERATIONS, plan.iterations - done)
            self._iterate(index, done, times)
            done += times
            self.log.iteration += times
            if done % RECORD_INTERVAL == 0 or done == plan.iterations:
                self._record(plan)
                if self._has_converged(plan, done):
                    return Reason.CONVERGED
                self._follow_poses(plan, done)
            self._report(index, done)
        return Reason.ITERATIONS

    def _follow_poses(self, plan: StagePlan, done: int) -> None:
        """Align the shapes during a stage."""
        if plan.stage is Stage.SPLITTING:
            self.align(self.log.tangential_weight)
        else:
            regularization = plan.weights(min(done, plan.iterations - 1)).ensemble.regularization
            self.align(regularization=min(regularization, MAX_POSE_REGULARIZATION))

    def _has_converged(self, plan: StagePlan, done: int) -> bool:
        """Return whether the objective has converged or only fluctuates, at the newest record."""
        is_recorded = done % RECORD_INTERVAL == 0 or done >= plan.iterations
        if not (plan.until_converged and is_recorded and done >= 2 * RECORD_INTERVAL):
            return False
        return self.log.objective_change() < self.tolerance or (
            done >= 2 * PLATEAU_RECORDS * RECORD_INTERVAL
            and self.log.has_plateaued(PLATEAU_RECORDS, self.tolerance)
        )

    def _iterate(self, index: int, done: int, times: int) -> None:
        """Move the particles; if cancelled, checkpoint their positions from before."""
        before = self.particles() if self.launcher.device == "cpu" else None
        try:
            self.engine.iterate(times)
        except Cancelled:
            self._checkpoint(index, done, before)
            raise

    def _record(self, plan: StagePlan) -> None:
        parts = self.engine.energy(plan.coherence / plan.ensemble.weight) * plan.factors
        if not np.isfinite(parts).all():
            raise NumericalError(
                f"the objective is not a number at iteration {self.log.iteration}; run with another seed, or "
                "on another device"
            )
        self.log.record(parts)

    def repair(self, index: int, done: int) -> None:
        """Relocate lost particles at the end of a stage."""
        before, repaired = self.particles(), self.repaired.copy()
        try:
            self._relocate_lost()
        except Cancelled:
            self.repaired = repaired
            self._checkpoint(index, done, before)
            raise

    def _relocate_lost(self) -> None:
        """Move particles that have left their surfaces back onto them, unless surface and field disagree."""
        distances = self.engine.surface_distances()
        # Particles lie on the zero level, from which a coarse mesh deviates.
        limits = [[max(LOST_DISTANCE, 2.0 * mesh.mean_edge)] for mesh in self.engine.surface_set.meshes]
        if not ((distances >= limits) & self.free).any():
            return
        self.engine.find_faces()  # the walk over the mesh may have been trapped
        lost = (self.engine.surface_distances() >= limits) & self.free
        if not lost.any():
            return
        if (too_many := lost.mean(axis=1) > MAX_LOST_FRACTION).any():
            names = [name for name, bad in zip(self.cohort.names, too_many, strict=True) if bad]
            raise NumericalError(
                f"{', '.join(names)}: particles can't be kept on the surface, because it and its distance "
                "field disagree; groom the subject again, or exclude it"
            )
        self._relocate(lost)
        self.repaired[lost] = max(self.log.iteration, 1)

    def _relocate(self, misplaced: BoolArray) -> None:
        """Move particles (M, N) to where the other shapes predict them."""
        relocate(self.engine, misplaced)

    def _report(self, index: int, done: int) -> None:
        """Emit a frame, a checkpoint and the progress, when they are due."""
        self.log.emit_frame(self.stages[index].stage, self.engine)
        if self.log.checkpoint_is_due():
            self._checkpoint(index, done)
        plan, expected = self.stages[index], self.stages[index].expected_iterations
        if plan.until_converged and done >= 2 * RECORD_INTERVAL:
            left = self.log.records_to_convergence(self.tolerance)
            expected = RECORD_INTERVAL * (done // RECORD_INTERVAL + left)
        text = f"{plan.stage.value}: {plan.count} particles{repairs_text(self.repaired)}"
        try:
            self.tick(self.shares.done(index, done / expected), text)
        except Cancelled:
            self._checkpoint(index, done)
            raise

    def particles(self) -> list[Particles]:
        """Return copies of the state of each structure."""
        return [self.engine.particles()]

    def _checkpoint(self, index: int, done: int, particles: Sequence[Particles] | None = None) -> None:
        left = len(self.stages) - 1 - index
        (now,) = particles or self.particles()
        self.log.save(self.log.state(now, self.poses, left, done, self.repaired, self.start))

    def local_positions(self) -> FloatArray:
        """Return the particles in the coordinates of the shapes, (M, n, 3) [mm]."""
        positions = self.engine.host_positions().astype(np.float64)
        pairs = zip(self.cohort.to_optimizer, positions, strict=True)
        return np.stack([similarity.invert(points) for similarity, points in pairs])

    def result(self, reason: Reason) -> OptimizedParticles:
        """Return the particles in millimetres."""
        local = self.local_positions()
        if self.initial is not None and self.initial.free is not None:
            local = np.where(self.initial.free[..., None], local, self.initial.local)
        poses, alignments = self.log.aligned(self.poses), self.alignments
        if self.aligns:
            scaling = self.settings.procrustes is Procrustes.SHAPE
            alignments = alignments_of_particles(local, alignments, poses, self.free_poses, scaling=scaling)
        rotation_matrices = rotation_of(alignments) @ rotation_of(poses).transpose(0, 2, 1)
        return OptimizedParticles(
            world=transform_points(alignments, local),
            local=local,
            normals=np.einsum("mij,mnj->mni", rotation_matrices, self.engine.aligned_normals()),
            energies=self.log.energies,
            alignments=alignments,
            iterations=self.log.iteration,
            reason=reason,
            repaired=self.repaired,
        )
