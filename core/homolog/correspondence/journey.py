"""The way through the stages: first particles, iterations, splits, repairs, convergence."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.correspondence.domain import AREA, Domain, placed_landmarks
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.logbook import Keep, Logbook
from homolog.correspondence.poses import inverted, procrustes, transformed
from homolog.correspondence.sampling import LIST_LIFE
from homolog.correspondence.schedule import Plan
from homolog.correspondence.splitting import split
from homolog.correspondence.start import first_particles
from homolog.correspondence.strays import put_right
from homolog.correspondence.types import (
    Checkpoint,
    Correspondence,
    Observe,
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
LOST = 5.0  # optimizer lengths from the mesh, of a particle that is not on the surface any more
SPLIT_OFFSET = 0.25  # of the Parzen width
START_ROUNDS, ALIGNING_ROUNDS = 4, 5  # of first particles and poses in turn, where poses may change
SLIDING = 0.01  # of distances in the surface, for poses while particles are still few


class Journey:
    """The loop over stages and iterations."""

    def __init__(
        self,
        shapes: Sequence[Shape],
        domain: Domain,
        settings: OptimizeSettings,
        stages: Sequence[Plan],
        start: Start | None,
        tick: Tick,
        observe: Observe | None,
        keep: Keep | None,
    ) -> None:
        self.domain, self.settings, self.start, self.stages = domain, settings, start, stages
        self.log = Logbook(np.stack([shape.alignment for shape in shapes]), domain.unit, observe, keep)
        self.landmarks = placed_landmarks(shapes, domain, stages[0].count)
        self.start_tick, self.tick = part_of(tick, 0.0, 0.05), part_of(tick, 0.05, 1.0)
        self._now = (0.0, "first particles")
        self.launcher = Launcher(domain.device, breathe=lambda: self.tick(*self._now))
        free = 1.0 if start is None or start.movable is None else float(start.movable.mean())
        self.tolerance = settings.tolerance * free  # the objective is per particle, of all
        self.poses = np.tile(np.eye(4), (len(domain.names), 1, 1))
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
            self._check_particles()
            done = 0
        return reason

    def _begin(self) -> None:
        """Place the particles to begin with."""
        count = self.stages[0].count
        if self.start is not None:
            pairs = zip(self.domain.placements, self.start.local, strict=True)
            self.engine = self._engine(count, np.stack([place.apply(one) for place, one in pairs]))
            self._align(sliding=1.0)
            return
        rounds = 1 if self.settings.procrustes is Procrustes.OFF else START_ROUNDS
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
            raise InputError("the checkpoint belongs to another cohort or other settings; start the run anew")
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

    def _align(self, sliding: float) -> None:
        """Bring the shapes onto their mean, if they may be aligned on the way."""
        if self.settings.procrustes is Procrustes.OFF:
            return
        free = np.full(len(self.poses), True)
        if self.start is not None and self.start.movable is not None:
            free = np.all(self.start.movable, axis=1)
        scaling = self.settings.procrustes is Procrustes.SIMILARITY
        posed = self.engine.posed_positions(), self.engine.posed_normals()
        self.poses = procrustes(*posed, self.poses, free, scaling=scaling, sliding=sliding)
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
        self._align(SLIDING if plan.stage is Stage.SPLITTING else 1.0)
        return False

    def _settled(self, plan: Plan, done: int) -> bool:
        """Whether the objective changed little between a stage's last two records, the last being now."""
        if not plan.until_converged or done < 2 * RECORD or (done % RECORD and done < plan.iterations):
            return False
        return self.log.changed() < self.tolerance

    def _put_right(self, index: int, done: int) -> bool:
        """Move strays to where the other shapes have them; False if there are none.

        Each before it settles, and once while it does, so that this comes to an end.
        """
        if not self.settings.method.uses_normals:
            return False
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
            self._check_particles()
        self.log.record(parts)

    def _check_particles(self) -> None:
        """Refuse to go on with particles that are not on their surfaces."""
        gaps = self.engine.gaps()
        # a coarse mesh cuts corners of the surface that particles are on
        limits = [max(LOST, 2.0 * mesh.mean_edge) for mesh in self.engine.level.meshes]
        if (gaps >= limits).any():  # without geodesics nothing keeps a particle from leaping to another wall
            self.engine.find_again()
            gaps = self.engine.gaps()
        names = [
            name for name, gap, limit in zip(self.domain.names, gaps, limits, strict=True) if not gap < limit
        ]
        if names:
            raise NumericalError(
                f"{', '.join(names)}: particles left the surface by iteration {self.log.iteration}; look at "
                "the groomed surface, or run with another seed"
            )

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
        return f", {count} put right on {shapes} shape{'s' if shapes > 1 else ''}" if count else ""

    def _checkpoint(self, index: int, done: int, particles: Particles | None = None) -> None:
        self.log.save(self.engine, len(self.stages) - 1 - index, done, self.repaired, particles)

    def result(self, reason: Reason) -> Correspondence:
        """Return the particles in millimetres."""
        positions = self.engine.host_positions().astype(np.float64)
        local = np.stack([p.invert(one) for p, one in zip(self.domain.placements, positions, strict=True)])
        if self.start is not None and self.start.movable is not None:
            local = np.where(self.start.movable[..., None], local, self.start.local)
        alignments = self.log.aligned(self.poses)
        return Correspondence(
            world=transformed(alignments, local),
            local=local,
            normals=self.engine.posed_normals(),
            energies=self.log.energies,
            alignments=alignments,
            iterations=self.log.iteration,
            reason=reason,
            repaired=self.repaired,
        )


def _particles(saved: Checkpoint) -> Particles:
    return Particles(saved.positions, saved.widths, saved.means, saved.faces)
