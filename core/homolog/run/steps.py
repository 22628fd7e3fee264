"""The steps of a run after grooming, for runs in a project and in memory."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

from homolog.cohort import Cohort
from homolog.correspondence import (
    Checkpoint,
    Frame,
    FrameCallback,
    OptimizedParticles,
    Shape,
    StructureShapes,
    load_kernels,
    optimize,
    optimize_jointly,
)
from homolog.device import device_faults
from homolog.geodesics import GeodesicSolver, solve_tables
from homolog.grooming import GroomedSubject
from homolog.io.markups import Markups
from homolog.memory import OnDemand, Store, in_memory, return_freed_memory
from homolog.progress import Tick, run_in_background
from homolog.registration import align_cohort
from homolog.run.control import Control
from homolog.run.events import Phase
from homolog.run.fingerprints import run_fingerprint
from homolog.run.landmarks import NOTHING_KNOWN, with_landmarks
from homolog.run.prior_result import PriorResult
from homolog.run.result import OptimizationInput, OptimizationOutcome, add_repair_notes
from homolog.run.subject_fits import groomed_shape
from homolog.settings import RunSettings

__all__ = ["prepare_inputs", "run_optimization"]


def prepare_inputs(
    cohort: Cohort,
    groomed: Sequence[GroomedSubject],
    settings: RunSettings,
    device: str,
    tick: Tick,
    *,
    prior: PriorResult | None = None,
    registrations: Path | None = None,
    folder: Path | None = None,
    landmarks: Mapping[str, Markups] = NOTHING_KNOWN,
) -> OptimizationInput:
    """Align groomed subjects, and add landmarks for the initial particles.

    Parameters
    ----------
    cohort : Cohort
    groomed : sequence of GroomedSubject
        Groomed subjects in the order of the cohort.
    settings : RunSettings
    device : str
        Warp's device alias.
    tick : Tick
    prior : PriorResult, optional
        Initial result, with alignments and initial particles.
    registrations : Path, optional
        File with earlier registrations; see `align_cohort`.
    folder : Path, optional
        Where the groomed subjects are, if `groomed` has only their outlines: shapes are then read from there
        on each access.
    landmarks : mapping of str to Markups
        Landmarks that were read already, by subject.

    Returns
    -------
    OptimizationInput

    Raises
    ------
    InputError
        If sizes or sides of shapes can't be compared, or landmarks do not fit.
    """
    known = None if prior is None else prior.alignments
    annotated, alignments = run_in_background(
        lambda inner: align_cohort(cohort, groomed, settings.groom, inner, known=known, cache=registrations),
        tick,
        "aligning",
    )
    tick(1.0, "aligned")
    if folder is not None:
        names = [item.name for item in annotated]
        read = OnDemand(len(names), lambda index: groomed_shape(folder, names[index], alignments[index]))
        return OptimizationInput(cohort, settings, annotated, read, "", device)
    shapes = [
        Shape(subject.name, subject.field, subject.mesh, subject.coarse_mesh, alignment)
        for subject, alignment in zip(annotated, alignments, strict=True)
    ]
    if prior is not None:
        shapes = prior.shapes(shapes)
    elif settings.optimize.landmarks:
        shapes = with_landmarks(shapes, cohort, landmarks)
    return OptimizationInput(
        cohort, settings, annotated, shapes, run_fingerprint(settings.placing, shapes, tick), device
    )


def run_optimization(
    inputs: OptimizationInput,
    control: Control,
    *,
    observe: FrameCallback | None = None,
    checkpoint: Callable[[Checkpoint], None] | None = None,
    prior: PriorResult | None = None,
    resume: Checkpoint | None = None,
    solve: GeodesicSolver = solve_tables,
    store: Store = in_memory,
) -> OptimizationOutcome:
    """Place the particles.

    Parameters
    ----------
    inputs : OptimizationInput
    control : Control
        Receives phases, progress and times.
    observe, checkpoint, resume, solve
        See `homolog.correspondence.optimize`.
    prior : PriorResult, optional
        Initial result.
    store : Store
        Storage of tables and fields.

    Returns
    -------
    OptimizationOutcome

    Raises
    ------
    InputError
        If the device is lost or memory full, or the checkpoint does not fit.
    NumericalError
        If a particle is lost.
    """
    geodesic = inputs.settings.optimize.method.uses_geodesics
    first = Phase.GEODESICS if geodesic else Phase.SPLITTING
    control.enter(first, "geodesic distances", until=Phase.OPTIMIZING)

    def follow(frame: Frame) -> None:
        if observe is not None:
            observe(frame)
        if (phase := Phase(frame.stage.value)) is not control.status.phase:
            control.move_to(phase)

    with device_faults(inputs.device):
        run_in_background(lambda _: load_kernels(inputs.device), control.tick, "preparing compute kernels")
        result = _placed(
            inputs,
            prior,
            control.tick,
            observe=follow,
            checkpoint=checkpoint,
            resume=resume,
            solve=solve,
            store=store,
        )
    return_freed_memory()  # tables and fields take as much as the next steps need
    return _outcome(inputs, result, control)


class _Options(TypedDict):
    observe: FrameCallback
    checkpoint: Callable[[Checkpoint], None] | None
    resume: Checkpoint | None
    solve: GeodesicSolver
    store: Store


def _placed(
    inputs: OptimizationInput,
    prior: PriorResult | None,
    tick: Tick,
    **options: Unpack[_Options],
) -> OptimizedParticles:
    """Place the particles of one structure, or of several together."""
    if not inputs.parts:
        initial = None if prior is None else prior.initial(inputs.shapes, tick)
        given = inputs.settings.placing
        return optimize(inputs.shapes, given, device=inputs.device, tick=tick, initial=initial, **options)
    starts = {} if prior is None else prior.initial_of_structures(inputs, tick)
    structures = [
        StructureShapes(part.shapes, part.settings.placing, starts.get(name))
        for name, part in inputs.parts.items()
    ]
    lead = inputs.settings.optimize.align_by
    align_by = list(inputs.parts).index(lead) if lead else None
    return optimize_jointly(
        inputs.shapes, structures, device=inputs.device, tick=tick, align_by=align_by, **options
    )


def _outcome(inputs: OptimizationInput, result: OptimizedParticles, control: Control) -> OptimizationOutcome:
    """Return the outcome of an optimization, with those of several structures."""
    return OptimizationOutcome(
        add_repair_notes(inputs, result),
        result.world,
        result.local,
        result.alignments,
        result.energies,
        result.iterations,
        result.reason.value,
        control.seconds,
        {
            name: _outcome(part, own, control)
            for (name, part), own in zip(inputs.parts.items(), result.parts, strict=True)
        },
    )
