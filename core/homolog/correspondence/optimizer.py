"""The optimization, from a few particles on every shape to all of them."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import BoolArray
from homolog.correspondence.divided import prepare_on
from homolog.correspondence.joint import JointLoop, StructureShapes, joined
from homolog.correspondence.loop import OptimizationLoop
from homolog.correspondence.mirror_images import MirrorImages, with_mirror_images
from homolog.correspondence.recorder import CheckpointCallback
from homolog.correspondence.schedule import TimeShares, joint_counts, plan_stages
from homolog.correspondence.surface_sets import normalize_size
from homolog.correspondence.types import (
    Checkpoint,
    FrameCallback,
    InitialParticles,
    OptimizedParticles,
    Reason,
    Shape,
)
from homolog.device import choose_device
from homolog.errors import InputError
from homolog.geodesics import GeodesicSolver, solve_tables
from homolog.memory import Store, in_memory
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings
from homolog.threads import blas_threads, cores

__all__ = ["optimize", "optimize_jointly"]


def optimize(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    *,
    device: str = "auto",
    tick: Tick = no_tick,
    observe: FrameCallback | None = None,
    checkpoint: CheckpointCallback | None = None,
    initial: InitialParticles | None = None,
    resume: Checkpoint | None = None,
    solve: GeodesicSolver = solve_tables,
    store: Store = in_memory,
) -> OptimizedParticles:
    """Place corresponding particles on all shapes (the paper's Eq. 5).

    Parameters
    ----------
    shapes : sequence of Shape
        At least two shapes, M. If an alignment is a reflection, the mirror image is optimized; the result is
        in the coordinates of the file, with a reflection as alignment.
    settings : OptimizeSettings
        Method, number of particles, weights and schedule.
    device : str
        ``"auto"``, ``"cpu"`` or ``"cuda:<n>"``; ``"cuda:0,cuda:1"`` divides the shapes among several GPUs.
    tick : Tick
        Progress and cancellation. If it raises `Cancelled`, a last checkpoint is emitted first.
    observe : callable, optional
        Takes the newest `Frame`, at most 20 times a second.
    checkpoint : callable, optional
        Takes a `Checkpoint` at every split and every 20 s.
    initial : InitialParticles, optional
        Particles of an earlier result. Fewer than requested are split; if some of them are fixed, all must be
        given. By default particles are initialized by registration.
    resume : Checkpoint, optional
        A checkpoint of an interrupted run with the same shapes, settings and initial particles. The result is
        that of an uninterrupted run, bit-identical on the CPU.
    solve : callable
        Geodesic solver.
    store : Store
        See `prepare_cohort`.

    Returns
    -------
    OptimizedParticles
        Particles, normals, alignments and energies.

    Raises
    ------
    InputError
        If there are fewer than two shapes, or initial particles or checkpoint do not fit.
    NumericalError
        If a position is not finite.
    """
    if initial is not None and initial.free is not None and not initial.free.any():
        raise InputError("all particles are fixed, so there is nothing to optimize; free some")
    structure = StructureShapes(shapes, settings, initial)
    images, loop = _prepared(
        structure,
        choose_device(device).split(","),
        left=None if resume is None else resume.left,
        counts=None,
        tick=tick,
        span=(0.0, 1.0),
        observe=observe,
        checkpoint=checkpoint,
        solve=solve,
        store=store,
    )
    return images.result(loop.result(_run(loop, [loop], resume)))


def optimize_jointly(
    shapes: Sequence[Shape],
    structures: Sequence[StructureShapes],
    *,
    device: str = "auto",
    tick: Tick = no_tick,
    observe: FrameCallback | None = None,
    checkpoint: CheckpointCallback | None = None,
    resume: Checkpoint | None = None,
    solve: GeodesicSolver = solve_tables,
    store: Store = in_memory,
    align_by: int | None = None,
) -> OptimizedParticles:
    """Place corresponding particles on several structures of each subject.

    Parameters
    ----------
    shapes : sequence of Shape
        The subjects that have all structures, at least two, aligned as wholes.
    structures : sequence of StructureShapes
        Each structure, aligned with its like, with its settings and initial particles.
    align_by : int, optional
        The structure by which the result aligns the subjects; all if not given.
    device, tick, observe, checkpoint, resume, solve, store
        See `optimize`.

    Returns
    -------
    OptimizedParticles
        Of the subjects, with those of the structures as `parts`.

    Raises
    ------
    InputError, NumericalError
        See `optimize`.
    """
    if len(shapes) < 2:
        raise InputError("fewer than two subjects have all structures; give more, or fewer structures")
    counts = joint_counts(
        [item.settings.particles for item in structures], [item.present for item in structures]
    )
    share = 1.0 / len(structures)
    sides = [
        _prepared(
            item,
            choose_device(device).split(","),
            left=None if resume is None else resume.left,
            counts=counts[number],
            tick=tick,
            span=(number * share, (number + 1) * share),
            observe=None,
            checkpoint=None,
            solve=solve,
            store=store,
        )
        for number, item in enumerate(structures)
    ]
    loops = [loop for _, loop in sides]
    joint = JointLoop(loops, [images for images, _ in sides], shapes, observe, checkpoint)
    reason = _run(joint, loops, resume)
    return joined([images.result(loop.result(reason)) for images, loop in sides], joint, align_by=align_by)


def _run(loop: OptimizationLoop, loops: Sequence[OptimizationLoop], resume: Checkpoint | None) -> Reason:
    try:
        with blas_threads(max(len(item.cohort.names) for item in loops)):
            return loop.run(resume)
    finally:
        for item in loops:
            item.launcher.close()


def _prepared(
    structure: StructureShapes,
    devices: Sequence[str],
    *,
    left: int | None,
    counts: Sequence[int] | None,
    tick: Tick,
    span: tuple[float, float],
    observe: FrameCallback | None,
    checkpoint: CheckpointCallback | None,
    solve: GeodesicSolver,
    store: Store,
) -> tuple[MirrorImages, OptimizationLoop]:
    """Bring a structure of all subjects to the devices; return its mirror images and its loop.

    `left` are the stages after that of a checkpoint, `counts` see `plan_stages`, and `span` is the part of
    the preparation's progress.
    """
    settings, initial = structure.settings, structure.initial
    if len(structure.shapes) < 2:
        raise InputError("correspondence needs at least two shapes; give more")
    if initial is not None:
        _check_initial(initial, len(structure.shapes), settings.particles)
    free_shapes: BoolArray | None = None
    if initial is not None and initial.free is not None:
        free_shapes = np.any(initial.free, axis=1)
    images = with_mirror_images(structure.shapes, store)
    shapes: Sequence[Shape] = images.shapes
    initial, observe = images.initial_particles(initial), images.observer(observe)
    alignments = np.stack([shape.alignment for shape in shapes])
    if settings.procrustes.takes_size_out:
        shapes = normalize_size(shapes)
    stages = plan_stages(settings, structure.present, len(shapes), counts)
    shares = TimeShares(
        stages,
        geodesic=settings.method.uses_geodesics,
        registers=initial is None,
        threads=cores() if devices[0] == "cpu" else 1,
    )
    begin, end = (shares.preparation * share for share in span)
    cohort = prepare_on(
        devices,
        shapes,
        settings,
        counts=[plan.count for plan in (stages if left is None else stages[-1 - left :] or stages)],
        free_shapes=free_shapes,
        solve=solve,
        store=store,
        tick=part_of(tick, begin, end),
    )
    loop_tick = part_of(tick, shares.preparation, 1.0)
    return images, OptimizationLoop(
        shapes, alignments, cohort, settings, stages, shares, initial, loop_tick, observe, checkpoint, counts
    )


def _check_initial(initial: InitialParticles, shapes: int, particles: int) -> None:
    shape = initial.local.shape
    if shape[0] != shapes or shape[1] > particles:
        raise InputError(
            f"the initial particles are {shape[1]} on {shape[0]} shapes, but {particles} were requested on "
            f"{shapes}; give initial particles for every shape, and no more than requested"
        )
    if initial.free is not None and (shape[1] != particles or initial.free.shape != shape[:2]):
        raise InputError("if some particles are fixed, all particles must be given; request no others")
