"""Tables of spreadsheet programs: text with commas, semicolons or tabs, or XLSX."""

import codecs
import csv
import io
import re
import zipfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from datetime import datetime, time
from itertools import islice
from pathlib import Path

from homolog.errors import InputError

__all__ = ["MISSING", "TABLE_SUFFIXES", "Row", "encoding_notes", "lists_labels", "read_rows", "read_sheets"]

Row = dict[str, str]

MISSING = ("", ".", "na", "n/a", "nan", "none", "null")
"""Texts of cells without a value, case-insensitive."""
TABLE_SUFFIXES = (".csv", ".tsv", ".xlsx")
"""Suffixes of tables."""

_LARGEST = 64 * 2**20
LARGEST_UNPACKED = 256 * 2**20
_MOST_ROWS, _MOST_COLUMNS = 100_000, 1000
_SEPARATORS = ",;\t"
_SAID = re.compile(r'"?sep=(.)"?\r?\n', re.IGNORECASE)  # Excel's declaration of the separator
_NO_TEXT = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
_WESTERN = "cp1252"
_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


_LABELS = re.compile(
    r'\W*(index|label ?value|label|value|wert)"?\s*[\t,;]\s*"?(name|label_?name|structure|struktur)\b'
)
_HEAD = 4096


def lists_labels(path: Path) -> bool:
    """Return whether a table of text begins with columns of a label map's values and their names.

    BIDS and 3D Slicer write such tables.
    """
    with path.open("rb") as stream:
        return bool(_LABELS.match(stream.readline(_HEAD).decode("utf-8", "replace").casefold()))


def read_rows(path: Path) -> tuple[list[str], list[tuple[int, Row]]]:
    """Return a table's column names, and its rows with their lines; empty rows are omitted.

    The separator is the one that occurs most often in the first line. Blanks around values are removed. Of an
    XLSX file the first sheet is read, with numbers and dates as texts.

    Raises
    ------
    InputError
        If the file can't be read, two columns have the same name, or a row has more values than columns.
    """
    lines, separator = _sheet_lines(path) if path.suffix.lower() == ".xlsx" else _text_lines(path)
    columns = lines[0][1] if lines else []
    twice = [name for name, count in Counter(columns).items() if name and count > 1]
    if twice:
        raise InputError(f"{path}: has several columns named {', '.join(twice)}; give each its own name")
    rows = []
    for number, values in lines[1:]:
        if any(values[len(columns) :]):
            raise InputError(
                f"{path}, line {number}: has more values than there are columns; put values that contain "
                f"{separator!r} into quotes"
            )
        if any(values):
            filled = [*values, *[""] * (len(columns) - len(values))]
            rows.append((number, {key: item for key, item in zip(columns, filled, strict=False) if key}))
    return columns, rows


def encoding_notes(path: Path) -> tuple[str, ...]:
    """Return a note if letters of a table may be read incorrectly by `read_rows`."""
    if path.suffix.lower() == ".xlsx" or _decoded(path)[1] != _WESTERN:
        return ()
    return (
        f"{path.name} is not in UTF-8: it was read as Windows-1252, as western versions of Excel write it",
    )


def _text_lines(path: Path) -> tuple[list[tuple[int, list[str]]], str]:
    """Return the numbered lines of a text file as values, and the separator."""
    text, _ = _decoded(path)
    skipped = 0
    if said := _SAID.match(text):
        text, skipped = text[said.end() :], 1
    head = text.partition("\n")[0]
    separator = said[1] if said else max(_SEPARATORS, key=head.count)
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True
    )
    try:
        lines = [(reader.line_num + skipped, [value.strip() for value in line]) for line in reader]
    except csv.Error as error:
        raise InputError(
            f"{path}, line {reader.line_num + skipped}: {error}; save the table again"
        ) from error
    return lines, separator


def _sheet_lines(path: Path) -> tuple[list[tuple[int, list[str]]], str]:
    """Return the numbered lines of a workbook's first sheet as values."""
    (sheet,) = read_sheets(path, "table", _cell, most=1).values()
    lines: list[tuple[int, list[str]]] = []
    for number, values in enumerate(sheet, start=1):
        while values and not values[-1]:
            values.pop()
        if values or lines:
            lines.append((number, values))
    return lines, ","


def read_sheets(
    path: Path, kind: str, text: Callable[[object], str], most: int | None = None
) -> dict[str, list[list[str]]]:
    """Return the lines of a workbook's sheets, by title.

    Parameters
    ----------
    path : Path
    kind : str
        Expected kind of file, for messages, such as ``"ShapeWorks project"``.
    text : callable
        Returns a cell's value as text.
    most : int, optional
        Largest number of sheets that are read, by default all.

    Raises
    ------
    InputError
        If it can't be read, or is implausibly large.
    """
    import openpyxl

    if not path.is_file():
        raise InputError(f"{path}: does not exist; correct the path")
    sheets = {}
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(item.file_size for item in archive.infolist()) > LARGEST_UNPACKED:
                raise InputError(f"{path}: is too large for a {kind}; choose another file")
        with closing(openpyxl.load_workbook(path, read_only=True, data_only=True)) as book:
            for sheet in book.worksheets[:most]:
                sheet.reset_dimensions()  # the declared size of a sheet would be filled with blanks
                rows = islice(sheet.iter_rows(values_only=True), _MOST_ROWS + 1)
                lines = [[text(item) for item in row[:_MOST_COLUMNS]] for row in rows]
                if len(lines) > _MOST_ROWS:
                    raise InputError(f"{path}: has more than {_MOST_ROWS} rows; choose another file")
                sheets[sheet.title] = lines
    except InputError:
        raise
    except Exception as error:  # zip, XML and openpyxl raise many kinds of errors
        raise InputError(f"{path}: can't be read as a {kind}: {error}; save it again") from error
    return sheets


def _cell(value: object) -> str:
    """Return a cell's value as text, as a spreadsheet program would save it as CSV."""
    if value is None:
        return ""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if isinstance(value, datetime) and value.time() == time():
        return value.date().isoformat()
    return str(value).strip()


def _decoded(path: Path) -> tuple[str, str]:
    """Return a file's text and its encoding."""
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path}: is too large for a table; choose another file")
        content = path.read_bytes()
        encoding = "utf-16" if content.startswith(_WIDE) else "utf-8-sig"
        try:
            return content.decode(encoding), encoding
        except UnicodeDecodeError:
            text = content.decode(_WESTERN)
            if _NO_TEXT.search(text):
                raise
            return text, _WESTERN
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f'{path}: can\'t be read as a table; save it as CSV in UTF-8 (in Excel: "CSV UTF-8"; {error})'
        ) from error
