"""The schema of project.json: malicious or newer files are refused."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from homolog.cohort import checked_path, other_side
from homolog.io.names import checked_stem
from homolog.settings import RunSettings
from homolog.surfaces.mirroring import mirrors

__all__ = [
    "FORMAT_VERSION",
    "IMPORTED",
    "NoteKind",
    "ProjectRecord",
    "ResultRecord",
    "ResultStructure",
    "ResultSubject",
    "SubjectRecord",
    "note_kinds",
    "note_lines",
]

FORMAT_VERSION = 1
IMPORTED = "imported"
"""Value of `ended` for results of other programs."""

_ENDINGS = {
    "converged": "converged after {} iterations",
    "iterations": "not converged after {} iterations",
    "registration": "registered only: {} iterations made left-out subjects harder to predict",
    "cancelled": "cancelled after {} iterations",
    IMPORTED: "imported, not optimized here",
}

_NUMBER = re.compile(r"(?<![\w.-])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)")
_PLURAL = re.compile(r"(?<=[a-z])s\b")

_Row = Annotated[list[float], Field(min_length=4, max_length=4)]
_Path = Annotated[str, AfterValidator(checked_path)]
_Stem = Annotated[str, AfterValidator(checked_stem)]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SubjectRecord(_Record):
    """A subject of the project's cohort; paths are relative to the project's folder, with forward slashes.

    `structures` are the files by structure, if each has its own.
    """

    name: str
    path: _Path
    structures: dict[str, _Path] = {}
    group: str | None = None
    columns: dict[str, str] = {}
    landmarks: _Path | None = None
    image: _Path | None = None


class ResultSubject(_Record):
    """A subject of the result, with everything needed to use the result without the input files.

    `file` is the stem of the subject's files, `content` the hash of its groomed surface, `alignment` the
    similarity from local to world coordinates (a reflection for a mirrored subject), `side` the side of the
    body if known, and `notes` are the findings and changes of grooming. `spacing` is the distance of its
    grid's nodes [mm] and `vertices` the number of its surface's vertices, both 0 if unknown. `voxel` contains
    the edges of its file's voxels [mm]; it is empty for surfaces and if unknown.
    """

    name: str
    file: _Stem
    group: str | None = None
    columns: dict[str, str] = {}
    side: Literal["", "left", "right"] = ""
    content: str
    alignment: Annotated[list[_Row], Field(min_length=4, max_length=4)]
    notes: list[str] = []
    spacing: Annotated[float, Field(ge=0.0)] = 0.0
    vertices: Annotated[int, Field(ge=0)] = 0
    voxel: list[Annotated[float, Field(gt=0.0)]] = []

    @property
    def is_mirrored(self) -> bool:
        """Whether world coordinates are those of the subject's mirror image."""
        return bool(mirrors(np.array(self.alignment)))


class ResultStructure(_Record):
    """A structure of subjects with several: how many particles and vertices of the mean surface are its own.

    Those of the structures follow one another.
    """

    name: str
    particles: Annotated[int, Field(ge=1)]
    vertices: Annotated[int, Field(ge=1)]


class ResultRecord(_Record):
    """The record of a result, to compare and to repeat it.

    `ended` is the reason why the optimizer stopped, and `metric` the distance between particles on a surface.
    `folded_faces` is the number of folded faces of the mean surface, and `smoothed_particles` that of the
    particles which it does not interpolate, to avoid folds. `fingerprint` is a hash of the settings and of
    every groomed surface, `seconds` the time by phase, `source` the origin of an imported model, and
    `excluded` has a line for each excluded subject of the cohort. `structures` are those of subjects with
    several.
    """

    finished: str
    ended: str
    iterations: Annotated[int, Field(ge=0)]
    particles: Annotated[int, Field(ge=1)]
    metric: Literal["geodesic", "euclidean", "unknown"]
    folded_faces: Annotated[int, Field(ge=0)]
    smoothed_particles: Annotated[int, Field(ge=0)] = 0
    settings: RunSettings
    device: str
    versions: dict[str, str]
    seconds: dict[str, float]
    fingerprint: str
    source: str = ""
    excluded: list[str] = []
    subjects: Annotated[list[ResultSubject], Field(min_length=2)]
    structures: list[ResultStructure] = []

    @property
    def remarks(self) -> list[str]:
        """Notes by `note_lines`, which name at most two subjects."""
        return note_lines({subject.name: subject.notes for subject in self.subjects})

    @property
    def end_text(self) -> str:
        """Reason and iteration of the optimization's end: "converged after 970 iterations"."""
        return _ENDINGS.get(self.ended, self.ended).format(self.iterations)

    @property
    def mirrored_text(self) -> str:
        """Summary of mirrored subjects: "3 left subjects were mirrored to right"; empty without any."""
        who = [subject for subject in self.subjects if subject.is_mirrored]
        if not who:
            return ""
        sides = {item.side for item in who}
        side = sides.pop() if len(sides) == 1 else ""
        subjects = f"{side} subject".strip() if len(who) == 1 else f"{side} subjects".strip()
        target = f" to {other_side(side)}" if side else ""
        return f"{len(who)} {subjects} {'was' if len(who) == 1 else 'were'} mirrored{target}"

    @property
    def surface_text(self) -> str:
        """Remarks on the mean surface."""
        text = f"{self.folded_faces} folded faces on the mean"
        if self.smoothed_particles:
            text += f", smoothed around {self.smoothed_particles} particles where it would fold"
        return text

    @model_validator(mode="after")
    def _files_are_distinct(self) -> "ResultRecord":
        if len({subject.file.casefold() for subject in self.subjects}) < len(self.subjects):
            raise ValueError("two subjects have the same file")
        if self.structures and sum(item.particles for item in self.structures) != self.particles:
            raise ValueError("the particles of the structures are not those of the result")
        return self


class ProjectRecord(_Record):
    """The content of project.json.

    `subjects` and `settings` are those of the next run. `unfinished` means that a run was started and has not
    finished, and `from_result` that it started from the last result. `excluded` contains the reasons for its
    excluded subjects, by name.
    """

    format: Literal["homolog-project"] = "homolog-project"
    version: Annotated[int, Field(ge=1, le=FORMAT_VERSION)] = FORMAT_VERSION
    subjects: list[SubjectRecord] = []
    settings: RunSettings = RunSettings()
    unfinished: bool = False
    from_result: bool = False
    excluded: dict[str, str] = {}
    result: ResultRecord | None = None


def _kind_of(note: str) -> str:
    """Return a note without its numbers and plurals."""
    return _PLURAL.sub("", _NUMBER.sub("#", note))


@dataclass(frozen=True, slots=True)
class NoteKind:
    """Notes of one kind on several subjects.

    Attributes
    ----------
    text : str
        The note, with the ranges of its numbers: ``2 to 5 pieces …``.
    notes : tuple of (str, str)
        Name of the subject and its own note, in the order of the subjects.
    """

    text: str
    notes: tuple[tuple[str, str], ...]

    @property
    def names(self) -> list[str]:
        """Names of the subjects, each once."""
        return list(dict.fromkeys(name for name, _ in self.notes))


def note_kinds(notes: Mapping[str, Sequence[str]]) -> list[NoteKind]:
    """Return the notes about subjects by kind; notes that differ only in their numbers are of one kind."""
    kinds: dict[str, list[tuple[str, str]]] = {}
    for name, own in notes.items():
        for note in own:
            kinds.setdefault(_kind_of(note), []).append((name, note))
    return [NoteKind(_spanned([note for _, note in noted]), tuple(noted)) for noted in kinds.values()]


def note_lines(notes: Mapping[str, Sequence[str]], most_names: int = 2) -> list[str]:
    """Return one line per kind of notes: each of 14 subjects (s013, s016, …): 2 to 5 pieces …."""
    lines = []
    for kind in note_kinds(notes):
        who = ", ".join(kind.names[:most_names])
        if len(kind.names) > most_names:
            who = f"{len(kind.names)} subjects ({who}, …)"
        if len(kind.names) > 1:
            who = f"each of {who}"  # notes are in the singular
        lines.append(f"{who}: {kind.text}")
    return lines


def _spanned(notes: Sequence[str]) -> str:
    """Return the longest of notes of one kind with the ranges of all their numbers."""
    columns = zip(*(_NUMBER.findall(note) for note in notes), strict=True)
    ranges = iter([sorted(set(column), key=float) for column in columns])

    def spanned(_: re.Match[str]) -> str:
        values = next(ranges)
        return values[0] if len(values) == 1 else f"{values[0]} to {values[-1]}"

    return _NUMBER.sub(spanned, max(notes, key=len))
