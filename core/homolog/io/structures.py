"""Structures in a cohort's files: names, volumes, and numbers of subjects."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median

from homolog.cluster import each_read
from homolog.cohort import Cohort, Subject
from homolog.errors import InputError, listed
from homolog.io.images import read_volume
from homolog.io.label_names import FREESURFER, matching, near, same_name
from homolog.io.meshes import read_mesh
from homolog.progress import Tick, no_tick
from homolog.settings import Values
from homolog.surfaces.topology import enclosed_volume

__all__ = [
    "Structure",
    "Structures",
    "SubjectStructure",
    "chosen_structures",
    "joined",
    "list_structures",
    "mask_of",
    "structures_of",
    "structures_of_files",
]

_LISTED = 12
"""Largest number of structures in a message."""


@dataclass(frozen=True, slots=True)
class SubjectStructure:
    """A structure in a subject's files.

    Attributes
    ----------
    name : str
        Name of the structure; empty if unknown.
    value : int or None
        Label of the structure; None if it has a file of its own.
    volume : float
        Volume of its voxels or its surface [ml]; 0 of an open surface, which has none.
    at_border : bool
        Whether it touches the border of its image and may be cut off there.
    """

    name: str
    value: int | None
    volume: float
    at_border: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A structure of a cohort.

    Attributes
    ----------
    name : str
        The most frequent name in the files; empty if unknown.
    values : tuple of int
        Its labels: a single one if all files agree; empty if it has files of its own.
    by_subject : mapping of str to SubjectStructure
        The structure of each subject that has it, by the subject's name.
    """

    name: str
    values: tuple[int, ...]
    by_subject: Mapping[str, SubjectStructure] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Display name: its name, or its number."""
        return self.name or f"Label {self.values[0]}"

    @property
    def volumes(self) -> tuple[float, float, float]:
        """Smallest, median and largest volume [ml]."""
        volumes = [item.volume for item in self.by_subject.values()]
        return min(volumes), median(volumes), max(volumes)

    @property
    def at_border(self) -> list[str]:
        """Names of the subjects in whose images it touches the border."""
        return [name for name, item in self.by_subject.items() if item.at_border]


@dataclass(frozen=True, slots=True)
class Structures:
    """The structures of a cohort's files.

    Attributes
    ----------
    structures : tuple of Structure
        Ordered by label, then by name.
    problems : mapping of str to str
        Reasons why files can't be read, by the subject's name.
    empty : tuple of str
        Structures with files of their own that are all empty.
    unavailable : tuple of str
        Messages about structures that can't be read in files whose others can, one of each kind.
    """

    structures: tuple[Structure, ...]
    problems: Mapping[str, str]
    empty: tuple[str, ...] = ()
    unavailable: tuple[str, ...] = ()


def mask_of(subject: Subject, label: int | None, segment: str | None) -> Path:
    """Return the file of a structure.

    Parameters
    ----------
    subject : Subject
        Subject with a file per structure.
    label : int, optional
        Number of the structure.
    segment : str, optional
        Its name.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If there is no such structure, or the name is ambiguous.
    """
    masks = subject.structures
    available = listed(list(masks), _LISTED)
    if segment is None and len(masks) == 1:
        return next(iter(masks.values()))
    if segment is None:
        what = "has one file per structure, which have no numbers" if label else "has several structures"
        if all(name.isdecimal() for name in masks):
            what += ", or is a group (then list the files in a cohort.csv)"
        raise InputError(
            f"{subject.path}: {what}; choose one by its name (label: {next(iter(masks))}), or run a batch of "
            f"all; available: {available}"
        )
    matches = matching(masks.items(), segment)
    if len(matches) > 1:
        names = " and ".join(item.name for item in matches)
        raise InputError(f"{subject.path}: {segment!r} matches {names}; give the full name of one")
    if not matches:
        alike = near(masks, segment)
        nearest = f"similar names: {', '.join(alike)}; " if alike else ""
        raise InputError(f"{subject.path}: has no file of {segment!r}; {nearest}available: {available}")
    return matches[0]


def structures_of_files(cohort: Cohort) -> list[Structure]:
    """Return the structures that have files of their own, by the files' names, the most frequent first.

    No file is read. The result is empty if every subject has only one file.
    """
    by_subject = {subject.name: subject.structures for subject in cohort.subjects if subject.structures}
    if all(len(masks) == 1 for masks in by_subject.values()):
        return []
    unread = {
        subject: [SubjectStructure(name, None, 0.0) for name in masks]
        for subject, masks in by_subject.items()
    }
    return sorted(joined(unread), key=lambda structure: -len(structure.by_subject))


def _unknown(names: Iterable[str], structures: Sequence[Structure]) -> tuple[str, ...]:
    """Return the names, each once, that no structure has."""
    known, rest = [structure.name for structure in structures], list[str]()
    for name in names:
        if not any(same_name(name, other) for other in (*known, *rest)):
            rest.append(name)
    return tuple(rest)


def structures_of(subject: Subject, values: Values = Values.LABELS) -> list[SubjectStructure]:
    """Return the structures in a subject's files, reading each file once; none for a single surface.

    Raises
    ------
    InputError
        If a file can't be read, or tables of names contradict each other.
    """
    return _contents_of((subject, values))[0]


def _contents_of(job: tuple[Subject, Values]) -> tuple[list[SubjectStructure], tuple[str, ...]]:
    """Return the structures in a subject's files, and messages about those that can't be read."""
    subject, values = job
    if subject.is_mesh:
        return [], ()
    if subject.structures:
        inside = [_structure_in(name, path, values) for name, path in subject.structures.items()]
        return [structure for structure in inside if structure is not None], ()
    volume = read_volume(subject.path, values).with_names()
    structures = [
        SubjectStructure(extent.segment.name, extent.segment.value, extent.volume / 1000.0, extent.at_border)
        for extent in volume.extents()
    ]
    return structures, tuple(volume.unavailable.values())


def _structure_in(name: str, path: Path, values: Values) -> SubjectStructure | None:
    """Return the structure of a file that contains only this one; None if it is empty."""
    if Subject(name, path).is_mesh:
        volume = abs(enclosed_volume(read_mesh(path))) / 1000.0
        return SubjectStructure(name, None, 0.0 if math.isnan(volume) else volume)
    parts = read_volume(path, values).extents()
    volume = sum(part.volume for part in parts) / 1000.0
    return SubjectStructure(name, None, volume, any(part.at_border for part in parts)) if parts else None


def list_structures(cohort: Cohort, tick: Tick = no_tick, values: Values = Values.LABELS) -> Structures:
    """Read every file of a cohort, in workers, and return its structures.

    Structures of equal name are identified, whatever their numbers; structures without a name are identified
    by number.
    """
    problems: dict[str, str] = {}
    unavailable: dict[str, list[str]] = {}
    read: dict[str, tuple[list[SubjectStructure], tuple[str, ...]]] = {}
    jobs = {subject.name: (subject, values) for subject in cohort.subjects}
    files = {subject.name: subject.path for subject in cohort.subjects}
    for name, future in each_read(_contents_of, jobs, files, "reading", tick):
        try:
            read[name] = future.result()
        except InputError as error:
            problems[name] = str(error)
    by_subject = {name: read[name][0] for name in jobs if name in read}
    for fault in (fault for name in by_subject for fault in read[name][1]):
        unavailable.setdefault(fault.partition(": ")[2], []).append(fault)
    structures = joined(_named_alike(by_subject))
    names = (name for subject in cohort.subjects if subject.name in by_subject for name in subject.structures)
    return Structures(structures, problems, _unknown(names, structures), _each_once(unavailable.values()))


def _each_once(alike: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """Return one message of each kind, with the number of further files that it applies to."""
    return tuple(
        first + (f"; the same applies to {len(rest)} more file{'s' if len(rest) > 1 else ''}" if rest else "")
        for first, *rest in alike
    )


def _named_alike(
    by_subject: Mapping[str, Sequence[SubjectStructure]],
) -> dict[str, Sequence[SubjectStructure]]:
    """Apply names of FreeSurfer's list also to files with too few labels to recognize it."""
    names = FREESURFER.names
    follow = any(
        item.name and item.name == names.get(item.value or 0) for ones in by_subject.values() for item in ones
    )
    result: dict[str, Sequence[SubjectStructure]] = {}
    for subject, ones in by_subject.items():
        values = {item.value for item in ones}
        nameless = bool(values) and values <= FREESURFER.common and not any(item.name for item in ones)
        if follow and nameless:
            result[subject] = [replace(item, name=names[item.value or 0]) for item in ones]
        else:
            result[subject] = ones
    return result


def joined(by_subject: Mapping[str, Sequence[SubjectStructure]]) -> tuple[Structure, ...]:
    """Return the structures of a cohort from those of its subjects, by the subjects' names."""
    kinds: dict[tuple[str, ...] | int, dict[str, SubjectStructure]] = {}
    names: dict[str, tuple[str, ...]] = {}
    for subject, ones in by_subject.items():
        for item in ones:
            key = names.setdefault(item.name, _key_of(item.name, kinds)) if item.name else item.value or 0
            kinds.setdefault(key, {}).setdefault(subject, item)
    structures = [_structure(there) for there in kinds.values()]
    return tuple(
        sorted(structures, key=lambda structure: (structure.values or (0,), structure.name.casefold()))
    )


def _key_of(name: str, kinds: Mapping[tuple[str, ...] | int, object]) -> tuple[str, ...]:
    same = (kind for kind in kinds if isinstance(kind, tuple) and same_name(kind[0], name))
    return next(same, (name,))


def _structure(by_subject: Mapping[str, SubjectStructure]) -> Structure:
    names = [item.name for item in by_subject.values()]
    values = sorted({item.value for item in by_subject.values() if item.value is not None})
    return Structure(max(names, key=names.count), tuple(values), by_subject)


def chosen_structures(
    structures: Sequence[Structure], wanted: Sequence[str], empty: Sequence[str] = ()
) -> list[Structure]:
    """Return the structures chosen by name or number; all of them for ``all``.

    Parameters
    ----------
    structures : sequence of Structure
        The available structures.
    wanted : sequence of str
        Names or numbers.
    empty : sequence of str
        Names of structures without a voxel, which are ignored if they are chosen.

    Raises
    ------
    InputError
        With a line for each unknown or ambiguous name, and similar names.
    """
    if [item.casefold() for item in wanted] == ["all"]:
        return list(structures)
    chosen, wrong = [], []
    for text in wanted:
        matches = matching(((structure.name, structure) for structure in structures), text)
        if not matches and text.isdecimal():
            matches = [structure for structure in structures if int(text) in structure.values]
        if len(matches) == 1:
            chosen.append(matches[0])
        elif not matches and matching(((name, name) for name in empty), text):
            continue
        elif matches:
            titles = " and ".join(structure.title for structure in matches)
            wrong.append(f"{text!r} matches {titles}; give the full name of one")
        else:
            alike = near([structure.name for structure in structures], text)
            nearest = (
                f"similar names: {', '.join(alike)}" if alike else "list the structures of the cohort first"
            )
            wrong.append(f"no subject has a structure {text!r}; {nearest}")
    if wrong:
        raise InputError("\n".join(wrong))
    return list(dict.fromkeys(chosen))
