"""The optimization, from a few particles on every shape to all of them."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import BoolArray
from homolog.correspondence.domain import Solve, prepare
from homolog.correspondence.journey import Journey
from homolog.correspondence.logbook import Keep
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.schedule import plan_stages
from homolog.correspondence.surfaces import of_one_size
from homolog.correspondence.types import Checkpoint, Observe, OptimizedParticles, Shape, Start
from homolog.device import choose_device
from homolog.errors import InputError
from homolog.geodesics import solve_tables
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings

__all__ = ["optimize"]


def optimize(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    *,
    device: str = "auto",
    tick: Tick = no_tick,
    observe: Observe | None = None,
    checkpoint: Keep | None = None,
    start: Start | None = None,
    resume: Checkpoint | None = None,
    solve: Solve = solve_tables,
) -> OptimizedParticles:
    """Place corresponding particles on all shapes (the paper's Eq. 5).

    Parameters
    ----------
    shapes : sequence of Shape
        M of them, at least two. Where an alignment is a reflection the mirror image is optimized; the
        result is in the coordinates of the file, and its alignment a reflection again.
    settings : OptimizeSettings
        Method, number of particles, weights and schedule.
    device : str
        ``"auto"``, ``"cpu"`` or ``"cuda:<n>"``.
    tick : Tick
        Progress and cancelling. When it raises `Cancelled`, a last checkpoint is handed over first.
    observe : callable, optional
        Takes the newest `Frame`, at most 20 times a second.
    checkpoint : callable, optional
        Takes a `Checkpoint` at every split and every 30 s.
    start : Start, optional
        Particles of an earlier result: as many as wanted, or fewer, which are then split; where some of
        them may not move there must be as many as wanted. By default first particles are found by
        registration.
    resume : Checkpoint, optional
        Where a broken-off run of the same shapes, settings and start goes on; on the CPU it ends
        bit-identical to one that was not broken off.
    solve : callable
        Gives the geodesic tables of meshes.

    Returns
    -------
    OptimizedParticles

    Raises
    ------
    InputError
        If there are fewer than two shapes, or start or checkpoint do not fit.
    NumericalError
        If a particle is lost (a position that is no number).
    """
    device = choose_device(device)
    if len(shapes) < 2:
        raise InputError("correspondence needs at least two shapes")
    if start is not None:
        _check_start(start, len(shapes), settings.particles)
    moving: BoolArray | None = None
    if start is not None and start.movable is not None:
        moving = np.any(start.movable, axis=1)
    images = with_mirror_images(shapes)
    shapes, start, observe = images.shapes, images.start(start), images.observer(observe)
    alignments = np.stack([shape.alignment for shape in shapes])
    if settings.procrustes.takes_size_out:
        shapes = of_one_size(shapes)
    stages = plan_stages(settings, start.local.shape[1] if start is not None else None)
    geometry = 0.3 if settings.method.uses_geodesics else 0.02
    domain = prepare(
        shapes,
        settings,
        device=device,
        counts=[plan.count for plan in stages],
        moving=moving,
        solve=solve,
        tick=part_of(tick, 0.0, geometry),
    )
    rest = part_of(tick, geometry, 1.0)
    journey = Journey(shapes, alignments, domain, settings, stages, start, rest, observe, checkpoint)
    try:
        reason = journey.run(resume)
    finally:
        journey.launcher.close()
    return images.result(journey.result(reason))


def _check_start(start: Start, shapes: int, particles: int) -> None:
    given = start.local.shape
    if given[0] != shapes or given[1] > particles:
        raise InputError(
            f"the initial particles are {given[1]} on {given[0]} shapes, but {particles} were requested on "
            f"{shapes}; give initial particles for every shape, and no more than requested"
        )
    if start.movable is not None and (given[1] != particles or start.movable.shape != given[:2]):
        raise InputError("if some particles are fixed, all particles must be given; request no others")
    if start.movable is not None and not start.movable.any():
        raise InputError("all particles are fixed, so there is nothing to optimize; free some")
