"""Types of a table's columns, declared in a row below the header."""

from collections.abc import Sequence
from contextlib import suppress
from math import isfinite
from pathlib import Path

from homolog.errors import InputError
from homolog.spreadsheets import MISSING, Row, read_rows

__all__ = ["CATEGORY", "number_of", "plain_name", "read_typed_rows"]

CATEGORY = ":c"
"""Suffix of a column's name that makes its values categories, even numbers."""
_TYPE_ROW = ("type", "types")
_CATEGORIES = ("category", "categories", "categorical", "c")
_NUMBERS = ("number", "numbers", "numeric", "n")
_SHOWN = 60


def plain_name(column: str) -> str:
    """Return a column's name without its type."""
    return column.removesuffix(CATEGORY)


def read_typed_rows(path: Path, own: Sequence[str] = ()) -> tuple[list[str], list[tuple[int, Row]]]:
    """Return a table's columns and rows as `read_rows`, with the types of a row below the header.

    That row begins with ``type``; its other cells are ``category``, ``number`` or empty. Columns of
    categories get names that end in ``:c``, except those in `own`.

    Raises
    ------
    InputError
        If the file can't be read, a cell is not a type, or a column of numbers contains other values.
    """
    columns, rows = read_rows(path)
    if not rows or rows[0][1].get(columns[0], "").casefold() not in _TYPE_ROW:
        return columns, rows
    line, declared = rows[0]
    types = {name: declared[name].casefold() for name in columns[1:] if name and declared[name]}
    if not any(word in (*_CATEGORIES, *_NUMBERS) for word in types.values()):
        return columns, rows  # a subject named type
    for name, word in types.items():
        if word not in (*_CATEGORIES, *_NUMBERS):
            raise InputError(
                f"{path}, line {line}: {word[:_SHOWN]!r} is not a type of {name}; write category or number"
            )
    for number, row in rows[1:]:
        for name, word in types.items():
            if word in _NUMBERS and row[name].casefold() not in MISSING and number_of(row[name]) is None:
                raise InputError(
                    f"{path}, line {number}: {row[name][:_SHOWN]!r} in the column {name} is not a number; "
                    f"correct or empty the cell, or declare {name} a category"
                )
    titles = {
        name: f"{name}{CATEGORY}"
        for name, word in types.items()
        if word in _CATEGORIES and name.casefold() not in own and not name.endswith(CATEGORY)
    }
    named = [titles.get(name, name) for name in columns]
    typed = [(number, {titles.get(key, key): item for key, item in row.items()}) for number, row in rows[1:]]
    return named, typed


def number_of(text: str) -> float | None:
    """Return the number of a cell, also with a decimal comma; None if it is none."""
    with suppress(ValueError):
        number = float(text.replace(",", "."))
        return number if isfinite(number) else None
    return None
