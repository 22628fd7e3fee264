"""Requirements of ShapeWorks on projects, after ``Libs/Project`` of its sources.

Its reader identifies columns by prefixes. It refuses values that are not text, and a subject with a kind of
column for only some of its anatomies.
"""

from collections.abc import Sequence
from typing import Any

from homolog.exchange.shapeworks_files import INPUTS, PREFIXES, Row, ShapeWorksProject

__all__ = ["complete_row", "escape_column", "tables_of"]

_FLAGS = ("fixed", "excluded")
_TAKEN = ("name", "local_particles", "world_particles", *(item for item in PREFIXES if item != "group_"))
_IDENTITY = " ".join(str(float(row == column)) for row in range(4) for column in range(4))
_OF_EACH = {
    "landmarks_file_": "",
    "constraints_": "",
    "groomed_": "",
    "local_particles_": "",
    "world_particles_": "",
    "alignment_": _IDENTITY,
    "procrustes_": _IDENTITY,
}
"""Prefixes of columns that must exist for all anatomies or none, and their empty values."""


def escape_column(name: str) -> str:
    """Return the name for a column of table data that ShapeWorks does not misinterpret."""
    return f"_{name}" if name in _FLAGS or name.startswith(_TAKEN) else name


def complete_row(row: Row, domains: Sequence[str]) -> Row:
    """Return a subject's row with each kind of column for all anatomies or for none, inputs first.

    Missing paths are empty, and missing transforms are the identity. Inputs are in the order of the
    anatomies.
    """
    inputs: Row = {}
    for domain in domains:
        own = [key for key in (f"{prefix}{domain}" for prefix in INPUTS) if key in row]
        inputs |= {key: row[key] for key in own} or {f"shape_{domain}": ""}
    others = {key: value for key, value in row.items() if key not in inputs}
    for prefix, nothing in _OF_EACH.items():
        keys = [f"{prefix}{domain}" for domain in domains]
        if any(key in row for key in keys):
            others |= {key: row.get(key, nothing) for key in keys}
    return inputs | others


def tables_of(source: ShapeWorksProject) -> dict[str, Any]:
    """Return a project's tables without its rows; the tables that ShapeWorks reads contain only texts."""
    groom, landmarks = source.others.get("groom"), source.others.get("landmarks")
    return source.others | {
        "groom": {
            str(domain): source.texts(table)
            for domain, table in (groom.items() if isinstance(groom, dict) else ())
            if isinstance(table, dict)
        },
        "landmarks": [
            source.texts(landmark)
            for landmark in (landmarks if isinstance(landmarks, list) else ())
            if isinstance(landmark, dict)
        ],
        **{key: source.table(key) for key in ("optimize", "studio", "project", "analysis", "deepssm")},
    }
