"""Several structures of each subject, optimized together.

Each structure has its own surfaces, unit of length, poses, sampling, normals and coherence, as if it were
modelled alone: how two bones lie to each other must not decide where on a bone a particle goes. The
structures have H(Z) in common, whose covariance is the mean over the particles of all. They move by turns,
each with the newest covariances of the others (block descent of the common objective).
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from homolog.arrays import FloatArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.loop import OptimizationLoop
from homolog.correspondence.recorder import CheckpointCallback, RunRecorder
from homolog.correspondence.schedule import Weights
from homolog.correspondence.start import Start
from homolog.correspondence.types import Checkpoint, FrameCallback, OptimizedParticles, Reason, Stage
from homolog.errors import Cancelled, InputError
from homolog.geometry import rotation_of, transform_points
from homolog.progress import Tick, part_of
from homolog.registration.entropy import covariance
from homolog.registration.procrustes import alignments_of_particles
from homolog.settings import Procrustes
from homolog.surfaces.mirroring import MIRROR, mirrors

__all__ = ["JointLoop", "joined"]


class JointEngine(Engine):
    """The engines of all structures as one, for the loop over stages."""

    def __init__(self, loops: Sequence[OptimizationLoop], alignments: FloatArray) -> None:
        self._loops, self.alignments = loops, alignments @ _images(alignments)
        self.poses = np.tile(np.eye(4), (len(alignments), 1, 1))

    @property
    def _engines(self) -> list[Engine]:
        return [loop.engine for loop in self._loops]

    @property
    def count(self) -> int:
        """Particles of each structure."""
        return int(self._engines[0].count)

    def aligned_positions(self) -> FloatArray:
        """Return the particles of all structures as the subjects are aligned, (M, S n, 3) [mm]."""
        local = np.concatenate([loop.local_positions() for loop in self._loops], axis=1)
        return transform_points(self.alignments, local)

    def start_stage(self, weights: Sequence[Weights], done: int = 0) -> None:
        """Load the parameters of a stage's iterations; the first `done` have been run."""
        for engine in self._engines:
            engine.start_stage(weights, done)

    def iterate(self, times: int = LIST_ITERATIONS) -> None:
        """Move the particles of each structure `times` times, by turns."""
        engines = self._engines
        covariances = np.stack([_covariance(engine) for engine in engines])
        share = 1.0 / len(engines)  # of each structure; all have as many particles
        for number, engine in enumerate(engines):
            engine.coupling.join(share * (covariances.sum(axis=0) - covariances[number]), share)
            engine.iterate(times)
            covariances[number] = _covariance(engine)

    def energy(self, coherence: float = 0.0) -> FloatArray:
        """Return H(P), H(Z) and H(V) of the last iteration, per particle and shape, (3,)."""
        return np.asarray(np.mean([engine.energy(coherence) for engine in self._engines], axis=0))

    def particles(self) -> Particles:
        """Return a copy of the state, the structures one after another."""
        parts = [engine.particles() for engine in self._engines]
        positions, widths, faces = (
            np.concatenate([getattr(item, name) for item in parts], axis=1)
            for name in ("positions", "widths", "faces")
        )
        means = np.concatenate([item.means for item in parts])
        neighbours, coefficients = zip(*(item.neighbourhoods for item in parts), strict=True)
        return Particles(
            positions, widths, means, faces, (np.concatenate(neighbours), np.concatenate(coefficients))
        )


def _images(alignments: FloatArray) -> FloatArray:
    """Return the reflections (M, 4, 4) by which mirrored subjects become their mirror images."""
    return np.where(mirrors(alignments)[:, None, None], MIRROR, np.eye(4))


def _covariance(engine: Engine) -> FloatArray:
    rows = engine.aligned_positions().reshape(engine.shapes, -1)
    return covariance(rows - rows.mean(axis=0))


class JointLoop(OptimizationLoop):
    """The loop over stages and iterations for S structures, each of which has its own loop.

    Parameters
    ----------
    loops : sequence of S OptimizationLoop
        Of the same stages.
    alignments : (M, 4, 4) array
        Of the whole subjects, from file to world coordinates.
    tick, observe, on_checkpoint
        As in `homolog.correspondence.optimize`.
    """

    def __init__(
        self,
        loops: Sequence[OptimizationLoop],
        alignments: FloatArray,
        tick: Tick,
        observe: FrameCallback | None = None,
        on_checkpoint: CheckpointCallback | None = None,
    ) -> None:
        first = loops[0]
        self.loops, self.alignments = loops, alignments
        self.cohort, self.settings, self.stages = first.cohort, first.settings, first.stages
        self.shares, self.tick, self.tolerance = first.shares, tick, first.tolerance
        self.shapes, self.initial_tick = first.shapes, first.initial_tick
        self.launcher, self.initial = first.launcher, first.initial
        self.log = RunRecorder(alignments, None, 1.0, observe, on_checkpoint)
        self.log.tangential_weight = first.log.tangential_weight
        for loop in loops:
            loop.launcher.poll_cancel = self.launcher.poll_cancel  # repeats the progress of all
        self.engine = JointEngine(loops, alignments)

    def initialize(self, count: int, tick: Tick) -> None:
        """Place the initial particles of all structures."""
        share = 1.0 / len(self.loops)
        for number, loop in enumerate(self.loops):
            loop.initialize(count, part_of(tick, number * share, (number + 1) * share))
        self._gather()
        if self.initial is None:
            self.log.emit_frame(Stage.SPLITTING, self.engine, ends_stage=True)

    def begin(self, start: Start) -> None:
        """Use the weight of H(Z) that the first particles of all structures tell."""
        super().begin(start)
        for loop in self.loops:
            loop.settings, loop.stages, loop.start = self.settings, self.stages, start

    def compared_positions(self) -> FloatArray:
        """Return the particles of all structures, each aligned with its like, (M, S n, 3)."""
        return np.concatenate([loop.compared_positions() for loop in self.loops], axis=1)

    def register_again(self, index: int) -> Reason:
        """Register all particles of all structures, and leave them there."""
        reasons = [loop.register_again(index) for loop in self.loops]
        self._gather()
        return reasons[0]

    def restore(self, resume: Checkpoint) -> int:
        """Continue all structures from a checkpoint; return the number of its stage."""
        structures, count = len(self.loops), resume.positions.shape[1]
        if count % structures or len(resume.poses) != structures * len(self.alignments):
            raise InputError("the checkpoint belongs to another cohort or other settings; start a new run")
        begins = [
            loop.restore(_of_structure(resume, number, structures)) for number, loop in enumerate(self.loops)
        ]
        self.log.restore(resume)
        self._gather()
        return begins[0]

    def _gather(self) -> None:
        self.poses = np.concatenate([loop.poses for loop in self.loops])
        self.repaired = np.concatenate([loop.repaired for loop in self.loops], axis=1)

    def _iterate(self, index: int, done: int, times: int) -> None:
        super()._iterate(index, done, times)
        for loop in self.loops:
            loop.log.iteration += times

    def align(self, tangential_weight: float = 1.0, regularization: float | None = None) -> None:
        """Align each structure with its like."""
        for loop in self.loops:
            loop.align(tangential_weight, regularization)
        self._gather()

    def split_particles(self, index: int) -> None:
        """Split the particles of all structures."""
        with self._whole(max(index - 1, 0), self.stages[index - 1].iterations):
            for loop in self.loops:
                loop.split_particles(index)
        self._gather()

    def repair(self, index: int, done: int) -> None:
        """Relocate lost particles of all structures at the end of a stage."""
        with self._whole(index, done):
            for loop in self.loops:
                loop.repair(index, done)
        self._gather()

    @contextmanager
    def _whole(self, index: int, done: int) -> Iterator[None]:
        """If the block is cancelled, checkpoint all structures as they were before."""
        before = self.engine.particles()
        try:
            yield
        except Cancelled:
            self._checkpoint(index, done, before)
            raise


def _of_structure(resume: Checkpoint, number: int, structures: int) -> Checkpoint:
    """Return the part of a checkpoint that belongs to one of the structures."""
    count, shapes = resume.positions.shape[1] // structures, len(resume.positions)
    own = slice(number * count, (number + 1) * count)
    return replace(
        resume,
        positions=resume.positions[:, own],
        widths=resume.widths[:, own],
        means=resume.means[own],
        neighbours=resume.neighbours[own],
        coefficients=resume.coefficients[own],
        poses=resume.poses[number * shapes : (number + 1) * shapes],
        faces=resume.faces[:, own],
        repaired=resume.repaired[:, own],
    )


def joined(
    parts: Sequence[OptimizedParticles], loop: JointLoop, *, align_by: int | None = None
) -> OptimizedParticles:
    """Return the subjects' particles from those of their structures.

    The subjects are aligned by the particles of all structures, or of one (`align_by`), as a single structure
    is; where the run aligns nothing, they stay as they were.
    """
    local = np.concatenate([part.local for part in parts], axis=1)
    alignments, first = loop.alignments, loop.loops[0]
    if first.aligns:
        images = _images(alignments)
        points = transform_points(images, local if align_by is None else parts[align_by].local)
        scaling, proper = first.settings.procrustes is Procrustes.SHAPE, alignments @ images
        alignments = (
            alignments_of_particles(points, proper, proper, first.free_poses, scaling=scaling) @ images
        )
    turns = rotation_of(alignments)
    normals = [
        np.einsum("mij,mkj,mnk->mni", turns, rotation_of(part.alignments), part.normals) for part in parts
    ]
    return OptimizedParticles(
        world=transform_points(alignments, local),
        local=local,
        normals=np.concatenate(normals, axis=1),
        energies=loop.log.energies,
        alignments=alignments,
        iterations=loop.log.iteration,
        reason=parts[0].reason,
        repaired=np.concatenate([part.repaired for part in parts], axis=1),
        parts=tuple(parts),
    )
