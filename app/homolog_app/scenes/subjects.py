"""Contents of the views: subjects, and their particles in a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.io.constraints import cuts_of, own_text, parse_cuts, text_of
from homolog.io.records import note_kinds
from homolog.settings import GroomSettings, RunSettings
from homolog.surfaces.clipping import Cut
from homolog.surfaces.mesh import TriangleMesh, joined
from homolog.surfaces.mirroring import mirrors
from homolog_app.rendering.colours import colours_by_place
from homolog_app.rendering.content import Content, SubjectContents
from homolog_app.scenes.loaded_result import LoadedResult

if TYPE_CHECKING:
    from homolog.grooming import GroomedSubject
    from homolog_app.scenes.file_survey import FileSurvey

__all__ = [
    "Groomed",
    "Triage",
    "moment_of",
    "readable_cuts",
    "realigned",
    "single_subject",
    "subject_contents",
    "whole_surface",
]


@dataclass(frozen=True, slots=True, eq=False)
class Groomed:
    """A groomed subject, its (4, 4) alignment to the cohort, and how it was groomed.

    Attributes
    ----------
    subject : GroomedSubject
    alignment : (4, 4) array
    settings : GroomSettings
        Those of the cohort.
    own : str
        What differs for this subject, as `own_text` has it.
    """

    subject: "GroomedSubject"
    alignment: FloatArray
    settings: GroomSettings
    own: str = ""


@dataclass(frozen=True, slots=True)
class Triage:
    """What grooming says of a cohort: of single subjects, of most of them, or nothing.

    Attributes
    ----------
    look : mapping of str to tuple of str
        Notes of a kind that fewer than half of the subjects have, by subject; the rarest kinds first.
    whole : tuple of (str, int)
        Notes of half of the subjects or more, with their numbers of subjects.
    fine : tuple of str
        The other subjects.
    """

    look: Mapping[str, tuple[str, ...]]
    whole: tuple[tuple[str, int], ...]
    fine: tuple[str, ...]

    @classmethod
    def of(cls, groomed: Mapping[str, Groomed]) -> "Triage":
        """Return the triage of groomed subjects."""
        kinds = note_kinds({name: item.subject.report.notes for name, item in groomed.items()})
        kinds.sort(key=lambda kind: len(kind.names))
        look: dict[str, tuple[str, ...]] = {}
        whole = []
        for kind in kinds:
            if len(groomed) > 1 and 2 * len(kind.names) >= len(groomed):
                whole.append((kind.text, len(kind.names)))
                continue
            for name, note in kind.notes:
                look[name] = (*look.get(name, ()), note)
        return cls(look, tuple(whole[::-1]), tuple(name for name in groomed if name not in look))


def moment_of(loaded: LoadedResult, index: int) -> tuple[dict[str, FloatArray], Array]:
    """Return the particles (N, 3) [mm] of each subject in a recorded frame of the run, and their colours.

    All frames with the same number of particles have the colours of the last of these frames.
    """
    names, final, frame = loaded.result.names, loaded.result.world, loaded.frames[index]
    stages = [each.particles for each in loaded.frames] + [final]
    stage_particles = next(stage for stage in reversed(stages) if stage.shape[1] == frame.particles.shape[1])
    shown = frame.particles
    if index == len(loaded.frames) - 1:
        shown = final
    elif frame.alignments is not None:
        shown = realigned(frame.particles, frame.alignments, loaded.result.alignments)
    return dict(zip(names, shown, strict=True)), colours_by_place(np.asarray(stage_particles).mean(axis=0))


def realigned(particles: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the particles (M, n, 3) of aligned shapes as other alignments (M, 4, 4) place the shapes."""
    return transform_points(after @ np.linalg.inv(before), particles)


def subject_contents(
    subjects: Sequence[Subject],
    surveys: "Mapping[str, FileSurvey]",
    groomed: Mapping[str, Groomed],
    result: LoadedResult | None,
    settings: RunSettings,
) -> SubjectContents:
    """Return the contents of all subjects.

    With a result, its surfaces are shown; without one, the groomed surfaces, or the input of subjects that
    are not groomed. Subjects without an alignment are centred.
    """
    alignments = dict(zip(result.result.names, result.result.alignments, strict=True)) if result else {}
    done = {item.name: own_text(item.columns) for item in result.record.subjects} if result else {}
    wanted = {name: alone.optimize.particles for name, alone in settings.of_structures.items()}
    structures = result.result.structures if result else wanted
    turned = dict(zip(alignments, mirrors(result.result.alignments).tolist(), strict=True)) if result else {}

    def made(place: int) -> Content:
        subject = subjects[place]
        survey, smooth = surveys.get(subject.name), groomed.get(subject.name)
        raw = survey.surface if survey else None
        fine, coarse = (smooth.subject.mesh, smooth.subject.coarse_mesh) if smooth else (None, None)
        alignment = smooth.alignment if smooth else None
        if result is not None and subject.name in alignments:
            fine, coarse = result.surfaces[subject.name]
            alignment = alignments[subject.name]
        own, faded = own_text(subject.columns), False
        keys = [alone.structure for alone in settings.groom.of_structures.values()] or [""]
        cuts = tuple(text_of(readable_cuts(subject, key)) for key in keys)
        if any(cuts):
            is_cut = own == (done[subject.name] if subject.name in alignments else smooth and smooth.own)
            whole = raw if is_cut else whole_surface(subject.name, surveys, groomed)
            if whole is not None and len(whole.parts) == len(cuts):
                kept, rest = parts_of(whole, cuts)
                fine, coarse = (fine, coarse) if is_cut or not len(kept.faces) else (kept, None)
                raw, faded = rest, rest is not None
        if alignment is None:
            alignment = np.eye(4)
            if raw is not None:
                alignment[:3, 3] = -raw.vertices.mean(axis=0)
        mirrored = turned.get(subject.name, smooth is not None and bool(mirrors(alignment)))
        notes = [subject.group or "", "mirrored" if mirrored else ""]
        if fine is None and survey is not None and survey.every > 1:
            notes.append(f"every {_ORDINALS.get(survey.every, f'{survey.every}th')} voxel")
        note = " · ".join(note for note in notes if note)
        count = len((fine or raw or _NO_SURFACE).parts)
        layers = structures if count == len(structures) else {}
        if raw is not None and not faded and len(raw.parts) != count:
            raw = None  # of all structures, and one of them is shown
        return Content(subject.name, raw, fine, coarse, alignment, note, faded=faded, structures=layers)

    return SubjectContents([subject.name for subject in subjects], made)


def readable_cuts(subject: Subject, structure: str = "") -> tuple[Cut, ...]:
    """Return what is cut away of a subject, or of one of several structures.

    It is nothing if the table can't be read, which grooming reports.
    """
    try:
        return cuts_of(subject, structure)
    except InputError:
        return ()


def whole_surface(
    name: str, surveys: "Mapping[str, FileSurvey]", groomed: Mapping[str, Groomed]
) -> TriangleMesh | None:
    """Return a subject's surface before anything is cut away: groomed, else that of its file."""
    smooth, survey = groomed.get(name), surveys.get(name)
    if smooth is not None and "\n" not in smooth.own:
        return smooth.subject.mesh
    return survey.surface if survey else None


_PARTS = 64
"""Subjects whose parts are remembered: four pages."""


@lru_cache(_PARTS)
def parts_of(whole: TriangleMesh, texts: tuple[str, ...]) -> tuple[TriangleMesh, TriangleMesh | None]:
    """Return what cuts keep of a surface, by structure, and what they leave out, if anything."""
    from homolog.grooming.cuts import kept_surface

    pieces = [kept_surface(part, parse_cuts(text, "")) for part, text in zip(whole.parts, texts, strict=True)]
    rest = [item for _, those in pieces for item in those]
    kept, out = joined([part for part, _ in pieces]), joined(rest) if rest else None
    return kept, out and TriangleMesh(out.vertices, out.faces)  # pieces, not structures


_NO_SURFACE = TriangleMesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
_ORDINALS = {2: "second", 3: "third"}


def single_subject(subject: Content) -> Content:
    """Return a subject with only its groomed surface and a corresponding caption."""
    return replace(subject, raw=None, note="groomed surface")
