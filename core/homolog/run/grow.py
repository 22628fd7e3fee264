"""Runs with a core set: some subjects are optimized jointly, and the others are fitted to them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from homolog.cluster import SubjectWorkers
from homolog.cohort import Cohort
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.grooming import GroomedSubject
from homolog.memory import Store, in_memory
from homolog.progress import run_in_background
from homolog.registration import align_cohort
from homolog.run.choose_core import choose_core
from homolog.run.control import Control
from homolog.run.core_set import fit_others, prepare_from_disk
from homolog.run.events import Phase
from homolog.run.fingerprints import run_fingerprint
from homolog.run.result import OptimizationInput, OptimizationOutcome
from homolog.settings import RunSettings
from homolog.threads import cores

__all__ = ["grow"]


def grow(
    cohort: Cohort,
    outlines: Sequence[GroomedSubject],
    settings: RunSettings,
    folders: tuple[Path, Path],
    device: str,
    control: Control,
    optimized: Callable[[OptimizationInput], OptimizationOutcome],
    *,
    in_process: bool = False,
    store: Store = in_memory,
    registrations: Path | None = None,
) -> OptimizationOutcome:
    """Optimize a core set, and fit the others to it.

    Parameters
    ----------
    cohort : Cohort
    outlines : sequence of GroomedSubject
        Outlines of the cohort's subjects, in its order, from `choose_core.outline`.
    settings : RunSettings
        Settings of a run with a core set.
    folders : (Path, Path)
        Folders of the groomed subjects, and of the fits; existing fits are reused.
    device : str
        Warp's device alias.
    control : Control
        Control of the run, in the alignment phase.
    optimized : callable
        Places the particles of the core set.
    in_process : bool
        Whether to fit in a thread of this process, one subject at a time, instead of worker processes.
    store : Store
        Storage of the core set's shapes, and of the particles of all.
    registrations : Path, optional
        File with earlier registrations; see `align_cohort`.

    Returns
    -------
    OptimizationOutcome
        Outcome of the whole cohort, whose shapes are read from the folder on access.

    Raises
    ------
    InputError
        If shapes can't be compared, or landmarks are requested.
    NumericalError
        If a fit fails.
    """
    tick, (groomed, fits) = control.tick, folders
    if settings.optimize.landmarks:
        raise InputError("core sets do not support landmarks; run without one of them")
    annotated, alignments = run_in_background(
        lambda inner: align_cohort(cohort, outlines, settings.groom, inner, cache=registrations),
        tick,
        "aligning",
    )
    whole = prepare_from_disk(cohort, annotated, alignments, settings, groomed, device)
    groups = [subject.group for subject in cohort.subjects]
    size = settings.optimize.core_set or len(outlines)
    core = run_in_background(
        lambda _: choose_core(outlines, alignments, groups, size), tick, "choosing the core set"
    )
    chosen = core.tolist()
    subjects = Cohort(tuple(cohort.subjects[index] for index in chosen), cohort.folder)
    shapes = [whole.shapes[index].stored(store) for index in chosen]
    fingerprint = run_fingerprint(settings.placing, shapes, tick)
    outcome = optimized(
        OptimizationInput(
            subjects, settings, [annotated[index] for index in chosen], shapes, fingerprint, device
        )
    )
    control.enter(Phase.FITTING, "fitting to the core set")
    with SubjectWorkers(
        settings.workers or cores(),
        settings.cluster,
        control.work_on,
        in_process=in_process,
    ) as workers:
        local, aligned = fit_others(
            whole.shapes,
            [item.name for item in annotated],
            core,
            outcome,
            fits,
            groomed,
            settings,
            workers,
            tick,
            store=store,
        )
    for index, item in zip(chosen, outcome.inputs.groomed, strict=True):
        annotated[index] = item
    return replace(
        outcome,
        inputs=replace(whole, groomed=annotated, fingerprint=fingerprint),
        world=transform_points(aligned, local),
        local=local,
        alignments=aligned,
        seconds=control.seconds,
    )
