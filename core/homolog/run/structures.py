"""Several structures of each subject: what a run does for one structure, done for each and put together.

Each structure is groomed, checked and aligned as if it were modelled alone, and is a project of its own
within that of the subjects. The subjects' surfaces are those of their structures as separate pieces. A
subject that lacks a structure takes part with the others that it has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from homolog.cohort import Cohort
from homolog.correspondence import Shape
from homolog.geometry import rms_radius
from homolog.grooming import GroomedSubject, GroomReport, Problem
from homolog.grooming.cache import read_groomed
from homolog.io.markups import Markups
from homolog.io.project import ProjectFolder
from homolog.memory import OnDemand
from homolog.progress import Tick, part_of
from homolog.registration import align_cohort
from homolog.run.fingerprints import run_fingerprint
from homolog.run.landmarks import NOTHING_KNOWN, with_landmarks_of_structures
from homolog.run.prior_result import PriorResult
from homolog.run.result import OptimizationInput
from homolog.run.steps import prepare_inputs
from homolog.settings import Procrustes, RunSettings
from homolog.surfaces.mesh import joined

__all__ = ["in_other_frames", "joined_subject", "prepare_joint_inputs"]


def joined_subject(parts: Mapping[str, GroomedSubject]) -> GroomedSubject:
    """Return the structures of a subject as one surface of separate pieces, with the field of the first."""
    items = list(parts.values())
    reports, first = [item.report for item in items], items[0]
    report = GroomReport(
        components_dropped=sum(item.components_dropped for item in reports),
        holes_filled=sum(item.holes_filled for item in reports),
        padded=any(item.padded for item in reports),
        volume_before=sum(item.volume_before for item in reports),
        volume_after=sum(item.volume_after for item in reports),
        genus=sum(item.genus for item in reports),
        notes=_joined_notes({name: item.report.notes for name, item in parts.items()}),
        borders=tuple(dict.fromkeys(border for item in reports for border in item.borders)),
        voxel=first.report.voxel,
        rims=sum(item.rims for item in reports),
    )
    meshes = joined([item.mesh for item in items]), joined([item.coarse_mesh for item in items])
    return GroomedSubject(first.name, first.field, *meshes, report)


def _joined_notes(notes: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return the notes on all structures; what holds for all is said once, else with the structure's name."""
    common = [note for note in next(iter(notes.values())) if all(note in item for item in notes.values())]
    own = [f"{name}: {note}" for name, item in notes.items() for note in item if note not in common]
    return (*common, *own)


def prepare_joint_inputs(
    cohort: Cohort,
    groomed: Mapping[str, Sequence[GroomedSubject]],
    settings: RunSettings,
    device: str,
    tick: Tick,
    *,
    project: ProjectFolder | None = None,
    prior: PriorResult | None = None,
    folders: Mapping[str, Path] | None = None,
    landmarks: Mapping[str, Markups] = NOTHING_KNOWN,
) -> OptimizationInput:
    """Align the groomed structures, each with its like, and as wholes the subjects that have all.

    Parameters
    ----------
    cohort : Cohort
    groomed : mapping of str to sequence of GroomedSubject
        By structure, the subjects that have it in the order of the cohort.
    settings : RunSettings
        Of all structures.
    device : str
        Warp's device alias.
    tick : Tick
    project : ProjectFolder, optional
        Stores registrations.
    prior : PriorResult, optional
        Initial result.
    folders : mapping of str to Path, optional
        Where the groomed subjects of each structure are, if `groomed` has only their outlines: shapes are
        then read from there on each access.
    landmarks : mapping of str to Markups
        Landmarks that were read already, by subject.

    Returns
    -------
    OptimizationInput
        Of the subjects that have all structures, with those of the structures as `parts`.
    """
    share = 1.0 / (1 + len(groomed))
    optimize = settings.optimize

    def prepared(number: int, name: str, own: RunSettings) -> OptimizationInput:
        have = {item.name for item in groomed[name]}
        return prepare_inputs(
            _only(cohort, have),
            groomed[name],
            own,
            device,
            part_of(tick, number * share, (number + 1) * share),
            prior=None if prior is None else prior.parts[name],
            registrations=None if project is None else project.structure(name).registrations,
            folder=None if folders is None else folders[name],
        )

    parts = {
        name: prepared(number, name, own) for number, (name, own) in enumerate(settings.of_structures.items())
    }
    if optimize.landmarks and prior is None:
        marked = with_landmarks_of_structures(
            {name: part.shapes for name, part in parts.items()}, cohort, landmarks
        )
        parts = {name: replace(part, shapes=marked[name]) for name, part in parts.items()}
    rows = [{item.name: row for row, item in enumerate(part.groomed)} for part in parts.values()]
    everything = set(rows[0]).intersection(*rows[1:])
    whole = _only(cohort, everything)
    annotated = [
        joined_subject(
            {
                name: part.groomed[row[subject.name]]
                for (name, part), row in zip(parts.items(), rows, strict=True)
            }
        )
        for subject in whole.subjects
    ]
    known = None if prior is None else prior.alignments
    lead = optimize.align_by
    if lead is None and known is None and settings.placing.procrustes is not Procrustes.OFF:
        lead = next(iter(parts))  # the particles of all align the wholes later
    if lead is None:
        _, alignments = align_cohort(
            whole,
            annotated,
            settings.groom,
            part_of(tick, 1.0 - share, 1.0),
            known=known,
            cache=None if project is None else project.registrations,
        )
    else:
        shapes, own = parts[lead].shapes, rows[list(parts).index(lead)]
        alignments = np.stack([shapes[own[item.name]].alignment for item in annotated])

    def joined_shape(index: int) -> Shape:
        own = annotated[index]
        if folders is not None:
            here = {name: read_groomed(folder, own.name) for name, folder in folders.items()}
            own = joined_subject(here)
        return Shape(own.name, own.field, own.mesh, own.coarse_mesh, alignments[index])

    if folders is not None:
        return OptimizationInput(
            whole, settings, annotated, OnDemand(len(annotated), joined_shape), "", device, parts, cohort
        )
    placed = [joined_shape(index) for index in range(len(annotated))]
    if prior is not None:
        placed = prior.shapes(placed)
    every = [*placed, *(shape for part in parts.values() for shape in part.shapes)]
    fingerprint = run_fingerprint(settings.placing, every, tick)
    return OptimizationInput(whole, settings, annotated, placed, fingerprint, device, parts, cohort)


def _only(cohort: Cohort, names: set[str]) -> Cohort:
    return cohort.without({subject.name for subject in cohort.subjects} - names)


def in_other_frames(groomed: Mapping[str, Sequence[GroomedSubject]]) -> list[Problem]:
    """Return the subjects in which two structures lie where they lie in no other.

    A structure that is farther from or nearer to another one than usual by the size of the subject did not
    move in the body: the files are in different frames.
    """
    meshes = {name: {item.name: item.coarse_mesh for item in items} for name, items in groomed.items()}
    problems: dict[str, Problem] = {}
    for first, second in combinations(meshes, 2):
        names = [name for name in meshes[first] if name in meshes[second]]
        if len(names) < 2:
            continue
        pairs = [(meshes[first][name], meshes[second][name]) for name in names]
        sizes = [rms_radius(joined(pair).vertices) for pair in pairs]
        distances = [
            np.linalg.norm(near.vertices.mean(axis=0) - far.vertices.mean(axis=0)) for near, far in pairs
        ]
        usual, size = float(np.median(distances)), float(np.median(sizes))
        for name, distance in zip(names, distances, strict=True):
            if abs(distance - usual) > size:
                text = (
                    f"{name}: its {first} and {second} lie {distance:.0f} mm apart, {usual:.0f} mm in most "
                    "others: they are in different coordinate systems; export them in one"
                )
                problems.setdefault(name, Problem(name, text))
    return list(problems.values())
