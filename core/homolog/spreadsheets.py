"""Tables as spreadsheet programs save them: with commas, semicolons or tabs, in UTF-8 or UTF-16."""

import codecs
import csv
import io
import re
from collections import Counter
from pathlib import Path

from homolog.errors import InputError

__all__ = ["Row", "read_rows"]

Row = dict[str, str]

_LARGEST = 64 * 2**20
_SEPARATORS = ",;\t"
_SAID = re.compile(r'"?sep=(.)"?\r?\n', re.IGNORECASE)  # what Excel takes for the separator
_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_rows(path: Path) -> tuple[list[str], list[tuple[int, Row]]]:
    """Return a table's column names, and its rows with their lines; empty rows are left out.

    The separator is the one that the first line has most of. Values lose the blanks around them.

    Raises
    ------
    InputError
        If the file can't be read, two columns have one name, or a row has more values than there are columns.
    """
    text = _decoded(path)
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
    columns = lines[0][1] if lines else []
    twice = [name for name, count in Counter(columns).items() if name and count > 1]
    if twice:
        raise InputError(f"{path}: has several columns called {', '.join(twice)}; give each its own name")
    rows = []
    for number, values in lines[1:]:
        if any(values[len(columns) :]):
            raise InputError(
                f"{path}, line {number}: has more values than there are columns; put values that hold "
                f"{separator!r} into quotes"
            )
        if any(values):
            filled = [*values, *[""] * (len(columns) - len(values))]
            rows.append((number, {key: one for key, one in zip(columns, filled, strict=False) if key}))
    return columns, rows


def _decoded(path: Path) -> str:
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path}: is too large for a table; choose another file")
        content = path.read_bytes()
        return content.decode("utf-16" if content.startswith(_WIDE) else "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f'{path}: can\'t be read as a table; save it as CSV in UTF-8 (in Excel: "CSV UTF-8"; {error})'
        ) from error
