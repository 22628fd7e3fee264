"""The way through the stages: first particles, iterations, splits, repairs, convergence."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.domain import AREA, Domain, placed_landmarks
from homolog.correspondence.engine import Engine, Particles, turns_of
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.logbook import Keep, Logbook
from homolog.correspondence.poses import (
    entropic,
    generalized,
    inverted,
    onto_mean,
    procrustes,
    rescaled,
    scales_of,
    transformed,
)
from homolog.correspondence.sampling import LIST_LIFE
from homolog.correspondence.schedule import Plan
from homolog.correspondence.splitting import split
from homolog.correspondence.start import first_particles
from homolog.correspondence.strays import move_back, put_right
from homolog.correspondence.types import (
    Checkpoint,
    Observe,
    OptimizedParticles,
    Reason,
    Shape,
    Stage,
    Start,
)
from homolog.errors import Cancelled, InputError, NumericalError
from homolog.progress import Tick, part_of
from homolog.settings import OptimizeSettings, Procrustes
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Journey"]

RECORD = 20  # iterations between two rows of the energy table
PLATEAU = 10  # records whose mean is compared with that of as many before
LOST = 2.5  # optimizer lengths from the mesh, of a particle that is not on the surface any more
MOST_LOST = 0.3  # of a shape's particles: if more are off its mesh, mesh and field are not of one surface
SPLIT_OFFSET = 0.25  # of the Parzen width
START_ROUNDS, ALIGNING_ROUNDS = 4, 5  # of first particles and poses in turn, where poses may change
POSE_REGULARIZATION = (
    0.1  # of H(Z) at most, when poses are to lower it: few modes are to tell the shapes apart
)
SLIDING = 0.01  # of distances in the surface, for poses while particles are still few


class Journey:
    """The loop over stages and iterations.

    `shapes` are those that the domain was made of, and `alignments` (M, 4, 4) those that they were given
    with, whose scales the result keeps unless size is taken out of it.
    """

    def __init__(
        self,
        shapes: Sequence[Shape],
        alignments: FloatArray,
        domain: Domain,
        settings: OptimizeSettings,
        stages: Sequence[Plan],
        start: Start | None,
        tick: Tick,
        observe: Observe | None,
        keep: Keep | None,
    ) -> None:
        self.domain, self.settings, self.start, self.stages = domain, settings, start, stages
        self.alignments = alignments
        scales = None if settings.procrustes is Procrustes.SIMILARITY else scales_of(alignments)
        compared = np.stack([shape.alignment for shape in shapes])
        self.log = Logbook(compared, scales, domain.unit, observe, keep)
        self.landmarks = placed_landmarks(shapes, domain, stages[0].count)
        self.start_tick, self.tick = part_of(tick, 0.0, 0.05), part_of(tick, 0.05, 1.0)
        self._now = (0.0, "first particles")
        self.launcher = Launcher(domain.device, breathe=lambda: self.tick(*self._now))
        free = 1.0 if start is None or start.movable is None else float(start.movable.mean())
        self.tolerance = settings.tolerance * free  # the objective is per particle, of all
        self.poses = np.tile(np.eye(4), (len(domain.names), 1, 1))
        self.aligns = settings.procrustes not in (Procrustes.OFF, Procrustes.AUTO)
        self.scaling = settings.procrustes.takes_size_out
        self.free: BoolArray = np.full(len(domain.names), True)  # shapes whose pose may change
        if start is not None and start.movable is not None:
            self.free = np.all(start.movable, axis=1)
        self._costs = np.array([plan.usual * (plan.count + 256.0) for plan in self.stages])

    def run(self, resume: Checkpoint | None) -> Reason:
        """Go through the stages, the first or the rest of them."""
        begin, done = 0, 0
        if resume is None:
            self._begin()
        else:
            begin, done = self._stage_of(resume), resume.done
            self.log.go_on(resume)
            self.poses = resume.poses
            self.engine = self._engine(self.stages[begin].count, _particles(resume))
            self.repaired = resume.repaired.copy()
        reason = Reason.ITERATIONS
        for index in range(begin, len(self.stages)):
            plan = self.stages[index]
            if plan.count != self.engine.count:
                try:
                    self._split(plan)
                except Cancelled:
                    if index > 0:
                        self._checkpoint(index - 1, self.stages[index - 1].iterations)
                    raise
            reason = self._stage(index, done)
            self._return_lost()
            done = 0
        return reason

    def _begin(self) -> None:
        """Place the particles to begin with."""
        count = self.stages[0].count
        if self.start is not None:
            pairs = zip(self.domain.placements, self.start.local, strict=True)
            points = np.stack([place.apply(one) for place, one in pairs])
            if self.aligns and not self.free.all():  # those that stay are brought to their own mean
                stay = ~self.free
                self.poses[stay] = generalized(points[stay], self.poses[stay], scaling=self.scaling)
                self.poses = onto_mean(points, self.poses, self.free, scaling=self.scaling)
            elif self.aligns:
                self.poses = generalized(points, self.poses, scaling=self.scaling)
            self.engine = self._engine(count, points)
            return
        rounds = START_ROUNDS if self.aligns else 1
        for number in range(rounds):
            meshes = [
                TriangleMesh(transformed(pose[None], mesh.vertices[None])[0], mesh.faces)
                for pose, mesh in zip(self.poses, self.domain.level(count).meshes, strict=True)
            ]
            tick = part_of(self.start_tick, number / rounds, (number + 1) / rounds)
            landmarks = None if self.landmarks is None else transformed(self.poses, self.landmarks)
            posed = first_particles(meshes, count, self.settings.seed, tick, landmarks)
            self.engine = self._engine(count, transformed(inverted(self.poses), posed))
            for _ in range(ALIGNING_ROUNDS):
                self._align(sliding=SLIDING)

    def _stage_of(self, resume: Checkpoint) -> int:
        index = len(self.stages) - 1 - resume.left
        expected = (len(self.domain.names), self.stages[max(index, 0)].count)
        fits = index >= 0 and resume.positions.shape[:2] == expected
        if fits:  # kernels follow these numbers without asking
            meshes = self.domain.level(expected[1]).meshes
            rows = zip(resume.faces, meshes, strict=True)
            fits = all(row.min() >= 0 and row.max() < len(mesh.faces) for row, mesh in rows)
        if not fits:
            raise InputError("the checkpoint belongs to another cohort or other settings; start a new run")
        return index

    def _engine(self, count: int, particles: Particles | FloatArray) -> Engine:
        self.repaired = np.zeros((len(self.domain.names), count), np.int32)
        return Engine(
            self.domain.fields,
            self.domain.reliefs,
            self.domain.level(count),
            particles,
            geodesic=self.domain.geodesic,
            area=AREA,
            launcher=self.launcher,
            poses=self.poses,
            movable=None if self.start is None else self.start.movable,
        )

    def _align(self, sliding: float = 1.0, regularization: float | None = None) -> None:
        """Bring shapes onto their mean if they may be aligned on the way, or lower H(Z) by their poses."""
        if not self.aligns or not self.free.any():
            return
        posed = self.engine.posed_positions(), self.engine.posed_normals()
        if regularization is not None:
            self.poses = entropic(
                posed[0], self.poses, self.free, scaling=self.scaling, regularization=regularization
            )
            self.engine.pose(self.poses)
            return
        self.poses = procrustes(*posed, self.poses, self.free, scaling=self.scaling, sliding=sliding)
        self.engine.pose(self.poses)

    def _split(self, plan: Plan) -> None:
        old = self.engine
        random = np.random.default_rng([self.settings.seed, plan.count])
        scales = np.cbrt(np.linalg.det(self.poses[:, :3, :3]))
        offset = SPLIT_OFFSET * old.width * scales * old.level.sizes
        posed = split(old.posed_positions(), old.posed_normals(), plan.count, offset, random)
        self.engine = self._engine(plan.count, transformed(inverted(self.poses), posed))

    def _stage(self, index: int, done: int) -> Reason:
        plan = self.stages[index]
        self.engine.start_stage([plan.weights(i) for i in range(plan.iterations)], done)
        self.log.begin_stage()
        if done == 0:
            self._checkpoint(index, done)
            if plan.until_converged:
                self._put_right(index, done)
        elif (
            self.repaired.max() < self.log.iteration
            and self._settled(plan, done)
            and self._is_done(index, done)
        ):
            return Reason.CONVERGED  # it was cancelled while strays were put right
        while done < plan.iterations:
            times = min(LIST_LIFE, plan.iterations - done)
            self._iterate(index, done, times)
            done += times
            self.log.iteration += times
            if done % RECORD == 0 or done == plan.iterations:
                self._record(plan)
                if self._is_done(index, done):
                    return Reason.CONVERGED
            self._report(index, done)
        return Reason.ITERATIONS

    def _is_done(self, index: int, done: int) -> bool:
        """Whether a stage is converged; if not, align the shapes and go on."""
        plan = self.stages[index]
        if self._settled(plan, done) and not self._put_right(index, done):
            return True
        if plan.stage is Stage.SPLITTING:
            self._align(SLIDING)
        else:
            here = plan.weights(min(done, plan.iterations - 1)).regularization
            self._align(regularization=min(here, POSE_REGULARIZATION))
        return False

    def _settled(self, plan: Plan, done: int) -> bool:
        """Whether the objective changes little between records, or only fluctuates; the last is now."""
        if not plan.until_converged or done < 2 * RECORD or (done % RECORD and done < plan.iterations):
            return False
        return self.log.changed() < self.tolerance or (
            done >= 2 * PLATEAU * RECORD and self.log.has_stopped_falling(PLATEAU, self.tolerance)
        )

    def _put_right(self, index: int, done: int) -> bool:
        """Move strays to where the other shapes have them; False if there are none.

        Each before it settles, and once while it does, so that this comes to an end.
        """
        if not self.settings.method.uses_normals or 2 * done > self.stages[index].iterations:
            return False  # from the middle on the particles settle undisturbed
        allowed = self.repaired <= self.log.iteration - done
        if self.start is not None and self.start.movable is not None:
            allowed &= self.start.movable
        before = self.engine.particles()
        try:
            moved = put_right(self.engine, allowed)
        except Cancelled:
            self._checkpoint(index, done, before)
            raise
        self.repaired[moved] = self.log.iteration
        return bool(moved.any())

    def _iterate(self, index: int, done: int, times: int) -> None:
        """Move the particles; if that is cancelled on the way, keep where they were before."""
        before = self.engine.particles() if self.launcher.device == "cpu" else None
        try:
            self.engine.iterate(times)
        except Cancelled:
            self._checkpoint(index, done, before)
            raise

    def _record(self, plan: Plan) -> None:
        parts = self.engine.energy() * [1.0, plan.weight, plan.normals_weight]
        if not np.isfinite(parts).all():
            raise NumericalError(
                f"the objective is not a number at iteration {self.log.iteration}; run with another seed, or "
                "on another device"
            )
        self.log.record(parts)

    def _return_lost(self) -> None:
        """Put particles that are not on their surfaces back onto them.

        Raises
        ------
        NumericalError
            If so many are that a subject's surface and distance field must disagree.
        """
        # a coarse mesh cuts corners of the surface that particles are on
        limits = np.array([[max(LOST, 2.0 * mesh.mean_edge)] for mesh in self.engine.level.meshes])
        movable = True if self.start is None or self.start.movable is None else self.start.movable
        if not ((self.engine.gaps() >= limits) & movable).any():
            return
        self.engine.find_again()  # it may be the walk over the mesh that went astray
        lost = (self.engine.gaps() >= limits) & movable
        if not lost.any():
            return
        if (elsewhere := lost.mean(axis=1) > MOST_LOST).any():
            names = [name for name, bad in zip(self.domain.names, elsewhere, strict=True) if bad]
            raise NumericalError(
                f"{', '.join(names)}: particles can't be kept on the surface, because it and its distance "
                "field disagree; groom the subject again, or exclude it"
            )
        move_back(self.engine, lost)
        self.repaired[lost] = max(self.log.iteration, 1)

    def _report(self, index: int, done: int) -> None:
        """Frame, checkpoint and tick, when they are due."""
        self.log.show(self.stages[index].stage, self.engine)
        if self.log.checkpoint_is_due():
            self._checkpoint(index, done)
        plan = self.stages[index]
        behind = self._costs[:index].sum() + self._costs[index] * min(1.0, done / plan.usual)
        self._now = (
            behind / self._costs.sum(),
            f"{plan.stage.value}: {plan.count} particles{self._repairs()}",
        )
        try:
            self.tick(*self._now)
        except Cancelled:
            self._checkpoint(index, done)
            raise

    def _repairs(self) -> str:
        count, shapes = np.count_nonzero(self.repaired), np.count_nonzero(self.repaired.any(axis=1))
        return f", {count} repaired on {shapes} shape{'s' if shapes > 1 else ''}" if count else ""

    def _checkpoint(self, index: int, done: int, particles: Particles | None = None) -> None:
        self.log.save(self.engine, len(self.stages) - 1 - index, done, self.repaired, particles)

    def result(self, reason: Reason) -> OptimizedParticles:
        """Return the particles in millimetres."""
        positions = self.engine.host_positions().astype(np.float64)
        local = np.stack([p.invert(one) for p, one in zip(self.domain.placements, positions, strict=True)])
        if self.start is not None and self.start.movable is not None:
            local = np.where(self.start.movable[..., None], local, self.start.local)
        alignments = self._alignments(local)
        turns = turns_of(alignments) @ turns_of(self.log.aligned(self.poses)).transpose(0, 2, 1)
        return OptimizedParticles(
            world=transformed(alignments, local),
            local=local,
            normals=np.einsum("mij,mnj->mni", turns, self.engine.posed_normals()),
            energies=self.log.energies,
            alignments=alignments,
            iterations=self.log.iteration,
            reason=reason,
            repaired=self.repaired,
        )

    def _alignments(self, local: FloatArray) -> FloatArray:
        """Return the similarities from file to world coordinates that the result has, (M, 4, 4).

        They come from the particles. Shapes that stay keep theirs; others are brought to the mean of those.
        """
        if not self.aligns:
            return self.alignments
        scaling = self.settings.procrustes is Procrustes.SIMILARITY
        if self.free.all():
            similarities = self.log.aligned(self.poses)
            if not scaling:
                middles = transformed(similarities, local).mean(axis=1)
                similarities = rescaled(similarities, scales_of(self.alignments), middles)
            return generalized(local, similarities, scaling=scaling)
        return onto_mean(local, self.alignments, self.free, scaling=scaling)


def _particles(saved: Checkpoint) -> Particles:
    return Particles(saved.positions, saved.widths, saved.means, saved.faces)
