"""Subjects as the views show them: their own surfaces, in common coordinates. Knows no Qt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.cohort import Subject
from homolog.settings import GroomSettings
from homolog.surfaces.mirroring import mirrors
from homolog_app.rendering.colours import colours_by_place
from homolog_app.views.content import Content
from homolog_app.window.loaded_result import LoadedResult

if TYPE_CHECKING:
    from homolog.grooming import GroomedSubject
    from homolog_app.window.file_survey import FileSurvey

__all__ = ["Groomed", "moment_of", "subject_contents"]


@dataclass(frozen=True, slots=True, eq=False)
class Groomed:
    """A groomed subject, its (4, 4) alignment to the cohort, and the settings it was groomed with."""

    subject: "GroomedSubject"
    alignment: FloatArray
    settings: GroomSettings


def moment_of(loaded: LoadedResult, index: int) -> tuple[dict[str, FloatArray], Array]:
    """Return the particles (N, 3) [mm] of each subject at a stored moment of the run, and their colours.

    All moments with as many particles have the same colours: those of the last one of them.
    """
    names, final = loaded.result.names, loaded.result.world
    particles = loaded.frames[index].particles
    stages = [frame.particles for frame in loaded.frames] + [final]
    usual = next(stage for stage in reversed(stages) if stage.shape[1] == particles.shape[1])
    shown = final if index == len(loaded.frames) - 1 else particles
    return dict(zip(names, shown, strict=True)), colours_by_place(np.asarray(usual).mean(axis=0))


def subject_contents(
    subjects: Sequence[Subject],
    surveys: "Mapping[str, FileSurvey]",
    groomed: Mapping[str, Groomed],
    result: LoadedResult | None,
) -> list[Content]:
    """Return what can be seen of each subject.

    A result shows its own surfaces; before there is one, the groomed surfaces where they are, the input
    elsewhere. Subjects without an alignment are shown about their own centre.
    """
    alignments = dict(zip(result.result.names, result.result.alignments, strict=True)) if result else {}
    turned = dict(zip(alignments, mirrors(result.result.alignments).tolist(), strict=True)) if result else {}
    contents = []
    for subject in subjects:
        survey, smooth = surveys.get(subject.name), groomed.get(subject.name)
        raw = survey.surface if survey else None
        fine, coarse = (smooth.subject.mesh, smooth.subject.coarse_mesh) if smooth else (None, None)
        alignment = smooth.alignment if smooth else None
        if result is not None and subject.name in alignments:
            fine, coarse = result.surfaces[subject.name]
            alignment = alignments[subject.name]
        if alignment is None:
            alignment = np.eye(4)
            if raw is not None:
                alignment[:3, 3] = -raw.vertices.mean(axis=0)
        mirrored = turned.get(subject.name, smooth is not None and bool(mirrors(alignment)))
        notes = [subject.group or "", "mirrored" if mirrored else ""]
        if fine is None and survey is not None and survey.every > 1:
            notes.append(f"every {survey.every}. voxel")
        note = " · ".join(note for note in notes if note)
        contents.append(Content(subject.name, raw, fine, coarse, alignment, note))
    return contents
