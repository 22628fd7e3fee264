"""Patterns of file names, such as ``{group}/{subject}_seg.nii.gz``: read by one, or find those that fit."""

import os
import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from homolog.cohort.dicom import scan_beside
from homolog.cohort.files import all_below, shapes_below
from homolog.cohort.subject import Cohort, Subject, image_beside, landmarks_beside, stem_of
from homolog.errors import InputError

__all__ = ["Proposal", "assembled", "counts_text", "proposals", "proposals_text", "read_pattern", "single"]

_FIELD = re.compile(r"\{([^{}]*)\}|(\*)")
_SEPARATOR = re.compile(r"([-_. ]+)")
_SUBJECT, _STRUCTURE, _GROUP, _SCAN = "subject", "structure", "group", "scan"
_RESERVED = ("name", "path", "landmarks", "image")
"""Columns of a table that no field can have."""
_MOST_VALUES = 6
"""Largest number of values of a part of names of which each gets its own pattern."""
_MOST_LINES = 8
"""Largest number of proposed patterns: one screen with their message."""

Fields = Mapping[str, str]


def single(name: str, path: Path) -> Subject:
    """Return a subject with one file, and the landmarks and scan next to it."""
    image = image_beside(path) or scan_beside(path)
    return Subject(name, path, landmarks=landmarks_beside(path), image=image)


def assembled(folder: Path, matched: Iterable[tuple[Fields, Path]], notes: Sequence[str] = ()) -> Cohort:
    """Return the cohort of files with their fields.

    Files that differ in ``structure`` only belong to one subject. Those of a person that differ in other
    fields are subjects of their own, named after the person and these fields, with the person in the column
    ``subject``.

    Raises
    ------
    InputError
        If two files have the same fields.
    """
    owners: dict[tuple[tuple[str, str], ...], dict[str, Path]] = defaultdict(dict)
    values: dict[tuple[str, str], set[str]] = defaultdict(set)
    for fields, path in matched:
        own = {name: value for name, value in fields.items() if name != _STRUCTURE}
        files, structure = owners[tuple(own.items())], fields.get(_STRUCTURE, "")
        if structure in files:
            shown = [item.relative_to(folder).as_posix() for item in (files[structure], path)]
            raise InputError(
                f"{folder}: {' and '.join(shown)} are both of {' '.join(fields.values())}; add a field to "
                "the pattern for what tells them apart, or write it out"
            )
        files[structure] = path
        for name, value in own.items():
            values[own[_SUBJECT], name].add(value)
    subjects = []
    has_scans = any(len(each) > 1 for each in values.values())
    for key, files in owners.items():
        own = dict(key)
        person = own.pop(_SUBJECT)
        varying = [value for name, value in own.items() if len(values[person, name]) > 1]
        name, group = "_".join([person, *varying]), own.pop(_GROUP, None)
        columns = MappingProxyType(({_SUBJECT: person} if has_scans else {}) | own)
        subject = single(name, files[""]) if "" in files else _of_structures(name, files)
        subjects.append(replace(subject, group=group, columns=columns))
    return Cohort(tuple(sorted(subjects, key=lambda item: item.name)), folder, tuple(notes))


def _of_structures(name: str, files: Mapping[str, Path]) -> Subject:
    folder = Path(os.path.commonpath([file.parent for file in files.values()]))
    return Subject(name, folder, structures=MappingProxyType(dict(sorted(files.items()))))


def read_pattern(folder: Path, pattern: str, shapes: Sequence[Path] | None = None) -> Cohort:
    r"""Return the cohort of the files in a folder that fit a pattern.

    Parameters
    ----------
    folder : Path
    pattern : str
        Path below the folder with fields in braces. A field is any text without a slash, as short as the
        pattern allows, and the same text wherever it is repeated; ``*`` is any text that does not matter.
        ``{subject}`` is required, ``{structure}`` tells the files of a subject apart, ``{group}`` is its
        group; every other field becomes a column. A path without suffix is a folder of slices.
    shapes : sequence of Path, optional
        The folder's shapes, if they are known.

    Raises
    ------
    InputError
        If the pattern is invalid, fits no file, or gives two files the same fields.
    """
    cohort = _fitting(folder, pattern, shapes)
    if not cohort.subjects:
        raise InputError(f"{folder}: no file fits the pattern {pattern}{proposals_text(folder)}")
    return cohort


def _fitting(folder: Path, pattern: str, shapes: Sequence[Path] | None) -> Cohort:
    pattern = pattern.replace("\\", "/").removeprefix("./")
    expression = _expression(pattern)
    known = all_below(folder, pattern.count("/")) if shapes is None else shapes
    names = [unicodedata.normalize("NFC", path.relative_to(folder).as_posix()) for path in known]
    matches = [(expression.fullmatch(name), path) for name, path in zip(names, known, strict=True)]
    return assembled(folder, [(match.groupdict(), path) for match, path in matches if match])


def _expression(pattern: str) -> re.Pattern[str]:
    parts, names, at = "", set[str](), 0
    for field in _FIELD.finditer(pattern):
        parts += re.escape(unicodedata.normalize("NFC", pattern[at : field.start()]))
        at, name = field.end(), field[1]
        if field[2]:
            parts += "[^/]*"
        elif not name.isidentifier() or name in _RESERVED:
            raise InputError(
                f"{pattern}: {{{name}}} can't be a field; name it by a word other than {', '.join(_RESERVED)}"
            )
        else:
            parts += f"(?P={name})" if name in names else f"(?P<{name}>[^/]+?)"
            names.add(name)
    rest = pattern[at:]
    if _SUBJECT not in names or set("{}") & set(_FIELD.sub("", pattern)):
        raise InputError(
            f"{pattern}: is not a pattern of files; write {{subject}} where the subject's name is: "
            "{group}/{subject}_seg.nii.gz"
        )
    return re.compile(parts + re.escape(unicodedata.normalize("NFC", rest)))


@dataclass(frozen=True, slots=True)
class Proposal:
    """A pattern that fits files of a folder, and the cohort that it gives."""

    pattern: str
    cohort: Cohort

    @property
    def text(self) -> str:
        """The numbers of its subjects, structures and groups."""
        return counts_text(self.cohort)


def counts_text(cohort: Cohort) -> str:
    """Return the numbers of a cohort's subjects, structures and groups."""
    subjects = cohort.subjects
    structures = {name for subject in subjects for name in subject.structures}
    groups = {subject.group for subject in subjects if subject.group}
    counts = [f"{len(subjects)} subject{'' if len(subjects) == 1 else 's'}"]
    counts += [f"{len(structures)} structures"] if structures else []
    counts += [f"{len(groups)} groups"] if groups else []
    return ", ".join(counts)


def proposals_text(folder: Path, shapes: Sequence[Path] | None = None) -> str:
    """Return the end of a message: the patterns that fit, a line each; empty if none does."""
    fitting = proposals(folder, shapes)
    if not fitting:
        return ""
    quoted = [f'"{proposal.pattern}"' for proposal in fitting]
    width = max(map(len, quoted))
    lines = [f"\n  {text:<{width}}  {proposal.text}" for text, proposal in zip(quoted, fitting, strict=True)]
    return "; these patterns fit (rename fields as you like; each becomes a column):" + "".join(lines)


def proposals(folder: Path, shapes: Sequence[Path] | None = None) -> list[Proposal]:
    """Return the patterns that fit files of a folder, found from the common parts of their names.

    Parts of names that all files share are written out. Of the others, the one with the most values is the
    subject; a part with one value for each subject is its group, or belongs to its name; a part with several
    is written out, or tells structures or scans apart.
    """
    known = shapes_below(folder) if shapes is None else shapes
    fitting: dict[str, Proposal] = {}
    for names in _alike([path.relative_to(folder).as_posix() for path in known]):
        for pattern in names:
            if pattern in fitting or len(fitting) >= _MOST_LINES:
                continue
            with suppress(InputError):
                if (cohort := _fitting(folder, pattern, known)).subjects:
                    fitting[pattern] = Proposal(pattern, cohort)
    same: dict[object, Proposal] = {}
    for proposal in fitting.values():
        same.setdefault(frozenset(_files_of(proposal.cohort)), proposal)
    return list(same.values())


def _files_of(cohort: Cohort) -> Iterator[frozenset[Path]]:
    """Return the files of each subject."""
    for subject in cohort.subjects:
        yield frozenset(subject.structures.values() or [subject.path])


Parts = tuple[str, ...]
"""A path in parts: folders, then words and separators of the file's name, then its suffix."""


def _alike(paths: Sequence[str]) -> Iterator[list[str]]:
    """Return the patterns of each set of files whose paths have the same structure, the largest set first."""
    fine: dict[Parts, list[Parts]] = defaultdict(list)
    coarse: dict[Parts, list[Parts]] = defaultdict(list)
    for path in paths:
        *folders, file = path.split("/")
        stem = stem_of(Path(file))
        suffix = file[len(stem) :]
        ahead = [part for folder in folders for part in (folder, "/")]
        pieces = _SEPARATOR.split(_referring(stem, folders))
        depth = str(len(folders))
        fine[depth, suffix, *pieces[1::2]].append((*ahead, *pieces, suffix))
        coarse[depth, suffix].append((*ahead, _referring(stem, folders), suffix))
    for rows in sorted((*fine.values(), *coarse.values()), key=len, reverse=True):
        if len(rows) > 1:
            yield _patterns(rows)


def _referring(stem: str, folders: Sequence[str]) -> str:
    """Return a file's name with the names of its folders replaced by references to them."""
    for index, folder in enumerate(folders):
        stem = re.sub(rf"(?<![^\W_]){re.escape(folder)}(?![^\W_])", f"\0{index}\0", stem)
    return stem


def _patterns(rows: Sequence[Parts]) -> list[str]:
    columns = list(zip(*rows, strict=True))
    counts = [len(set(column)) for column in columns]
    varying = [index for index, count in enumerate(counts) if count > 1]
    if not varying:
        return []
    subject = max(varying, key=lambda index: (counts[index], -index))
    own = {subject}
    repeated = []
    for index in varying:
        pairs = set(zip(columns[subject], columns[index], strict=True))
        if len(pairs) == counts[subject]:
            own |= {index}  # one value for each subject
        elif 2 * len(pairs) > counts[subject] * counts[index]:
            repeated.append(index)  # most subjects have most values
        else:
            own |= {index}
    stem_at = max((index + 1 for index, part in enumerate(rows[0]) if part == "/"), default=0)
    plain = {index: rows[0][index] for index in range(len(columns)) if counts[index] == 1}
    names = plain | _own_fields(own, subject, counts, stem_at)
    kinds: list[dict[int, str]] = [{}]
    if repeated:
        scans = {index: f"{{{_SCAN}{number or ''}}}" for number, index in enumerate(repeated)}
        last = repeated[-1]
        structures = scans | {last: f"{{{_STRUCTURE}}}"}
        kinds = [structures, scans]
        if len(repeated) == 1:
            kinds = [{last: value} for value in sorted(set(columns[last]))[:_MOST_VALUES]] + kinds
            kinds.append({last: f"{{{_SUBJECT}}}", subject: f"{{{_STRUCTURE}}}"})
    same = {index for index, part in plain.items() if "\0" not in part}
    return [_joined(names | kind, own, same, stem_at, len(columns)) for kind in kinds]


def _own_fields(own: set[int], subject: int, counts: Sequence[int], stem_at: int) -> dict[int, str]:
    """Return the texts of the subject's own parts: its name, its groups, and what adds nothing."""
    groups = [index for index in sorted(own) if index < stem_at and index != subject]
    telling = [index for index in groups if counts[index] < counts[subject]]
    names = dict.fromkeys(groups, "*")
    names |= {index: f"{{{_GROUP}{number or ''}}}" for number, index in enumerate(telling)}
    if subject < stem_at:
        names |= {index: "*" for index in own if index >= stem_at}
    else:
        names |= {index: f"{{{_SUBJECT}}}" for index in own if index >= stem_at}
    return names | {subject: f"{{{_SUBJECT}}}"}


def _joined(names: Mapping[int, str], own: set[int], same: set[int], stem_at: int, count: int) -> str:
    """Return a pattern; the parts of a subject's name in the file's name become one field."""
    inside = [index for index in own if index >= stem_at and names[index] == f"{{{_SUBJECT}}}"]
    skipped = range(0)
    if inside:
        first, last = min(inside), max(inside)
        start = stem_at if same.issuperset(range(stem_at, first)) else first
        if (own | same).issuperset(range(first, last)):
            skipped = range(start, last)
    text = "".join(names[index] for index in range(count) if index not in skipped)
    folders = text.split("/")[:-1]
    text = re.sub(r"\0(\d+)\0", lambda match: folders[int(match[1])], text)
    return re.sub(r"(\*[-_. ]*)+\*", "*", text)
