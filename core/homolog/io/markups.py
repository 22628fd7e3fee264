"""Point lists of 3D Slicer (``.mrk.json``, and ``.fcsv`` of older versions), in LPS millimetres."""

import csv
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.bounded import read_bytes, read_json

__all__ = ["Markups", "landmark_table", "read_markups", "write_markups"]

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_TO_LPS = {"LPS": (1.0, 1.0, 1.0), "1": (1.0, 1.0, 1.0), "RAS": (-1.0, -1.0, 1.0), "0": (-1.0, -1.0, 1.0)}
_NOT_SET = ("undefined", "missing", "preview")
_IDENTITY = [-1.0, -0.0, -0.0, -0.0, -1.0, -0.0, 0.0, 0.0, 1.0]  # RAS axes as Slicer writes them in LPS


@dataclass(frozen=True, slots=True, eq=False)
class Markups:
    """Named points.

    Attributes
    ----------
    names : tuple of str
        L distinct names.
    points : (L, 3) float64 array
        Positions [mm, LPS], read-only.
    """

    names: tuple[str, ...]
    points: FloatArray


def write_markups(
    path: Path, points: FloatArray, names: Sequence[str] | None = None, *, title: str = "particles"
) -> None:
    """Write points as a list that 3D Slicer opens.

    Parameters
    ----------
    path : Path
        File that by Slicer's convention ends in ``.mrk.json``. It is replaced atomically.
    points : (N, 3) array
        Positions [mm, LPS].
    names : sequence of str, optional
        Labels of the points; by default their indices, which are those of the correspondence.
    title : str
        Name of the list in Slicer.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    table = np.asarray(points, dtype=np.float64)
    labels = [str(number) for number in range(len(table))] if names is None else names
    control = [
        {
            "id": str(number),
            "label": label,
            "position": position,
            "orientation": _IDENTITY,
            "selected": True,
            "locked": False,
            "visibility": True,
            "positionStatus": "defined",
        }
        for number, (label, position) in enumerate(zip(labels, table.tolist(), strict=True), start=1)
    ]
    markup = {
        "type": "Fiducial",
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "name": title,
        "locked": True,
        "labelFormat": "%N-%d",
        "controlPoints": control,
        "display": {"visibility": True, "pointLabelsVisibility": names is not None},
    }
    write_text(path, json.dumps({"@schema": _SCHEMA, "markups": [markup]}, indent=1) + "\n")


def read_markups(path: Path) -> Markups:
    """Read the points of a Slicer file; those that were never placed are omitted.

    Raises
    ------
    InputError
        If the file can't be read, contains no or several point lists, two points have the same name, or a
        position, unit or coordinate system is invalid.
    """
    path = Path(path)
    axes, placed = _fcsv_points(path) if path.suffix.lower() == ".fcsv" else _json_points(path)
    if axes.upper() not in _TO_LPS:
        raise InputError(f"{path}: its coordinate system is neither LPS nor RAS; save it again from Slicer")
    if not placed:
        raise InputError(f"{path}: contains no placed point; place the points in Slicer and save it again")
    names = tuple(name for name, _ in placed)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: several points are named {', '.join(twice[:5])}; give each its own name")
    return Markups(names, frozen(np.array([point for _, point in placed]) * _TO_LPS[axes.upper()]))


def _json_points(path: Path) -> tuple[str, list[tuple[str, list[float]]]]:
    """Return the coordinate system of a file and its placed points, with their names."""
    markups = read_json(path, "Slicer markups file").get("markups")
    lists = [markup for markup in markups if isinstance(markup, dict)] if isinstance(markups, list) else []
    if len(lists) != 1:
        raise InputError(f"{path}: contains {len(lists)} point lists, not one; save each to its own file")
    if lists[0].get("coordinateUnits", "mm") not in ("mm", ["mm", "UCUM", "millimeter"]):
        raise InputError(f"{path}: its unit is not mm; save it again in millimetres")
    control = lists[0].get("controlPoints")
    placed = [_point(path, item) for item in control if _is_placed(item)] if isinstance(control, list) else []
    return str(lists[0].get("coordinateSystem", "LPS")), placed


_COLUMNS = ("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label")
_SETTING = re.compile(r"#\s*(CoordinateSystem|columns)\s*=\s*(.+)", re.IGNORECASE)


def _fcsv_points(path: Path) -> tuple[str, list[tuple[str, list[float]]]]:
    """Return the coordinate system of a file of older versions of Slicer and its points, with their names.

    Without a line that names the coordinate system it is RAS, as in versions that wrote none.
    """
    stored = read_bytes(path, "Slicer markups file")
    try:
        lines = stored.decode("utf-8-sig").splitlines()
        rows = list(csv.reader(line for line in lines if line.strip() and not line.startswith("#")))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: can't be read as a Slicer markups file: {error}; save it again") from error
    matches = [match for line in lines if (match := _SETTING.match(line))]
    settings = {match[1].casefold(): match[2].strip() for match in matches}
    columns = [name.strip() for name in settings.get("columns", ",".join(_COLUMNS)).split(",")]
    points = []
    for row in rows:
        item = dict(zip(columns, row, strict=False))
        position = [item.get(axis) for axis in "xyz"]
        points.append(_point(path, {**item, "position": position}))
    return settings.get("coordinatesystem", "RAS"), points


def _is_placed(control_point: object) -> bool:
    return not (
        isinstance(control_point, Mapping) and control_point.get("positionStatus", "defined") in _NOT_SET
    )


def _point(path: Path, control_point: Any) -> tuple[str, list[float]]:  # noqa: ANN401 - JSON
    """Return a control point's name and position in the file's coordinates."""
    name = (
        str(control_point.get("label") or control_point.get("id") or "")
        if isinstance(control_point, Mapping)
        else ""
    )
    try:
        position = [float(value) for value in control_point["position"]]
        if len(position) == 3 and np.isfinite(position).all() and name:
            return name, position
    except (TypeError, KeyError, ValueError, OverflowError):
        pass
    raise InputError(
        f"{path}: point {name or '?'} has no position of three numbers; place it again in Slicer"
    )


def landmark_table(markups: Sequence[Markups]) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names in two or more lists, and all positions, (M, L, 3), NaN if missing."""
    every = [name for markup in markups for name in markup.names]
    shared = tuple(name for name in dict.fromkeys(every) if every.count(name) > 1)
    table = np.full((len(markups), len(shared), 3), np.nan)
    for row, item in zip(table, markups, strict=True):
        for name, point in zip(item.names, item.points, strict=True):
            if name in shared:
                row[shared.index(name)] = point
    return shared, table
