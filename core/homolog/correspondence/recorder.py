"""Records of a running optimization: energies, frames for display, checkpoints."""

import math
import time
from collections.abc import Callable

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.start import Start
from homolog.correspondence.types import Checkpoint, Frame, FrameCallback, Stage
from homolog.geometry import scale_of
from homolog.registration.procrustes import rescale

__all__ = ["CheckpointCallback", "RunRecorder"]

CHECKPOINT_INTERVAL_S = 20.0  # with the iterations in progress no more than 30 s are lost
FRAME_INTERVAL_S = 0.05

CheckpointCallback = Callable[[Checkpoint], None]

_DECREASE = 0.7
"""Typical ratio of successive changes of the objective on real cohorts, for estimates."""


class RunRecorder:
    """Records energies; emits frames and checkpoints at regular intervals.

    Parameters
    ----------
    alignments : (M, 4, 4) array
        Similarities from file to world coordinates at the start of the run.
    scales : (M,) array or None
        Scales of the shapes in frames; None for those of the alignments.
    unit : float
        Optimizer's unit of length [mm of the world frame].
    observe : callable, optional
        Takes frames.
    keep : callable, optional
        Takes checkpoints.
    """

    def __init__(
        self,
        alignments: FloatArray,
        scales: FloatArray | None,
        unit: float,
        observe: FrameCallback | None,
        on_checkpoint: CheckpointCallback | None,
    ) -> None:
        self.alignments, self.scales, self.unit = alignments, scales, unit
        self.observe, self.on_checkpoint = observe, on_checkpoint
        self.rows: list[list[float]] = []
        self.iteration = 0
        self.tangential_weight = 1.0
        self._next_frame = self._next_checkpoint = 0.0

    def restore(self, saved: Checkpoint) -> None:
        """Restore the records of a checkpoint."""
        self.rows, self.iteration = saved.energies.tolist(), saved.iteration
        self.tangential_weight = saved.tangential_weight

    def record(self, parts: FloatArray) -> None:
        """Record the three terms of the objective at this iteration."""
        self.rows.append([float(self.iteration), *parts.tolist()])

    def objective_change(self) -> float:
        """Return the absolute change of the objective between the last two records."""
        before, now = (float(np.sum(row[1:])) for row in self.rows[-2:])
        return abs(before - now)

    def records_to_convergence(self, tolerance: float) -> int:
        """Estimate the number of further records until the objective changes by less than a tolerance."""
        excess = self.objective_change() / tolerance
        return max(1, math.ceil(math.log(max(excess, 1.0)) / -math.log(_DECREASE)))

    def has_plateaued(self, records: int, tolerance: float) -> bool:
        """Return whether the objective decreases by no more than it fluctuates, over the last 2 `records`.

        On surfaces with handles smaller than the particle spacing, a few particles have no equilibrium and
        the objective keeps fluctuating.
        """
        before, now = np.array(self.rows)[-2 * records :, 1:].sum(axis=1).reshape(2, records)
        error = np.sqrt((before.var(ddof=1) + now.var(ddof=1)) / records)
        return bool(before.mean() - now.mean() < max(tolerance, 2.0 * error))

    @property
    def energies(self) -> FloatArray:
        """Iteration and the three parts of the objective, (T, 4)."""
        return np.array(self.rows).reshape(-1, 4)

    def aligned(self, poses: FloatArray) -> FloatArray:
        """Return the similarities from file to world coordinates under poses, (M, 4, 4) both."""
        shifted = poses.copy()
        shifted[:, :3, 3] *= self.unit
        return shifted @ self.alignments

    def begin_stage(self) -> None:
        """Make the next frame due at once, so that even a short stage is shown."""
        self._next_frame = 0.0

    def emit_frame(self, stage: Stage, engine: Engine, *, ends_stage: bool = False) -> None:
        """Emit a frame if one is due and energies have been recorded, or a stage ends.

        Parameters
        ----------
        stage : Stage
            The present stage.
        engine : Engine
            Whose particles are shown.
        ends_stage : bool
            Whether the stage ends here: a frame is then always emitted.
        """
        now = time.monotonic()
        is_due = bool(self.rows) and now >= self._next_frame
        if self.observe is None or not (is_due or ends_stage):
            return
        self._next_frame = now + FRAME_INTERVAL_S
        self.observe(self.frame(stage, engine, ends_stage=ends_stage))

    def frame(self, stage: Stage, engine: Engine, *, ends_stage: bool) -> Frame:
        """Return the particles of an engine at this moment; see `emit_frame`."""
        world, alignments = engine.aligned_positions() * self.unit, self.aligned(engine.poses)
        if self.scales is not None:
            centres, before = world.mean(axis=1), scale_of(alignments)
            alignments = rescale(alignments, self.scales, centres)
            growth = (self.scales / before)[:, None, None]
            world = centres[:, None] + growth * (world - centres[:, None])
        latest = np.array(self.rows[-1][1:]) if self.rows else np.full(3, np.nan)
        return Frame(stage, self.iteration, world, latest, alignments, ends_stage)

    def checkpoint_is_due(self) -> bool:
        """Return whether a checkpoint is due."""
        return time.monotonic() >= self._next_checkpoint

    def state(
        self,
        particles: Particles,
        poses: FloatArray,
        left: int,
        done: int,
        repaired: IntArray,
        start: Start,
    ) -> Checkpoint:
        """Return a checkpoint.

        Parameters
        ----------
        particles : Particles
            State of an engine.
        poses, left, done, repaired
            As in `Checkpoint`.
        start : Start
            What the first particles told.
        """
        return Checkpoint(
            left=left,
            done=done,
            iteration=self.iteration,
            positions=particles.positions,
            widths=particles.widths,
            means=particles.means,
            neighbours=particles.neighbourhoods[0],
            coefficients=particles.neighbourhoods[1],
            poses=poses,
            faces=particles.faces,
            energies=self.energies,
            repaired=repaired.copy(),
            tangential_weight=self.tangential_weight,
            parts=start.parts,
            variance=start.variance,
            left_out=start.left_out,
        )

    def save(self, checkpoint: Checkpoint) -> None:
        """Emit a checkpoint."""
        self._next_checkpoint = time.monotonic() + CHECKPOINT_INTERVAL_S
        if self.on_checkpoint is not None:
            self.on_checkpoint(checkpoint)
