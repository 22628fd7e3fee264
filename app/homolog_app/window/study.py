"""A study as an immutable value, and extensions of its result."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

from homolog.cohort import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    TABLE_SUFFIXES,
    Cohort,
    Subject,
    TableChanges,
    proposals,
    read_cohort,
    subject_at,
    suffix_of,
    table,
    tables_of_files,
)
from homolog.errors import InputError
from homolog.io.constraints import cut_column, own_text
from homolog.io.records import ResultRecord
from homolog.settings import RunSettings

__all__ = [
    "FILES",
    "Extension",
    "Member",
    "Reading",
    "Study",
    "extension_of",
    "outdated_text",
    "read_subjects",
    "readings_of",
    "with_cuts",
    "with_table",
]


FILES = f"Segmentations and surfaces ({' '.join(f'*{suffix}' for suffix in IMAGE_SUFFIXES + MESH_SUFFIXES)})"
"""Filter for file dialogs."""


@dataclass(frozen=True, slots=True)
class Member:
    """A subject of the list, included in the run or excluded."""

    subject: Subject
    included: bool = True

    @property
    def name(self) -> str:
        """The subject's name."""
        return self.subject.name


@dataclass(frozen=True)
class Study:
    """The list of subjects and the settings of the next run."""

    members: tuple[Member, ...] = ()
    settings: RunSettings = field(default_factory=RunSettings)

    @cached_property
    def included(self) -> tuple[Subject, ...]:
        """The subjects of the next run."""
        return tuple(member.subject for member in self.members if member.included)

    @property
    def cohort(self) -> Cohort:
        """The included subjects as a cohort of the core."""
        folder = self.members[0].subject.path.parent if self.members else Path()
        return Cohort(self.included, folder)

    @property
    def whole(self) -> Cohort:
        """All subjects, including excluded ones, as a cohort of the core."""
        return Cohort(tuple(member.subject for member in self.members), Path())

    @property
    def groups(self) -> list[str]:
        """The groups' names, sorted."""
        return sorted({member.subject.group for member in self.members if member.subject.group})

    @property
    def columns(self) -> list[str]:
        """Names of the further columns, in the order in which they first occur."""
        return self.whole.columns

    def with_members(self, changed: Mapping[str, Member]) -> "Study":
        """Return the study with some members replaced, by name."""
        return replace(self, members=tuple(changed.get(member.name, member) for member in self.members))

    def adding(self, subjects: Iterable[Subject]) -> "Study":
        """Return the study with more subjects; files that are already listed are not added again."""
        files = {_files(member.subject) for member in self.members}
        names = {member.name for member in self.members}
        added = []
        for subject in subjects:
            if _files(subject) in files:
                continue
            name, number = subject.name, 1
            while name in names:
                number += 1
                name = f"{subject.name} ({number})"
            files.add(_files(subject))
            names.add(name)
            added.append(Member(replace(subject, name=name)))
        return replace(self, members=(*self.members, *added))

    def relocated(self, folder: Path) -> "Study":
        """Return the study with missing files located, by name, in another folder."""
        values = {
            member.name: replace(member, subject=_relocated(member.subject, folder))
            for member in self.members
            if not member.subject.is_there and _relocated(member.subject, folder).is_there
        }
        return self.with_members(values)

    def without(self, names: Iterable[str]) -> "Study":
        """Return the study without some members."""
        excluded = set(names)
        return replace(self, members=tuple(member for member in self.members if member.name not in excluded))


def _files(subject: Subject) -> tuple[Path, ...]:
    return (subject.path, *subject.structures.values())


def _relocated(subject: Subject, folder: Path) -> Subject:
    """Return a subject with its file, and its missing scan, located in another folder."""
    image = subject.image
    if image is not None and not image.exists() and (folder / image.name).exists():
        image = folder / image.name
    structures = {
        name: folder / file.relative_to(subject.path.parent) for name, file in subject.structures.items()
    }
    return replace(subject, path=folder / subject.path.name, image=image, structures=structures)


def read_subjects(paths: Iterable[Path]) -> Cohort:
    """Return the subjects of folders, tables and single files, with notes.

    Raises
    ------
    InputError
        If a folder contains no subjects, or a file is of an unknown kind.
    """
    from homolog.io.shapeworks import is_shapeworks, read_shapeworks_cohort

    subjects: list[Subject] = []
    notes: list[str] = []
    for path in paths:
        if is_shapeworks(path):
            subjects += read_shapeworks_cohort(path).subjects
        elif path.is_dir() or path.suffix.lower() in TABLE_SUFFIXES:
            cohort = read_cohort(path)
            subjects += cohort.subjects
            notes += cohort.notes
        elif suffix_of(path) not in IMAGE_SUFFIXES + MESH_SUFFIXES:
            raise InputError(
                f"{path.name} is not a segmentation or surface; known suffixes are "
                f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)}"
            )
        else:
            subjects.append(subject_at(path))
    return Cohort(tuple(subjects), Path(), tuple(notes))


@dataclass(frozen=True, slots=True)
class Reading:
    """A way to read a folder: as it lies, by a table that lies there, or by a pattern.

    Attributes
    ----------
    title : str
        The pattern, the table's name, or a description.
    cohort : Cohort
    kind : str
        ``"layout"``, ``"table"`` or ``"pattern"``.
    """

    title: str
    cohort: Cohort
    kind: Literal["layout", "table", "pattern"]

    @property
    def is_sure(self) -> bool:
        """Whether a layout is recognized and nothing is to be chosen first."""
        subjects = self.cohort.subjects
        structures = {name for subject in subjects for name in subject.structures}
        return self.kind == "layout" and len(structures) <= len(subjects)


def readings_of(folder: Path) -> list[Reading]:
    """Return the ways to read a folder, the recognized layout first.

    Raises
    ------
    InputError
        If there is none; the message is that of `read_cohort`.
    """
    readings, refusal = [], None
    try:
        readings.append(Reading("As it lies", read_cohort(folder), "layout"))
    except InputError as error:
        refusal = error
    if readings and readings[0].is_sure:
        return readings
    for place in tables_of_files(folder):
        with suppress(InputError):
            readings.append(Reading(place.name, read_cohort(place), "table"))
    readings += [Reading(item.pattern, item.cohort, "pattern") for item in proposals(folder)]
    if not readings:
        raise refusal or InputError(f"{folder}: contains no segmentation or mesh; choose another folder")
    return readings


def with_table(study: Study, path: Path) -> tuple[Study, TableChanges]:
    """Read groups and covariates from a table; return the updated study and the changes.

    Raises
    ------
    InputError
        If the file can't be read or names no subject of the study.
    """
    changes = table.with_table([member.subject for member in study.members], path)
    changed = {
        member.name: replace(member, subject=subject)
        for member, subject in zip(study.members, changes.subjects, strict=True)
    }
    return study.with_members(changed), changes


_CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Extension:
    """Possible extension of a result by a run.

    Attributes
    ----------
    particles : int
        Number of particles to add, if requested.
    subjects : tuple of str
        New subjects that can be fitted to the result.
    message : str
        Description of the run, or its requirements.
    """

    particles: int
    subjects: tuple[str, ...]
    message: str


def extension_of(study: Study, result: ResultRecord) -> Extension:
    """Return the possible extension of a result by a run of a study."""
    known = dict.fromkeys(subject.name for subject in result.subjects)  # not a list: thousands are looked up
    names = dict.fromkeys(subject.name for subject in study.included)
    fresh = tuple(name for name in names if name not in known)
    gone = [name for name in known if name not in names]
    more = study.settings.optimize.particles - result.particles
    own = result.settings
    same = study.settings.optimize.model_copy(update={"particles": own.optimize.particles}) == own.optimize
    if gone:
        return _not(
            f"{_listed(gone)} of the result {_are(gone)} excluded; include {_them(gone)} to continue from it."
        )
    if study.settings.groom != own.groom:
        return _not(
            "The grooming settings differ from those of the result; a run places all particles from the "
            "start."
        )
    if fresh and more:
        return _not(
            f"New subjects get the result's {result.particles} particles: set that number and fit them; add "
            "particles afterwards."
        )
    if fresh:
        new = f"{_listed(list(fresh))} {'gets' if len(fresh) == 1 else 'get'}"
        return Extension(0, fresh, f"{new} the result's particles; those of the {len(known)} others stay.")
    if more > 0 and same and result.ended != _CANCELLED:
        return Extension(
            more, (), f"The result's {result.particles} particles are split further, not placed again."
        )
    if more > 0:
        return _not(
            "The settings differ from those of the result, or the run was cancelled: all particles are "
            "placed from the start."
        )
    return _not(
        f"To extend the result, set more than {result.particles} particles, or add subjects in Cohort."
    )


def with_cuts(study: Study, cuts: Mapping[str, str], structure: str = "") -> Study:
    """Return a study with other cuts of some subjects, by name; an empty text leaves a subject whole.

    Of several structures, they are those of one.
    """
    column = cut_column(structure)
    changed = {}
    for member in study.members:
        if member.name in cuts:
            columns = dict(member.subject.columns)
            title = next((key for key in columns if key.strip().casefold() == column), column)
            columns[title] = cuts[member.name]
            changed[member.name] = replace(member, subject=replace(member.subject, columns=columns))
    return study.with_members(changed)


def outdated_text(study: Study, result: ResultRecord, *, settings: bool = True) -> str:
    """Describe changes of the cohort and of settings since a result was computed; empty without changes.

    Settings are those of the next run: the result stays as valid as it was.
    """
    known = dict.fromkeys(subject.name for subject in result.subjects)  # not a list: thousands are looked up
    names = dict.fromkeys(subject.name for subject in study.included)
    gone, fresh = [name for name in known if name not in names], [name for name in names if name not in known]
    parts = [f"{_listed(gone)} {_are(gone)} excluded in Cohort but still part of it"] if gone else []
    parts += [f"{_listed(fresh)} {_are(fresh)} not part of it"] if fresh else []
    changed = [
        name.replace("_", " ")
        for now, own in (
            (study.settings.groom, result.settings.groom),
            (study.settings.optimize, result.settings.optimize),
        )
        for name in type(now).model_fields
        if getattr(now, name) != getattr(own, name)
    ]
    parts += [f"settings have changed ({_listed(changed)})"] if changed and settings else []
    own = {item.name: own_text(item.columns) for item in result.subjects}
    anew = [item.name for item in study.included if own.get(item.name, "") != own_text(item.columns)]
    parts += [f"{_listed(anew)} {_are(anew)} to be groomed in another way"] if anew else []
    return f"This result is out of date: {'; '.join(parts)}. Run again to update it." if parts else ""


def _not(text: str) -> Extension:
    return Extension(0, (), text)


def _listed(names: list[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{', '.join(names[:2])} and {len(names) - 2} others"


def _are(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _them(names: list[str]) -> str:
    return "it" if len(names) == 1 else "them"
