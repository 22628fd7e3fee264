"""Groups and covariates from a table, for known subjects."""

import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType

from homolog.cohort.column_types import CATEGORY, plain_name, read_typed_rows
from homolog.cohort.manifest import NAMES, own_columns, place_of
from homolog.cohort.numbers import is_code, notes_on_numbers
from homolog.cohort.sides import SIDE_COLUMN
from homolog.cohort.subject import Subject, checked_path, suffix_of
from homolog.errors import InputError, listed
from homolog.spreadsheets import MISSING, Row, encoding_notes

__all__ = ["Replaced", "TableChanges", "with_table", "with_values_of"]

_NOT_TAKEN = ("path", "landmarks")
_GROUP, _IMAGE, _PERSON = "group", "image", "subject"
_COLUMNS = 20
_SHOWN_CHARACTERS = 80


@dataclass(frozen=True, slots=True)
class Replaced:
    """A replaced value of a subject."""

    subject: str
    column: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class TableChanges:
    """Changes of known subjects by a table.

    Attributes
    ----------
    subjects : tuple of Subject
        All subjects in their order, with the table's values.
    matched, without_row : tuple of str
        Names of the subjects with a row in the table, and of the others.
    unknown : tuple of str
        Names of rows that match no subject, or several.
    key : str
        The column that identifies the subjects.
    added : dict of str to int
        Numbers of new values by column.
    replaced : tuple of Replaced
        Values that differ from existing ones.
    notes : tuple of str
        Notes on the file for the user.
    """

    subjects: tuple[Subject, ...]
    matched: tuple[str, ...]
    without_row: tuple[str, ...]
    unknown: tuple[str, ...]
    key: str
    added: Mapping[str, int]
    replaced: tuple[Replaced, ...]
    notes: tuple[str, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether the table changes no value."""
        return not self.added and not self.replaced

    @property
    def lines(self) -> list[str]:
        """Descriptions of the changes, one line each."""
        lines = self.coverage[:1]
        for number in dict.fromkeys(self.added.values()):
            names = [name for name, count in self.added.items() if count == number]
            each = " each" if len(names) > 1 else ""
            lines.append(f"{listed(names, _COLUMNS)}: {_count(number, 'new value')}{each}")
        for name in dict.fromkeys(item.column for item in self.replaced):
            changed = [item for item in self.replaced if item.column == name]
            shown = [f"{item.subject} {item.before} to {item.after}" for item in changed]
            lines.append(f"{name}: {_count(len(changed), 'value')} replaced ({listed(shown)})")
        columns = {*self.added, *(item.column for item in self.replaced)}
        if any(plain_name(name).casefold() == SIDE_COLUMN for name in columns):
            lines.append("side: only the next run mirrors shapes by it; existing particles do not change")
        if self.is_empty:
            lines.append("nothing changes: the project already has all values")
        return [*lines, *self.coverage[1:], *self.notes, *notes_on_numbers(self.subjects)]

    @property
    def coverage(self) -> list[str]:
        """How many subjects have a row, which have none, and which rows name none, one line each."""
        lines = [f"{len(self.matched)} of {len(self.subjects)} subjects have a row (column {self.key})"]
        lines += [f"without a row: {listed(self.without_row)}"] if self.without_row else []
        return [*lines, *([f"rows that name no subject: {listed(self.unknown)}"] if self.unknown else [])]


def with_table(subjects: Sequence[Subject], path: Path, missing: Sequence[str] = ()) -> TableChanges:
    """Read groups and covariates of known subjects from a table.

    The column that matches most subjects identifies them: by name, by file name with or without suffix, or by
    a prefix that ends before a character other than a letter or digit (``acdc004`` matches
    ``acdc004_ED_myo``). A prefix of several names matches all of them if they are one person's, with the same
    value in their column ``subject``, and have no rows of their own. If no row matches, whole numbers in the
    column name, id, subject or participant_id match those in the names, if both have the same (``1`` matches
    ``sub-001``). Columns for paths and landmarks are ignored; paths of scans (column image) are relative to
    the table's folder. An empty cell keeps the current value. A row of types below the header declares
    categories and numbers (`read_typed_rows`).

    Parameters
    ----------
    subjects : sequence of Subject
    path : Path
        CSV with commas, semicolons or tabs, or XLSX.
    missing : sequence of str
        Values that stand for missing ones; such cells, and those of the subjects, become empty.

    Returns
    -------
    TableChanges

    Raises
    ------
    InputError
        If the file can't be read, matches no subject, or has two rows for one subject.
    """
    columns, lines = read_typed_rows(path, (*NAMES, *_NOT_TAKEN, _GROUP, _IMAGE))
    own = own_columns(columns)
    groups = [column for column in own if own[column] == _GROUP]
    named = [column for column in columns if column]
    if not lines or not named:
        raise InputError(f"{path}: contains no rows; choose another table")
    rows = [row for _, row in lines]
    known = _Known(subjects)
    candidates = {column: [known.named(row[column]) for row in rows] for column in named}
    key = max(named, key=lambda item: sum(map(bool, candidates[item])))
    named_by = candidates[key]
    notes: tuple[str, ...] = ()
    if not any(named_by):
        matches = [item for item in named if item.casefold() in NAMES]
        key, named_by, notes = _by_numbers(subjects, matches, rows, path)
        candidates[key] = named_by
    single = {names[0] for names in named_by if len(names) == 1}
    named_by = [
        names if len(names) == 1 else tuple(name for name in names if name not in single)
        for names in named_by
    ]
    twice = [name for name, count in Counter(chain.from_iterable(named_by)).items() if count > 1]
    if twice:
        raise InputError(f"{path}: has several rows of {listed(twice)}; keep one of each")
    values = {
        name: {
            _GROUP if column in groups else column: (
                _scan(path, value) if column.casefold() == _IMAGE and value else value
            )
            for column, value in row.items()
            if column != key
        }
        for names, row in zip(named_by, rows, strict=True)
        for name in names
    }
    unknown = [row[key] for names, row in zip(candidates[key], rows, strict=True) if not names]
    changes = _changes(subjects, values, unknown, key, missing)
    return replace(changes, notes=(*notes, *encoding_notes(path)))


def _by_numbers(
    subjects: Sequence[Subject], keys: Sequence[str], rows: Sequence[Row], path: Path
) -> tuple[str, list[tuple[str, ...]], tuple[str, ...]]:
    """Return the column whose numbers are those in the subjects' names, their names by row, and a note.

    Spreadsheets drop leading zeros: ``1`` means ``sub-001`` if the rows have the same numbers as the names.
    """
    numbers = [re.findall(r"\d+", subject.name) for subject in subjects]
    names = {
        int(digits[0]): subject.name for subject, digits in zip(subjects, numbers, strict=True) if digits
    }
    is_sure = len(names) == len(subjects) and all(len(digits) == 1 for digits in numbers)
    for key in keys if is_sure else ():
        ids = [int(row[key]) if row[key].isdecimal() else -1 for row in rows]
        if len(set(ids)) == len(ids) and set(ids) == names.keys():
            note = f"rows of {path.name} were matched by number: {rows[0][key]} is {names[ids[0]]}"
            return key, [(names[number],) for number in ids], (note,)
    raise InputError(
        f"{path}: names none of the subjects, such as {subjects[0].name}; enter their names in a column "
        "name, or their files in a column path"
    )


def with_values_of(
    subjects: Sequence[Subject], others: Sequence[Subject], missing: Sequence[str] = ()
) -> TableChanges:
    """Return the changes of subjects to the groups and columns of others with the same names."""
    values = {other.name: _values(other) for other in others}
    return _changes(subjects, values, [], "name", missing)


def _changes(
    subjects: Sequence[Subject],
    values: Mapping[str, Row],
    unknown: Sequence[str],
    key: str,
    missing: Sequence[str] = (),
) -> TableChanges:
    known = {name.casefold(): name for subject in subjects for name in subject.columns}
    declared = {
        known[plain_name(title).casefold()]: title
        for title in {title for row in values.values() for title in row}
        if title.endswith(CATEGORY) and plain_name(title).casefold() in known
    }
    known |= {title.casefold(): title for title in declared.values()}
    known |= {plain_name(name).casefold(): name for name in known.values() if name.endswith(CATEGORY)}
    added: Counter[str] = Counter()
    replaced: list[Replaced] = []
    result = []
    for item in subjects:
        before = {declared.get(name, name): value for name, value in _values(item).items()}
        after = dict(before)
        added.update(title for title in declared.values() if before.get(title))
        for title, value in values.get(item.name, {}).items():
            column = known.get(title.casefold(), title)
            if title.casefold() in (_GROUP, _IMAGE):
                column = title.casefold()
            if title.casefold() in _NOT_TAKEN:
                continue
            was = before.get(column, "")
            if not value:
                after.setdefault(column, "")
            elif column == _GROUP and value.casefold() in MISSING:
                after[column] = was
            elif is_code(value, missing):
                after.setdefault(column, "")
            elif value != was:
                after[column] = value
                if was:
                    replaced.append(Replaced(item.name, column, was, value))
                else:
                    added[column] += 1
        for column in [name for name, value in after.items() if is_code(value, missing)]:
            replaced.append(Replaced(item.name, column, after[column], "missing"))
            after[column] = ""
        group, image = after.pop(_GROUP), after.pop(_IMAGE)
        result.append(
            replace(
                item,
                group=group or None,
                columns=MappingProxyType(after),
                image=Path(image) if image else None,
            )
        )
    return TableChanges(
        subjects=tuple(result),
        matched=tuple(subject.name for subject in subjects if subject.name in values),
        without_row=tuple(subject.name for subject in subjects if subject.name not in values),
        unknown=tuple(unknown),
        key=key,
        added=MappingProxyType(dict(added)),
        replaced=tuple(replaced),
    )


def _values(subject: Subject) -> dict[str, str]:
    image = "" if subject.image is None else str(subject.image)
    return {_GROUP: subject.group or "", _IMAGE: image, **subject.columns}


def _scan(table: Path, text: str) -> str:
    """Return the full path of a scan in a table."""
    try:
        return str(place_of(table.parent.resolve(), checked_path(text)))
    except ValueError as error:
        raise InputError(f"{table}: the image {text[:_SHOWN_CHARACTERS]} {error}; correct it") from error


class _Known:
    """The subjects by what a row may call them: name, file, or beginning of the name."""

    def __init__(self, subjects: Sequence[Subject]) -> None:
        called: dict[str, list[Subject]] = {}
        files: dict[str, list[Subject]] = {}
        begun: dict[str, list[Subject]] = {}
        for subject in subjects:
            name = _folded(subject.name)
            called.setdefault(name, []).append(subject)
            for text in {_folded(subject.path.name), _folded(_stem(subject.path.name))}:
                files.setdefault(text, []).append(subject)
            for end in (index for index, letter in enumerate(name) if index and not letter.isalnum()):
                begun.setdefault(name[:end], []).append(subject)
        self._kinds = called, files, begun

    def named(self, text: str) -> tuple[str, ...]:
        """Return the subjects that a row identifies: one, or several of one person."""
        file = text.replace("\\", "/").rpartition("/")[2]
        names = {_folded(text), _folded(file), _folded(_stem(file))} - {""}
        for kind in self._kinds:
            known = {item.name: item for name in names for item in kind.get(name, ())}
            if known:
                persons = {item.columns.get(_PERSON) for item in known.values()}
                return tuple(known) if len(known) == 1 or (len(persons) == 1 and None not in persons) else ()
        return ()


def _folded(text: str) -> str:
    """Return a text for comparison; names from macOS have letters and accents apart."""
    return unicodedata.normalize("NFC", text).casefold()


def _stem(file: str) -> str:
    return file[: len(file) - len(suffix_of(Path(file)))] if file else ""


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
