"""Runs with a core set: some subjects are optimized jointly, and the others are fitted to them.

Of several structures, a subject is fitted to each one by one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.cluster import SubjectWorkers
from homolog.cohort import Cohort
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.grooming import GroomedSubject
from homolog.io.project import ProjectFolder
from homolog.memory import Store, in_memory
from homolog.progress import Tick, part_of, run_in_background
from homolog.run.choose_core import choose_core
from homolog.run.control import Control
from homolog.run.core_set import alignments_to_core, fit_others
from homolog.run.events import Phase
from homolog.run.fingerprints import run_fingerprint
from homolog.run.result import OptimizationInput, OptimizationOutcome
from homolog.run.steps import prepare_inputs
from homolog.run.structures import prepare_joint_inputs
from homolog.settings import RunSettings
from homolog.threads import cores

__all__ = ["grow"]


def grow(
    cohort: Cohort,
    outlines: Mapping[str, Sequence[GroomedSubject]],
    settings: RunSettings,
    project: ProjectFolder,
    device: str,
    control: Control,
    optimized: Callable[[OptimizationInput], OptimizationOutcome],
    *,
    in_process: bool = False,
    store: Store = in_memory,
) -> OptimizationOutcome:
    """Optimize a core set, and fit the others to it.

    Parameters
    ----------
    cohort : Cohort
    outlines : mapping of str to sequence of GroomedSubject
        Outlines of the subjects by structure ("" for a single one), in the order of the cohort, from
        `choose_core.outline`.
    settings : RunSettings
        Settings of a run with a core set.
    project : ProjectFolder
        Has the groomed subjects and the registrations; fits are stored there, and existing ones reused.
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
    tick = control.tick
    if settings.optimize.landmarks:
        raise InputError("core sets do not support landmarks; run without one of them")
    if "" in outlines:
        whole = prepare_inputs(
            cohort,
            outlines[""],
            settings,
            device,
            tick,
            registrations=project.registrations,
            folder=project.groomed,
        )
    else:
        folders = {name: project.structure(name).groomed for name in outlines}
        whole = prepare_joint_inputs(
            cohort, outlines, settings, device, tick, project=project, folders=folders
        )
    alignments = np.stack([shape.alignment for shape in whole.shapes])
    groups = [subject.group for subject in whole.cohort.subjects]
    size = min(settings.optimize.core_set or len(groups), len(groups))
    core = run_in_background(
        lambda _: choose_core(whole.groomed, alignments, groups, size), tick, "choosing the core set"
    )
    names = [whole.groomed[index].name for index in core.tolist()]
    outcome = optimized(_of(whole, names, store, tick))
    control.enter(Phase.FITTING, "fitting to the core set")
    with SubjectWorkers(
        settings.workers or cores(), settings.cluster, control.work_on, in_process=in_process
    ) as workers:

        def fitted(
            inputs: OptimizationInput, known: OptimizationOutcome, place: ProjectFolder, part: Tick
        ) -> OptimizationOutcome:
            rows = _rows(inputs, names)
            local, aligned = fit_others(
                inputs.shapes,
                [item.name for item in inputs.groomed],
                rows,
                known,
                place.fits,
                place.groomed,
                inputs.settings,
                workers,
                part,
                store=store,
            )
            return _grown(inputs, known, rows, local, aligned, control)

        if not whole.parts:
            return fitted(whole, outcome, project, tick)
        share = 1.0 / len(whole.parts)
        parts = {
            name: fitted(
                part,
                outcome.parts[name],
                project.structure(name),
                part_of(tick, number * share, (number + 1) * share),
            )
            for number, (name, part) in enumerate(whole.parts.items())
        }
    everybody = [item.name for item in whole.groomed]
    own = {name: part.local[_rows(part.inputs, everybody)] for name, part in parts.items()}
    local, lead = np.concatenate(list(own.values()), axis=1), settings.optimize.align_by
    alignments[core] = outcome.alignments
    aligned = alignments_to_core(local if lead is None else own[lead], alignments, core, settings.placing)
    return replace(_grown(whole, outcome, core, local, aligned, control), parts=parts)


def _rows(inputs: OptimizationInput, names: Sequence[str]) -> IntArray:
    rows = {item.name: row for row, item in enumerate(inputs.groomed)}
    return np.array([rows[name] for name in names])


def _of(inputs: OptimizationInput, names: Sequence[str], store: Store, tick: Tick) -> OptimizationInput:
    """Return the inputs of named subjects, in a store."""
    rows = _rows(inputs, names).tolist()
    parts = {name: _of(part, names, store, tick) for name, part in inputs.parts.items()}
    shapes = [inputs.shapes[row].stored(store) for row in rows]
    every = [*shapes, *(shape for part in parts.values() for shape in part.shapes)]
    return replace(
        inputs,
        cohort=Cohort(tuple(inputs.cohort.subjects[row] for row in rows), inputs.cohort.folder),
        groomed=[inputs.groomed[row] for row in rows],
        shapes=shapes,
        fingerprint=run_fingerprint(inputs.settings.placing, every, tick),
        parts=parts,
    )


def _grown(
    inputs: OptimizationInput,
    outcome: OptimizationOutcome,
    core: IntArray,
    local: FloatArray,
    alignments: FloatArray,
    control: Control,
) -> OptimizationOutcome:
    """Return the outcome of a core set with the particles of all subjects."""
    groomed = list(inputs.groomed)
    for index, item in zip(core.tolist(), outcome.inputs.groomed, strict=True):
        groomed[index] = item
    return replace(
        outcome,
        inputs=replace(inputs, groomed=groomed, fingerprint=outcome.inputs.fingerprint),
        world=transform_points(alignments, local),
        local=local,
        alignments=alignments,
        seconds=control.seconds,
    )
