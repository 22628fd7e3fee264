"""Several structures of each subject: what a run does for one structure, done for each and put together.

Each structure is groomed, checked and aligned as if it were modelled alone, and is a project of its own
within that of the subjects. The subjects' surfaces are those of their structures as separate pieces.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from homolog.cohort import Cohort
from homolog.correspondence import Shape
from homolog.geometry import rms_radius
from homolog.grooming import GroomedSubject, GroomReport
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, part_of
from homolog.registration import align_cohort
from homolog.run.fingerprints import run_fingerprint
from homolog.run.result import OptimizationInput, add_note
from homolog.run.steps import prepare_inputs
from homolog.settings import RunSettings
from homolog.surfaces.mesh import joined

__all__ = ["joined_subject", "prepare_joint_inputs"]


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
    project: ProjectFolder,
) -> OptimizationInput:
    """Align the groomed structures, each with its like, and the subjects as wholes.

    Parameters
    ----------
    cohort : Cohort
    groomed : mapping of str to sequence of GroomedSubject
        By structure, in the order of the cohort.
    settings : RunSettings
        Of all structures.
    device : str
        Warp's device alias.
    tick : Tick
    project : ProjectFolder
        Stores registrations.

    Returns
    -------
    OptimizationInput
        Of the subjects, with those of the structures as `parts`.
    """
    share = 1.0 / (1 + len(groomed))
    parts = {
        name: prepare_inputs(
            cohort,
            groomed[name],
            own,
            device,
            part_of(tick, number * share, (number + 1) * share),
            registrations=project.structure(name).registrations,
        )
        for number, (name, own) in enumerate(settings.of_structures.items())
    }
    annotated = [
        joined_subject(dict(zip(parts, items, strict=True)))
        for items in zip(*(part.groomed for part in parts.values()), strict=True)
    ]
    if settings.optimize.align_by is not None:
        alignments = np.stack([shape.alignment for shape in parts[settings.optimize.align_by].shapes])
    else:
        _, alignments = align_cohort(
            cohort, annotated, settings.groom, part_of(tick, 1.0 - share, 1.0), cache=project.registrations
        )
    annotated = _with_other_places(annotated, parts)
    shapes = [
        Shape(item.name, item.field, item.mesh, item.coarse_mesh, alignment, parts=own)
        for item, alignment, own in zip(
            annotated, alignments, zip(*(part.shapes for part in parts.values()), strict=True), strict=True
        )
    ]
    every = [*shapes, *(shape for part in parts.values() for shape in part.shapes)]
    fingerprint = run_fingerprint(settings.placing, every, tick)
    return OptimizationInput(cohort, settings, annotated, shapes, fingerprint, device, parts)


def _with_other_places(
    subjects: Sequence[GroomedSubject], parts: Mapping[str, OptimizationInput]
) -> list[GroomedSubject]:
    """Return the subjects, with a note on each in which two structures lie where they lie in no other.

    A structure that is farther from or nearer to another one than usual by the size of the subject did not
    move in the body: the files are in different frames.
    """
    result = list(subjects)
    size = float(np.median([rms_radius(item.coarse_mesh.vertices) for item in subjects]))
    centres = {
        name: np.stack([item.mesh.vertices.mean(axis=0) for item in part.groomed])
        for name, part in parts.items()
    }
    for first, second in combinations(parts, 2):
        distances = np.linalg.norm(centres[first] - centres[second], axis=1)
        usual = float(np.median(distances))
        for index in np.flatnonzero(np.abs(distances - usual) > size).tolist():
            note = (
                f"{first} and {second} lie {distances[index]:.0f} mm apart, {usual:.0f} mm in most others: "
                "its files may be in different coordinate systems; export them in one"
            )
            result[index] = add_note(result[index], note)
    return result
