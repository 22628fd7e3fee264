"""The optimization, from a few particles on every shape to all of them."""

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.correspondence.domain import AREA, Domain, prepare
from homolog.correspondence.engine import LIST_LIFE, Engine, Particles
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.schedule import Plan, plan_stages
from homolog.correspondence.splitting import split
from homolog.correspondence.start import first_particles
from homolog.correspondence.types import Checkpoint, Correspondence, Frame, Observe, Reason, Shape
from homolog.errors import Cancelled, InputError, NumericalError
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings

__all__ = ["optimize"]

RECORD = 20  # iterations between two rows of the energy table
KEEP_S = 30.0  # seconds between two checkpoints
FRAME_S = 0.05  # seconds between two frames
LOST = 5.0  # optimizer lengths from the mesh, of a particle that is not on the surface any more
SPLIT_OFFSET = 0.25  # of the Parzen width

Keep = Callable[[Checkpoint], None]


def optimize(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    *,
    device: str = "cpu",
    tick: Tick = no_tick,
    observe: Observe | None = None,
    checkpoint: Keep | None = None,
    resume: Checkpoint | None = None,
) -> Correspondence:
    """Place corresponding particles on all shapes (the paper's Eq. 5).

    Parameters
    ----------
    shapes : sequence of Shape
        M of them, at least two.
    settings : OptimizeSettings
        Method, number of particles, weights and schedule.
    device : str
        Warp alias of the device.
    tick : Tick
        Progress and cancelling. When it raises `Cancelled`, a last checkpoint is handed over first.
    observe : callable, optional
        Takes the newest `Frame`, at most 20 times a second.
    checkpoint : callable, optional
        Takes a `Checkpoint` at every split and every 30 s.
    resume : Checkpoint, optional
        Where a broken-off run of the same shapes and settings goes on; on the CPU it ends bit-identical
        to one that was not broken off.

    Raises
    ------
    InputError
        If there are fewer than two shapes, or the checkpoint does not fit.
    NumericalError
        If a particle is lost (a position that is no number).
    """
    if len(shapes) < 2:
        raise InputError("correspondence needs at least two shapes")
    geometry = 0.3 if settings.method.uses_geodesics else 0.02
    domain = prepare(shapes, settings, device=device, tick=part_of(tick, 0.0, geometry))
    journey = _Journey(domain, settings, part_of(tick, geometry, 1.0), observe, checkpoint)
    try:
        reason = journey.run(resume)
    finally:
        journey.launcher.close()
    return journey.result(shapes, reason)


class _Journey:
    """The loop over stages and iterations, with its clocks."""

    def __init__(
        self,
        domain: Domain,
        settings: OptimizeSettings,
        tick: Tick,
        observe: Observe | None,
        keep: Keep | None,
    ) -> None:
        self.domain, self.settings, self.observe, self.keep = domain, settings, observe, keep
        self.start_tick, self.tick = part_of(tick, 0.0, 0.05), part_of(tick, 0.05, 1.0)
        self.launcher = Launcher(domain.device)
        self.stages = plan_stages(settings)
        self.energies: list[list[float]] = []
        self.iteration = 0
        self._next_frame = self._next_checkpoint = 0.0
        self._costs = np.array([plan.iterations * (plan.count + 256.0) for plan in self.stages])

    def run(self, resume: Checkpoint | None) -> Reason:
        """Go through the stages, the first or the rest of them."""
        start, done = 0, 0
        if resume is None:
            first = first_particles(
                self.domain.coarse.meshes, self.stages[0].count, self.settings.seed, self.start_tick
            )
            self.engine = self._engine(self.stages[0], first)
        else:
            start, done = resume.stage, resume.done
            self.iteration, self.energies = resume.iteration, resume.energies.tolist()
            self.engine = self._engine(self._checked(resume), _particles(resume))
        reason = Reason.ITERATIONS
        for index in range(start, len(self.stages)):
            plan = self.stages[index]
            if plan.count != self.engine.count:
                self._split(plan)
            reason = self._stage(index, done)
            self._check_particles()
            done = 0
        return reason

    def _checked(self, resume: Checkpoint) -> Plan:
        plan = self.stages[min(resume.stage, len(self.stages) - 1)]
        if resume.positions.shape[:2] != (len(self.domain.names), plan.count):
            raise InputError("the checkpoint belongs to another cohort or other settings; start the run anew")
        return plan

    def _engine(self, plan: Plan, particles: Particles | FloatArray) -> Engine:
        level = self.domain.level(plan.count)
        geodesic = self.domain.geodesic
        return Engine(
            self.domain.fields, level, particles, geodesic=geodesic, area=AREA, launcher=self.launcher
        )

    def _split(self, plan: Plan) -> None:
        old = self.engine
        random = np.random.default_rng([self.settings.seed, plan.count])
        offset = SPLIT_OFFSET * old.width
        self.engine = self._engine(
            plan, split(old.host_positions(), old.host_normals(), plan.count, offset, random)
        )

    def _stage(self, index: int, done: int) -> Reason:
        plan = self.stages[index]
        self.engine.start_stage([plan.weights(i) for i in range(plan.iterations)], done)
        self._next_frame = 0.0  # a stage is seen however short it is
        if done == 0:
            self._checkpoint(index, done)
        before = math.inf
        while done < plan.iterations:
            times = min(LIST_LIFE, plan.iterations - done)
            self.engine.iterate(times)
            done += times
            self.iteration += times
            if done % RECORD == 0 or done == plan.iterations:
                objective = self._record(plan)
                if plan.until_converged and abs(before - objective) < self.settings.tolerance:
                    return Reason.CONVERGED
                before = objective
            self._report(index, done)
        return Reason.ITERATIONS

    def _record(self, plan: Plan) -> float:
        parts = self.engine.energy() * [1.0, plan.weight, plan.normals_weight]
        if not np.isfinite(parts).all():
            self._check_particles()
        self.energies.append([float(self.iteration), *parts.tolist()])
        return float(parts.sum())

    def _check_particles(self) -> None:
        """Refuse to go on with particles that are not on their surfaces."""
        gaps = self.engine.gaps()
        names = [name for name, gap in zip(self.domain.names, gaps, strict=True) if not gap < LOST]
        if names:
            raise NumericalError(
                f"{', '.join(names)}: particles left the surface by iteration {self.iteration}; look at the "
                "groomed surface, or run with another seed"
            )

    def _report(self, index: int, done: int) -> None:
        """Frame, checkpoint and tick, when they are due."""
        now = time.monotonic()
        if self.observe is not None and now >= self._next_frame and self.energies:
            self._next_frame = now + FRAME_S
            self.observe(self._frame(index))
        if now >= self._next_checkpoint:
            self._checkpoint(index, done)
        plan = self.stages[index]
        behind = self._costs[:index].sum() + self._costs[index] * done / plan.iterations
        try:
            self.tick(behind / self._costs.sum(), f"{plan.stage.value}: {plan.count} particles")
        except Cancelled:
            self._checkpoint(index, done)
            raise

    def _frame(self, index: int) -> Frame:
        world = self.engine.host_positions().astype(np.float64) * self.domain.unit
        return Frame(self.stages[index].stage, self.iteration, world, np.array(self.energies[-1][1:]))

    def _checkpoint(self, index: int, done: int) -> None:
        self._next_checkpoint = time.monotonic() + KEEP_S
        if self.keep is None:
            return
        now = self.engine.particles()
        energies = np.array(self.energies).reshape(-1, 4)
        self.keep(
            Checkpoint(index, done, self.iteration, now.positions, now.widths, now.means, now.faces, energies)
        )

    def result(self, shapes: Sequence[Shape], reason: Reason) -> Correspondence:
        """Return the particles in millimetres."""
        positions = self.engine.host_positions().astype(np.float64)
        local = [place.invert(one) for place, one in zip(self.domain.placements, positions, strict=True)]
        return Correspondence(
            world=positions * self.domain.unit,
            local=np.stack(local),
            normals=self.engine.host_normals().astype(np.float64),
            energies=np.array(self.energies).reshape(-1, 4),
            alignments=np.stack([shape.alignment for shape in shapes]),
            iterations=self.iteration,
            reason=reason,
        )


def _particles(saved: Checkpoint) -> Particles:
    return Particles(saved.positions, saved.widths, saved.means, saved.faces)
