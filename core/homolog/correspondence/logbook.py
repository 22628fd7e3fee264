"""What a run tells and keeps on its way: energies, frames to look at, checkpoints, each when it is due."""

import time
from collections.abc import Callable

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.poses import rescaled, scales_of
from homolog.correspondence.types import Checkpoint, Frame, Observe, Stage

__all__ = ["Keep", "Logbook"]

KEEP_S = 20.0  # seconds between two checkpoints: with the iterations under way no more than 30 are lost
FRAME_S = 0.05  # seconds between two frames

Keep = Callable[[Checkpoint], None]


class Logbook:
    """The records of a run, and the clocks by which they are handed out.

    Parameters
    ----------
    alignments : (M, 4, 4) array
        Similarities from file to world coordinates, as the shapes are compared when the run begins.
    scales : (M,) array or None
        Scales that the shapes are shown with; None for those with which they are compared.
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
        observe: Observe | None,
        keep: Keep | None,
    ) -> None:
        self.alignments, self.scales, self.unit = alignments, scales, unit
        self.observe, self.keep = observe, keep
        self.rows: list[list[float]] = []
        self.iteration = 0
        self._next_frame = self._next_checkpoint = 0.0

    def go_on(self, saved: Checkpoint) -> None:
        """Take over what an earlier run recorded."""
        self.rows, self.iteration = saved.energies.tolist(), saved.iteration

    def record(self, parts: FloatArray) -> None:
        """Note the three parts of the objective at this iteration."""
        self.rows.append([float(self.iteration), *parts.tolist()])

    def changed(self) -> float:
        """Return how much the objective changed between the last two records."""
        before, now = (float(np.sum(row[1:])) for row in self.rows[-2:])
        return abs(before - now)

    def has_stopped_falling(self, records: int, tolerance: float) -> bool:
        """Return whether the objective falls no more than it fluctuates, over twice so many last records.

        Where surfaces have handles that are smaller than the distance between particles, a few particles
        have no place of rest, and the objective keeps fluctuating.
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
        turned = poses.copy()
        turned[:, :3, 3] *= self.unit
        return turned @ self.alignments

    def begin_stage(self) -> None:
        """Let the next frame be due at once, so that a stage is seen however short it is."""
        self._next_frame = 0.0

    def show(self, stage: Stage, engine: Engine) -> None:
        """Hand out a frame if one is due and something has been recorded."""
        now = time.monotonic()
        if self.observe is None or now < self._next_frame or not self.rows:
            return
        self._next_frame = now + FRAME_S
        world, alignments = engine.posed_positions() * self.unit, self.aligned(engine.poses)
        if self.scales is not None:
            middles, before = world.mean(axis=1), scales_of(alignments)
            alignments = rescaled(alignments, self.scales, middles)
            growth = (self.scales / before)[:, None, None]
            world = middles[:, None] + growth * (world - middles[:, None])
        latest = np.array(self.rows[-1][1:])
        self.observe(Frame(stage, self.iteration, world, latest, alignments))

    def checkpoint_is_due(self) -> bool:
        """Whether it is time for a checkpoint."""
        return time.monotonic() >= self._next_checkpoint

    def save(
        self, engine: Engine, left: int, done: int, repaired: IntArray, particles: Particles | None = None
    ) -> None:
        """Hand out a checkpoint of the engine's particles, or of those given."""
        self._next_checkpoint = time.monotonic() + KEEP_S
        if self.keep is None:
            return
        now = particles or engine.particles()
        self.keep(
            Checkpoint(
                left=left,
                done=done,
                iteration=self.iteration,
                positions=now.positions,
                widths=now.widths,
                means=now.means,
                poses=engine.poses,
                faces=now.faces,
                energies=self.energies,
                repaired=repaired.copy(),
            )
        )
