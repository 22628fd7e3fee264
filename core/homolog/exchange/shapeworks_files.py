"""ShapeWorks project files, ``.swproj`` (JSON) and ``.xlsx``: rows of texts, and other tables.

The layout is that of ShapeWorks 6.4 to 6.7 (``Libs/Project`` of its sources): every value is a text, a row is
a subject, and columns of files and transforms end in the name of their domain (anatomy).
"""

import zipfile
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog.io.bounded import read_json

__all__ = ["INPUTS", "PATH_PREFIXES", "PREFIXES", "Row", "ShapeWorksProject", "read_shapeworks_file"]

Row = dict[str, str]

INPUTS = ("segmentation_", "shape_", "mesh_", "contour_")
"""Prefixes of columns with the path of an input."""
PATH_PREFIXES = (
    *INPUTS,
    "groomed_",
    "local_particles_",
    "world_particles_",
    "landmarks_file_",
    "constraints_",
    "image_",
    "feature_",
)
"""Prefixes of columns with paths relative to the project's folder."""
PREFIXES = (*PATH_PREFIXES, "alignment_", "procrustes_", "group_")
"""Prefixes of all columns that ShapeWorks interprets; other columns are table data."""

LARGEST_UNPACKED = 256 * 2**20
_MOST_ROWS = 100_000


@dataclass(frozen=True, slots=True)
class ShapeWorksProject:
    """The content of a project file.

    Attributes
    ----------
    path : Path
        The file.
    rows : tuple of Row
        Columns of each subject.
    others : dict
        Other content by key, such as ``groom``, ``optimize`` and ``landmarks``.
    """

    path: Path
    rows: tuple[Row, ...]
    others: dict[str, Any]

    @property
    def domains(self) -> list[str]:
        """Names of the anatomies, in the order of their columns; without files only ``"1"``."""
        keys = list(dict.fromkeys(key for row in self.rows for key in row))
        for prefixes in (INPUTS, ("groomed_",), ("world_particles_", "local_particles_")):
            names = [
                key.removeprefix(prefix) for key in keys for prefix in prefixes if key.startswith(prefix)
            ]
            if names:
                return list(dict.fromkeys(names))
        return ["1"]

    def table(self, key: str) -> Row:
        """Return one of the other tables, such as ``optimize``; empty if it is missing or not a table."""
        nested = self.others.get(key)
        return self.texts(nested) if isinstance(nested, dict) else {}

    @staticmethod
    def texts(table: dict[Any, Any]) -> Row:
        """Return a table with every value as the text that ShapeWorks would write."""
        return {str(name): _text(value) for name, value in table.items()}

    def inputs(self, row: Row, domain: str) -> list[str]:
        """Return the paths of a subject's groomed and original shapes, if given."""
        values = [row.get(f"{prefix}{domain}", "") for prefix in ("groomed_", *INPUTS)]
        return [value for value in values if value]


def read_shapeworks_file(path: Path) -> ShapeWorksProject:
    """Read a project file.

    Parameters
    ----------
    path : Path
        File that ends in .swproj or .xlsx.

    Returns
    -------
    ShapeWorksProject

    Raises
    ------
    InputError
        If it can't be read, is implausibly large, or lists no subject.
    """
    path = Path(path)
    rows, others = _from_xlsx(path) if path.suffix.lower() == ".xlsx" else _from_json(path)
    if not rows:
        raise InputError(f"{path}: lists no subject; choose another project")
    return ShapeWorksProject(path, tuple(rows), others)


def _from_json(path: Path) -> tuple[list[Row], dict[str, Any]]:
    content = read_json(path, "ShapeWorks project")
    data = content.pop("data", None)
    if not isinstance(data, list) or not all(isinstance(row, dict) for row in data):
        raise InputError(
            f"{path}: is not a ShapeWorks project (it has no list named data); choose another file"
        )
    return [{str(key): _text(value) for key, value in row.items()} for row in data], content


def _from_xlsx(path: Path) -> tuple[list[Row], dict[str, Any]]:
    import openpyxl

    if not path.is_file():
        raise InputError(f"{path}: does not exist; correct the path")
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(item.file_size for item in archive.infolist()) > LARGEST_UNPACKED:
                raise InputError(
                    f"{path}: is implausibly large for a ShapeWorks project; choose another file"
                )
        sheets = {}
        with closing(openpyxl.load_workbook(path, read_only=True, data_only=True)) as book:
            for sheet in book.worksheets:
                sheet.reset_dimensions()  # the declared size of a sheet would be filled with blanks
                sheets[sheet.title] = _table(path, sheet.iter_rows(values_only=True))
    except InputError:
        raise
    except Exception as error:  # zip, XML and openpyxl raise many kinds of errors
        raise InputError(f"{path}: can't be read as a ShapeWorks project: {error}; save it again") from error
    first = next(iter(sheets), "")
    rows = sheets.pop("data" if "data" in sheets else first, [])
    others: dict[str, Any] = {}
    for title, table in sheets.items():
        if title == "landmarks":
            others[title] = table
        elif title == "groom":
            others[title] = _by_domain(table)
        else:
            pairs = (list(row.values())[:2] for row in table)  # for any headings, as in ShapeWorks
            others[title] = {pair[0]: pair[-1] for pair in pairs if len(pair) == 2 and pair[0]}
    return rows, others


def _table(path: Path, lines: Any) -> list[Row]:  # noqa: ANN401 - openpyxl has no types
    """Return a sheet's rows by the names in its first row, without blank rows."""
    heads: list[str] = []
    rows: list[Row] = []
    for number, line in enumerate(lines):
        if number > _MOST_ROWS:
            raise InputError(f"{path}: has more than {_MOST_ROWS} rows; choose another file")
        texts = [_text(value) for value in line]
        if not heads:
            heads = texts
        elif any(texts):
            rows.append({head: text for head, text in zip(heads, texts, strict=False) if head})
    return rows


def _by_domain(table: Sequence[Row]) -> dict[str, Row]:
    """Turn a sheet ``key | value_<domain> …`` into one table for each domain."""
    key, *heads = table[0] if table else ("",)
    return {
        head.removeprefix("value").removeprefix("_"): {
            row[key]: row[head] for row in table if row.get(key) and row.get(head)
        }
        for head in heads
    }


def _text(value: object) -> str:
    """Return a value as ShapeWorks would write it."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return str(value)
