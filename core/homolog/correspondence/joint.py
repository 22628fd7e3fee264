"""Several structures of each subject, optimized together.

Each structure has its own surfaces, particles, unit of length, poses, sampling, normals and coherence, as if
it were modelled alone: how two bones lie to each other must not decide where on a bone a particle goes. The
structures have H(Z) in common, whose covariance is the mean over the particles of all. They move by turns,
each with the newest covariances of the others (block descent of the common objective). A structure that a
subject lacks counts as its mean there; the subject takes part with those that it has.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.loop import OptimizationLoop
from homolog.correspondence.mirror_images import MirrorImages
from homolog.correspondence.recorder import CheckpointCallback, RunRecorder
from homolog.correspondence.schedule import Weights
from homolog.correspondence.start import Start
from homolog.correspondence.types import (
    Checkpoint,
    Frame,
    FrameCallback,
    InitialParticles,
    OptimizedParticles,
    Reason,
    Shape,
    Stage,
)
from homolog.errors import Cancelled, InputError
from homolog.geometry import rotation_of, transform_points
from homolog.progress import Tick, part_of
from homolog.registration.entropy import covariance
from homolog.registration.procrustes import alignments_of_particles
from homolog.settings import OptimizeSettings, Procrustes
from homolog.surfaces.mirroring import MIRROR, mirrors

__all__ = ["JointLoop", "StructureShapes", "alignments_of_wholes", "joined"]


@dataclass(frozen=True, slots=True, eq=False)
class StructureShapes:
    """One structure of several.

    Attributes
    ----------
    shapes : sequence of Shape
        Of the subjects that have it, under the subjects' names.
    settings : OptimizeSettings
        Those of all structures but for the number of particles.
    initial : InitialParticles or None
        Particles of an earlier result on these shapes.
    """

    shapes: Sequence[Shape]
    settings: OptimizeSettings
    initial: InitialParticles | None = None

    @property
    def present(self) -> int | None:
        """Number of the initial particles."""
        return None if self.initial is None else self.initial.local.shape[1]


class JointEngine(Engine):
    """The engines of all structures as one, for the loop over stages.

    Attributes
    ----------
    subjects : int
        How many have one of the structures at least.
    places : list of (M,) int arrays
        Which of these the subjects of each structure are.
    """

    def __init__(
        self, loops: Sequence[OptimizationLoop], rows: Sequence[IntArray], whole: FloatArray
    ) -> None:
        self._loops, self._rows, self.alignments = loops, rows, whole @ _images(whole)
        self.poses = np.tile(np.eye(4), (len(whole), 1, 1))
        everybody = list(dict.fromkeys(name for loop in loops for name in loop.cohort.names))
        self.places = [np.array([everybody.index(name) for name in loop.cohort.names]) for loop in loops]
        self.subjects = len(everybody)

    @property
    def _engines(self) -> list[Engine]:
        return [loop.engine for loop in self._loops]

    @property
    def count(self) -> int:
        """Particles of the structure that has most."""
        return max(int(engine.count) for engine in self._engines)

    def aligned_positions(self) -> FloatArray:
        """Return the particles of all structures as the subjects are aligned, (M, N, 3) [mm]."""
        pairs = zip(self._loops, self._rows, strict=True)
        local = np.concatenate([loop.local_positions()[rows] for loop, rows in pairs], axis=1)
        return transform_points(self.alignments, local)

    def start_stage(self, weights: Sequence[Weights], done: int = 0) -> None:
        """Load the parameters of a stage's iterations; the first `done` have been run."""
        for engine in self._engines:
            engine.start_stage(weights, done)

    def iterate(self, times: int = LIST_ITERATIONS) -> None:
        """Move the particles of each structure `times` times, by turns."""
        engines = self._engines
        shares = np.array([engine.count for engine in engines]) / sum(engine.count for engine in engines)
        own = [np.ix_(places, places) for places in self.places]
        covariances = np.zeros((len(engines), self.subjects, self.subjects))
        for number, engine in enumerate(engines):
            covariances[number][own[number]] = shares[number] * _covariance(engine)
        for number, engine in enumerate(engines):
            others = covariances.sum(axis=0) - covariances[number]
            engine.coupling.join(others[own[number]], float(shares[number]))
            engine.iterate(times)
            covariances[number][own[number]] = shares[number] * _covariance(engine)

    def energy(self, coherence: float = 0.0) -> FloatArray:
        """Return H(P), H(Z) and H(V) of the last iteration, per particle and shape, (3,)."""
        engines = self._engines
        sizes = [engine.count * engine.shapes for engine in engines]
        return np.asarray(np.average([engine.energy(coherence) for engine in engines], axis=0, weights=sizes))


def _images(alignments: FloatArray) -> FloatArray:
    """Return the reflections (M, 4, 4) by which mirrored subjects become their mirror images."""
    return np.where(mirrors(alignments)[:, None, None], MIRROR, np.eye(4))


def _covariance(engine: Engine) -> FloatArray:
    rows = engine.aligned_positions().reshape(engine.shapes, -1)
    return covariance(rows - rows.mean(axis=0))


class JointRecorder(RunRecorder):
    """Records of all structures; frames have those of each."""

    def __init__(
        self,
        loops: Sequence[OptimizationLoop],
        images: Sequence[MirrorImages],
        alignments: FloatArray,
        observe: FrameCallback | None,
        on_checkpoint: CheckpointCallback | None,
    ) -> None:
        super().__init__(alignments, None, 1.0, observe, on_checkpoint)
        self._pairs = list(zip(loops, images, strict=True))

    def frame(self, stage: Stage, engine: Engine, *, ends_stage: bool) -> Frame:
        """Return the particles of all structures at this moment."""
        parts = (
            own.frame(loop.log.frame(stage, loop.engine, ends_stage=ends_stage)) for loop, own in self._pairs
        )
        return replace(super().frame(stage, engine, ends_stage=ends_stage), parts=tuple(parts))


class JointLoop(OptimizationLoop):
    """The loop over stages and iterations for several structures, each of which has its own loop.

    Parameters
    ----------
    loops : sequence of OptimizationLoop
        Of the same stages but for the numbers of particles.
    images : sequence of MirrorImages
        Of each loop's shapes.
    shapes : sequence of M Shape
        The subjects that have all structures.
    observe, on_checkpoint
        As in `homolog.correspondence.optimize`.

    Attributes
    ----------
    rows : list of (M,) int arrays
        Places of these subjects among those of each structure.
    """

    engine: JointEngine

    def __init__(
        self,
        loops: Sequence[OptimizationLoop],
        images: Sequence[MirrorImages],
        shapes: Sequence[Shape],
        observe: FrameCallback | None = None,
        on_checkpoint: CheckpointCallback | None = None,
    ) -> None:
        most = max(loops, key=lambda loop: loop.settings.particles)
        self.loops, self.alignments = loops, np.stack([shape.alignment for shape in shapes])
        self.rows = [np.array([loop.cohort.names.index(shape.name) for shape in shapes]) for loop in loops]
        self.cohort, self.settings = most.cohort, most.settings
        self.stages, self.counts = most.stages, most.counts
        sizes = [loop.settings.particles * len(loop.cohort.names) for loop in loops]
        self.shares, self.tick = most.shares, most.tick
        self.tolerance = float(np.average([loop.tolerance for loop in loops], weights=sizes))
        self.shapes, self.initial_tick = shapes, most.initial_tick
        self.launcher, self.initial = most.launcher, most.initial
        self.log = JointRecorder(loops, images, self.alignments, observe, on_checkpoint)
        self.log.tangential_weight = most.log.tangential_weight
        for loop in loops:
            loop.launcher.poll_cancel = self.launcher.poll_cancel  # repeats the progress of all
        self.engine = JointEngine(loops, self.rows, self.alignments)

    def initialize(self, count: int, tick: Tick) -> None:
        """Place the initial particles of all structures; `count` is that of the structure with most."""
        share = 1.0 / len(self.loops)
        for number, loop in enumerate(self.loops):
            own = loop.settings.particles if count == self.settings.particles else loop.stages[0].count
            loop.initialize(own, part_of(tick, number * share, (number + 1) * share))
        self._gather()
        if self.initial is None:
            self.log.emit_frame(Stage.SPLITTING, self.engine, ends_stage=True)

    def begin(self, start: Start) -> None:
        """Use the weight of H(Z) that the first particles of all structures tell."""
        super().begin(start)
        for loop in self.loops:
            loop.begin(start)

    def compared_positions(self) -> FloatArray:
        """Return the particles of all structures, each aligned with its like, (M, N, 3)."""
        pairs = zip(self.loops, self.rows, strict=True)
        return np.concatenate([loop.compared_positions()[rows] for loop, rows in pairs], axis=1)

    def register_again(self, index: int) -> Reason:
        """Register all particles of all structures, and leave them there."""
        reasons = [loop.register_again(index) for loop in self.loops]
        self._gather()
        return reasons[0]

    def restore(self, resume: Checkpoint) -> int:
        """Continue all structures from a checkpoint; return the number of its stage."""
        if len(resume.others) != len(self.loops) - 1:
            raise InputError("the checkpoint belongs to another cohort or other settings; start a new run")
        begins = [loop.restore(own) for loop, own in zip(self.loops, (resume, *resume.others), strict=True)]
        self.log.restore(resume)
        self._gather()
        return begins[0]

    def _gather(self) -> None:
        wide = [np.zeros((self.engine.subjects, loop.repaired.shape[1]), np.int32) for loop in self.loops]
        for own, loop, places in zip(wide, self.loops, self.engine.places, strict=True):
            own[places] = loop.repaired
        self.repaired = np.concatenate(wide, axis=1)

    def _iterate(self, index: int, done: int, times: int) -> None:
        super()._iterate(index, done, times)
        for loop in self.loops:
            loop.log.iteration += times

    def align(self, tangential_weight: float = 1.0, regularization: float | None = None) -> None:
        """Align each structure with its like."""
        for loop in self.loops:
            loop.align(tangential_weight, regularization)

    def needs_split(self, index: int) -> bool:
        """Return whether a structure has more particles in a stage than now."""
        return any(loop.needs_split(index) for loop in self.loops)

    def split_particles(self, index: int) -> None:
        """Split the particles of the structures that have more in a stage."""
        with self._whole(max(index - 1, 0), self.stages[index - 1].iterations):
            for loop in self.loops:
                if loop.needs_split(index):
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
        before = self.particles()
        try:
            yield
        except Cancelled:
            self._checkpoint(index, done, before)
            raise

    def particles(self) -> list[Particles]:
        """Return copies of the state of each structure."""
        return [loop.engine.particles() for loop in self.loops]

    def _checkpoint(self, index: int, done: int, particles: Sequence[Particles] | None = None) -> None:
        left = len(self.stages) - 1 - index
        first, *others = (
            self.log.state(now, loop.poses, left, done, loop.repaired, self.start)
            for loop, now in zip(self.loops, particles or self.particles(), strict=True)
        )
        self.log.save(replace(first, others=tuple(others)))


def alignments_of_wholes(
    local: FloatArray, alignments: FloatArray, free: BoolArray, procrustes: Procrustes
) -> FloatArray:
    """Return similarities (M, 4, 4) that align subjects by particles (M, n, 3) in file coordinates.

    Those of a run that aligns nothing, and of subjects that are not `free` (M,), stay as they were.
    """
    if procrustes in (Procrustes.OFF, Procrustes.AUTO):
        return alignments
    images = _images(alignments)
    points, proper, scaling = (
        transform_points(images, local),
        alignments @ images,
        procrustes is Procrustes.SHAPE,
    )
    return alignments_of_particles(points, proper, proper, free, scaling=scaling) @ images


def joined(
    parts: Sequence[OptimizedParticles], loop: JointLoop, *, align_by: int | None = None
) -> OptimizedParticles:
    """Return the particles of the subjects that have all structures from those of the structures.

    The subjects are aligned by the particles of all structures, or of one (`align_by`), as a single structure
    is; where the run aligns nothing, they stay as they were.
    """
    own = list(zip(parts, loop.rows, strict=True))
    local = np.concatenate([part.local[rows] for part, rows in own], axis=1)
    first = loop.loops[0]
    seen = local if align_by is None else parts[align_by].local[loop.rows[align_by]]
    free = first.free_poses[loop.rows[0]]
    alignments = alignments_of_wholes(seen, loop.alignments, free, first.settings.procrustes)
    turns = rotation_of(alignments)
    normals = [
        np.einsum("mij,mkj,mnk->mni", turns, rotation_of(part.alignments[rows]), part.normals[rows])
        for part, rows in own
    ]
    return OptimizedParticles(
        world=transform_points(alignments, local),
        local=local,
        normals=np.concatenate(normals, axis=1),
        energies=loop.log.energies,
        alignments=alignments,
        iterations=loop.log.iteration,
        reason=parts[0].reason,
        repaired=np.concatenate([part.repaired[rows] for part, rows in own], axis=1),
        parts=tuple(parts),
    )
