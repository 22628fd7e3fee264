"""Tables as CSV: a header line, names in the first column, numbers with all their digits."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from homolog.io.atomic import write_text

__all__ = ["write_table"]


def write_table(
    path: Path, columns: Sequence[str], rows: Iterable[Sequence[str | float | int | None]]
) -> None:
    """Write a table atomically.

    Parameters
    ----------
    path : Path
        The CSV file.
    columns : sequence of str
        The header line.
    rows : iterable of sequences
        One value for each column; floats are written so that they read back unchanged, None is empty.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)  # floats with all their digits
    write_text(path, text.getvalue())
