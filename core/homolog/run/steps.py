"""The steps of a run after grooming: the same for runs in a project's folder and in memory."""

from collections.abc import Callable, Sequence

from homolog.cohort import Cohort
from homolog.correspondence import Checkpoint, Frame, FrameCallback, Shape, load_kernels, optimize
from homolog.correspondence.prepared_cohort import GeodesicSolver
from homolog.device import device_faults
from homolog.geodesics import solve_tables
from homolog.grooming import GroomedSubject, align_cohort
from homolog.progress import Tick, patiently
from homolog.run.base import Base
from homolog.run.control import Control
from homolog.run.events import Phase
from homolog.run.identity import fingerprint_of
from homolog.run.landmarks import with_landmarks
from homolog.run.result import Outcome, Study, with_repairs
from homolog.settings import RunSettings

__all__ = ["optimized", "prepared"]


def prepared(
    cohort: Cohort,
    groomed: Sequence[GroomedSubject],
    settings: RunSettings,
    device: str,
    tick: Tick,
    *,
    base: Base | None = None,
) -> Study:
    """Bring groomed subjects into one frame, with the landmarks that first particles are put on.

    Parameters
    ----------
    cohort : Cohort
    groomed : sequence of GroomedSubject
        Of the cohort, in its order.
    settings : RunSettings
    device : str
        Warp alias.
    tick : Tick
    base : Base, optional
        Result that is started from; it gives alignments and first particles.

    Returns
    -------
    Study
        What the optimization starts from.

    Raises
    ------
    InputError
        If shapes are of other sizes or sides than can be compared, or landmarks do not fit.
    """
    known = None if base is None else base.alignments
    noted, alignments = patiently(
        lambda inner: align_cohort(cohort, groomed, settings.groom, inner, known=known), tick, "aligning"
    )
    tick(1.0, "aligned")
    shapes = [
        Shape(one.name, one.field, one.mesh, one.coarse_mesh, alignment)
        for one, alignment in zip(noted, alignments, strict=True)
    ]
    if base is not None:
        shapes = base.shapes(shapes)
    elif settings.optimize.landmarks:
        shapes = with_landmarks(shapes, cohort)
    return Study(cohort, settings, noted, shapes, fingerprint_of(settings.placing, shapes, tick), device)


def optimized(
    study: Study,
    control: Control,
    *,
    observe: FrameCallback | None = None,
    checkpoint: Callable[[Checkpoint], None] | None = None,
    base: Base | None = None,
    resume: Checkpoint | None = None,
    solve: GeodesicSolver = solve_tables,
) -> Outcome:
    """Place the particles.

    Parameters
    ----------
    study : Study
    control : Control
        Takes phases, progress and times.
    observe, checkpoint, resume, solve
        As of `homolog.correspondence.optimize`.
    base : Base, optional
        Result that is started from.

    Returns
    -------
    Outcome

    Raises
    ------
    InputError
        If the device is lost or memory full, or the checkpoint does not fit.
    NumericalError
        If a particle is lost.
    """
    geodesic = study.settings.optimize.method.uses_geodesics
    first = Phase.GEODESICS if geodesic else Phase.SPLITTING
    control.enter(first, "distances on the surfaces", until=Phase.OPTIMIZING)

    def follow(frame: Frame) -> None:
        if observe is not None:
            observe(frame)
        if (phase := Phase(frame.stage.value)) is not control.status.phase:
            control.move_to(phase)

    with device_faults(study.device):
        patiently(lambda _: load_kernels(study.device), control.tick, "preparing compute kernels")
        found = optimize(
            study.shapes,
            study.settings.placing,
            device=study.device,
            tick=control.tick,
            observe=follow,
            checkpoint=checkpoint,
            initial=None if base is None else base.initial(study.shapes, control.tick),
            resume=resume,
            solve=solve,
        )
    return Outcome(
        with_repairs(study, found), found.world, found.local, found.alignments, found.energies,
        found.iterations, found.reason.value, control.seconds,
    )  # fmt: skip
