"""ShapeWorks project files, ``.swproj`` (JSON) and ``.xlsx``, as models and cohorts; folders of particles.

The layout is that of ShapeWorks 6.4 to 6.7 (``Libs/Project`` of its sources): every value is a text, a row is
a subject, and columns of files and transforms end in the name of their domain (anatomy). Its reader tells
columns by prefixes. It refuses values that are not text, and a subject with a kind of column for only some
of its anatomies.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import Cohort, Subject, checked_path, stem_of, subject_at
from homolog.cohort.manifest import is_absolute
from homolog.cohort.manifest import place_of as place_in
from homolog.errors import InputError
from homolog.io.bounded import read_json
from homolog.io.constraints import COLUMN, read_constraints, text_of
from homolog.io.particles import PARTICLE_SUFFIXES, read_particles
from homolog.spreadsheets import read_rows, read_sheets

__all__ = [
    "INPUTS",
    "PATH_PREFIXES",
    "PREFIXES",
    "ForeignModel",
    "ForeignSubject",
    "Row",
    "ShapeWorksProject",
    "complete_row",
    "escape_column",
    "is_shapeworks",
    "leads_out",
    "model_of_folder",
    "model_of_project",
    "particles_of",
    "place_of",
    "plain_path",
    "read_shapeworks_cohort",
    "read_shapeworks_file",
    "tables_of",
]

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
    sheets = {title: _table(lines) for title, lines in read_sheets(path, "ShapeWorks project", _text).items()}
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


def _table(lines: Sequence[Sequence[str]]) -> list[Row]:
    """Return a sheet's rows by the names in its first row, without blank rows."""
    heads = lines[0] if lines else []
    return [
        {head: text for head, text in zip(heads, texts, strict=False) if head}
        for texts in lines[1:]
        if any(texts)
    ]


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


def plain_path(path: str) -> str:
    """Return a path with the slashes and spaces of this system.

    Raises
    ------
    InputError
        If it is not a valid path on any system.
    """
    try:
        return checked_path(path.replace("\\", "/").replace("%20", " "))
    except ValueError as error:
        raise InputError(f"the path {path[:80]!r} {error}; save the project again") from error


def place_of(path: str, folder: Path) -> Path | None:
    r"""Return the target of a path in a project of a folder.

    For an absolute path of another machine (``C:\study\a.ply``, ``\\server\study\a.ply``, ``/home/me/a.ply``)
    it is the file in the folder with the longest end of that path, None if there is none.
    """
    plain = plain_path(path)
    places = [item for text in (path, plain) if os.path.exists(item := place_in(folder, text))]
    if places or is_absolute(plain):
        return places[0] if places else None
    return folder / plain


def leads_out(path: str) -> bool:
    """Return whether a path leads out of the project's folder, or to another machine."""
    plain = path.replace("\\", "/")
    return is_absolute(plain) or ".." in PurePosixPath(plain).parts


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


@dataclass(frozen=True, slots=True, eq=False)
class ForeignSubject:
    """A subject of a foreign model.

    Attributes
    ----------
    name : str
    local, world : (N, 3) float64 array or None
        Particles [mm] in the frame of the subject's file and in the common one; at least one is given.
    alignment : (4, 4) float64 array or None
        From local to world, if stored by the other program.
    shapes : tuple of Path
        Files that may contain its surface, the best first.
    group : str or None
    columns : mapping of str to str
    landmarks : Path or None
        File with the positions of its landmarks, in the local frame.
    """

    name: str
    local: FloatArray | None
    world: FloatArray | None
    alignment: FloatArray | None = None
    shapes: tuple[Path, ...] = ()
    group: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    landmarks: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ForeignModel:
    """A foreign model: its subjects, source, and known settings of its optimization.

    Attributes
    ----------
    source : str
    subjects : tuple of ForeignSubject
    geodesic, normals : bool or None
        Whether sampling used geodesic distances, and whether normals were used; None if unknown.
    landmark_names : tuple of str
        Names in the order of the lines of the landmark files.
    notes : tuple of str
        Notes for the user.
    """

    source: str
    subjects: tuple[ForeignSubject, ...]
    geodesic: bool | None = None
    normals: bool | None = None
    landmark_names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def particles_of(path: Path | None) -> FloatArray | None:
    """Read particles, or return None without a path."""
    return None if path is None else read_particles(path)


_YES = ("true", "yes", "1")
_ENDS = {"_local": "local", "_world": "world"}
_OLD_ENDS = {".lpts": "_local", ".wpts": "_world"}


def model_of_project(source: ShapeWorksProject, domain: str) -> ForeignModel:
    """Return the model of one anatomy of a ShapeWorks project; without the excluded subjects.

    Raises
    ------
    InputError
        If a file is missing or damaged, a subject has no particles, or two have the same name.
    """
    rows = [row for row in source.rows if row.get("excluded", "").lower() not in _YES]
    out = [_name(row, domain) for row in source.rows if row not in rows]
    notes = [f"excluded in ShapeWorks: {', '.join(out)}"] if out else []
    subjects = tuple(_model_subject(source, row, domain) for row in rows)
    outside = sum(
        leads_out(value)
        for row in rows
        for key, value in row.items()
        if key.startswith(PATH_PREFIXES) and key.endswith(f"_{domain}")
    )
    if outside:
        notes.append(
            f"{outside} of its paths lead out of its folder; missing files were searched for in the folder"
        )
    optimize = source.table("optimize")
    listed = source.others.get("landmarks")
    landmarks = [
        str(item.get("name", ""))
        for item in (listed if isinstance(listed, list) else [])
        if isinstance(item, dict) and str(item.get("domain", domain)) == domain
    ]
    return ForeignModel(
        f"the ShapeWorks project {source.path.name}",
        subjects,
        optimize.get("use_geodesic_distance", "").lower() in _YES,
        optimize.get("use_normals", "").lower() in _YES,
        tuple(landmarks),
        tuple(notes),
    )


def model_of_folder(folder: Path) -> ForeignModel:
    """Return the model of a folder with one particle file per subject, or two (local and world).

    Raises
    ------
    InputError
        If there are fewer than two subjects, or a file can't be read.
    """
    files: dict[str, dict[str, Path]] = {}
    for path in sorted(folder.iterdir()):
        suffix = path.suffix.lower()
        if suffix not in PARTICLE_SUFFIXES or path.name.startswith("."):
            continue
        end = next((item for item in _ENDS if path.stem.endswith(item)), _OLD_ENDS.get(suffix, ""))
        frames = files.setdefault(path.stem.removesuffix(end), {})
        if (frame := _ENDS.get(end, "world")) in frames:
            raise InputError(f"{path}: {frames[frame].name} exists too; keep one of them")
        frames[frame] = path
    if not files:
        others = [
            item.name for item in sorted(folder.iterdir()) if item.suffix.lower() in (".swproj", ".xlsx")
        ]
        remedy = f"give the project in it, {others[0]}" if others else "choose another folder"
        raise InputError(f"{folder}: contains no particles ({', '.join(PARTICLE_SUFFIXES)}); {remedy}")
    subjects = tuple(
        ForeignSubject(name, particles_of(item.get("local")), particles_of(item.get("world")))
        for name, item in files.items()
    )
    return ForeignModel(f"particles in the folder {folder.resolve().name}", subjects)


def _model_subject(source: ShapeWorksProject, row: Row, domain: str) -> ForeignSubject:
    name, folder = _name(row, domain), source.path.parent
    places = {
        frame: _needed(source.path, name, row[key])
        for frame in ("local", "world")
        if row.get(key := f"{frame}_particles_{domain}")
    }
    if not places:
        raise InputError(
            f"{source.path}: subject {name} has no particles; optimize it in ShapeWorks or exclude it first"
        )
    groups = {key.removeprefix("group_"): value for key, value in row.items() if key.startswith("group_")}
    columns = {
        key: value
        for key, value in row.items()
        if key not in ("name", "fixed", "excluded") and not key.startswith(PREFIXES)
    }
    landmarks = row.get(f"landmarks_file_{domain}")
    return ForeignSubject(
        name=name,
        local=particles_of(places.get("local")),
        world=particles_of(places.get("world")),
        alignment=_alignment(source.path, row, domain),
        shapes=tuple(
            place_of(item, folder) or folder / plain_path(item) for item in source.inputs(row, domain)
        ),
        group=next((value for value in groups.values() if value), None),
        columns=groups | columns,
        landmarks=_needed(source.path, name, landmarks) if landmarks else None,
    )


def _needed(path: Path, name: str, value: str) -> Path:
    """Return the path of a required file."""
    place = place_of(value, path.parent)
    if place is None:
        raise InputError(
            f"{path}: subject {name} has a file on another machine, {value}; copy it into the project's "
            "folder, or save the project there with relative paths"
        )
    return place


def _name(row: Row, domain: str) -> str:
    """Return a subject's name; like ShapeWorks, fall back on the name of the shape's file."""
    if row.get("name"):
        return row["name"]
    for prefix in (*INPUTS, "groomed_", "local_particles_", "world_particles_"):
        if path := row.get(f"{prefix}{domain}"):
            file = Path(plain_path(path))
            stem = file.name.removesuffix(".gz").rpartition(".")[0] or file.name
            return stem.removesuffix("_local").removesuffix("_world")
    return "?"


def _alignment(path: Path, row: Row, domain: str) -> FloatArray | None:
    """Return procrustes · alignment, None where neither is given."""
    texts = [row.get(f"{kind}_{domain}", "") for kind in ("procrustes", "alignment")]
    if not any(texts):
        return None
    result = np.eye(4)
    for text in texts:
        result = result @ _matrix(path, text)
    return result


def _matrix(path: Path, text: str) -> FloatArray:
    """Read a transform: 16 numbers by rows, or 12 in the old form, of which only the translation is used."""
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise InputError(f"{path}: a transform is damaged ({error}); save the project again") from error
    matrix = np.eye(4)
    if len(numbers) == 12:
        matrix[:3, 3] = numbers[9:]
    elif len(numbers) == 16:
        matrix = numbers.reshape(4, 4)
    elif len(numbers):
        raise InputError(
            f"{path}: a transform has {len(numbers)} numbers in place of 16; save the project again"
        )
    if not np.isfinite(matrix).all():
        raise InputError(f"{path}: a transform contains values that aren't finite; save the project again")
    return matrix


_GROUP = "group_"
_NOT_TAKEN = ("name", "notes")


def is_shapeworks(path: Path) -> bool:
    """Return whether a file is a ShapeWorks project: ``.swproj``, or ``.xlsx`` with its columns of shapes."""
    suffix = path.suffix.lower()
    if suffix != ".xlsx" or not path.is_file():
        return suffix == ".swproj"
    return any(column.startswith(INPUTS) for column in read_rows(path)[0])


def read_shapeworks_cohort(path: Path) -> Cohort:
    """Return the cohort of a ShapeWorks project; several domains are structures of its subjects.

    Raises
    ------
    InputError
        If it can't be read, or a subject names no shape that exists.
    """
    source = read_shapeworks_file(path)
    return Cohort(tuple(_cohort_subject(source, row) for row in source.rows), path.parent)


def _cohort_subject(source: ShapeWorksProject, row: Row) -> Subject:
    files = {}
    for domain in source.domains:
        text = next(filter(None, (row.get(f"{prefix}{domain}", "") for prefix in INPUTS)), "")
        place = place_of(text, source.path.parent) if text else None
        if text and (place is None or not place.exists()):
            raise InputError(f"{source.path}: {text} does not exist; correct the path in ShapeWorks")
        if place is not None:
            files[domain] = place
    if not files:
        raise InputError(f"{source.path}: subject {row.get('name', '')} has no shape; remove its row")
    first = next(iter(files.values()))
    name = row.get("name") or stem_of(first)
    groups = {key.removeprefix(_GROUP): row[key] for key in row if key.startswith(_GROUP) and row[key]}
    further = {
        key: item for key, item in row.items() if not key.startswith(PREFIXES) and key not in _NOT_TAKEN
    }
    for domain in files:
        if text := row.get(f"constraints_{domain}", ""):
            cuts = text_of(read_constraints(_needed(source.path, name, text)))
            further |= {COLUMN if len(source.domains) == 1 else f"{COLUMN}:{domain}": cuts} if cuts else {}
    group = next(iter(groups), "")
    columns = MappingProxyType({key: item for key, item in groups.items() if key != group} | further)
    if len(source.domains) == 1:
        single = subject_at(first, name)
        return Subject(name, single.path, groups.get(group), columns, single.landmarks, single.image)
    folder = Path(os.path.commonpath([file.parent for file in files.values()]))
    return Subject(name, folder, groups.get(group), columns, structures=MappingProxyType(files))
