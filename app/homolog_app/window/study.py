"""What is studied and how, as one immutable value: every edit makes a new one."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from homolog.cohort import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    TABLE_SUFFIXES,
    Cohort,
    Subject,
    TableChanges,
    image_beside,
    landmarks_beside,
    read_cohort,
    table,
)
from homolog.errors import InputError
from homolog.settings import RunSettings

__all__ = ["Member", "Study", "found_subjects", "with_table"]


@dataclass(frozen=True, slots=True)
class Member:
    """A subject on the list, taken into the run or left out."""

    subject: Subject
    included: bool = True

    @property
    def name(self) -> str:
        """The subject's name."""
        return self.subject.name


@dataclass(frozen=True, slots=True)
class Study:
    """The list of subjects and the settings of the next run."""

    members: tuple[Member, ...] = ()
    settings: RunSettings = field(default_factory=RunSettings)

    @property
    def included(self) -> tuple[Subject, ...]:
        """The subjects of the next run."""
        return tuple(one.subject for one in self.members if one.included)

    @property
    def cohort(self) -> Cohort:
        """The included subjects as the core takes them."""
        folder = self.members[0].subject.path.parent if self.members else Path()
        return Cohort(self.included, folder)

    @property
    def whole(self) -> Cohort:
        """All subjects, also those left out, as the core takes them."""
        return Cohort(tuple(one.subject for one in self.members), Path())

    @property
    def groups(self) -> list[str]:
        """The groups' names, sorted."""
        return sorted({one.subject.group for one in self.members if one.subject.group})

    @property
    def columns(self) -> list[str]:
        """Names of the further columns, in the order in which they first occur."""
        return list(dict.fromkeys(name for one in self.members for name in one.subject.columns))

    def with_members(self, changed: Mapping[str, Member]) -> "Study":
        """Return the study with some members replaced, by name."""
        return replace(self, members=tuple(changed.get(one.name, one) for one in self.members))

    def adding(self, subjects: Iterable[Subject]) -> "Study":
        """Return the study with more subjects; files that are listed already are not added again."""
        files = {one.subject.path for one in self.members}
        names = {one.name for one in self.members}
        added = []
        for one in subjects:
            if one.path in files:
                continue
            name, number = one.name, 1
            while name in names:
                number += 1
                name = f"{one.name} ({number})"
            files.add(one.path)
            names.add(name)
            added.append(Member(replace(one, name=name)))
        return replace(self, members=(*self.members, *added))

    def relocated(self, folder: Path) -> "Study":
        """Return the study with the files that are gone looked for, by name, in another folder."""
        found = {
            one.name: replace(one, subject=replace(one.subject, path=folder / one.subject.path.name))
            for one in self.members
            if not one.subject.path.exists() and (folder / one.subject.path.name).exists()
        }
        return self.with_members(found)

    def without(self, names: Iterable[str]) -> "Study":
        """Return the study without some members."""
        gone = set(names)
        return replace(self, members=tuple(one for one in self.members if one.name not in gone))


def found_subjects(paths: Iterable[Path]) -> list[Subject]:
    """Return the subjects of folders, tables and single files, as they were dropped or chosen.

    Raises
    ------
    InputError
        If a folder holds none, or a file is of no known kind.
    """
    found: list[Subject] = []
    for path in paths:
        suffix = next(
            (one for one in IMAGE_SUFFIXES + MESH_SUFFIXES if path.name.lower().endswith(one)), None
        )
        if path.is_dir() or path.suffix.lower() in TABLE_SUFFIXES:
            found += read_cohort(path).subjects
        elif suffix is None:
            raise InputError(
                f"{path.name} is not a segmentation or surface; known suffixes are "
                f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)}"
            )
        else:
            name = path.name[: -len(suffix)]
            found.append(Subject(name, path, landmarks=landmarks_beside(path), image=image_beside(path)))
    return found


def with_table(study: Study, path: Path) -> tuple[Study, TableChanges]:
    """Read groups and covariates from a table; return the study with them, and what changes.

    Raises
    ------
    InputError
        If the file can't be read or names no subject of the study.
    """
    changes = table.with_table([one.subject for one in study.members], path)
    changed = {
        one.name: replace(one, subject=subject)
        for one, subject in zip(study.members, changes.subjects, strict=True)
    }
    return study.with_members(changed), changes
