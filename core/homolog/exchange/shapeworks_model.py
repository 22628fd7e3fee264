"""Models of ShapeWorks: a project file, or a folder of particles."""

from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.exchange.model import ForeignModel, ForeignSubject, particles_of
from homolog.exchange.shapeworks_files import INPUTS, PATH_PREFIXES, PREFIXES, Row, ShapeWorksProject
from homolog.exchange.shapeworks_paths import leads_out, place_of, plain_path
from homolog.io.particles import PARTICLE_SUFFIXES

__all__ = ["model_of_folder", "model_of_project"]

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
    subjects = tuple(_subject(source, row, domain) for row in rows)
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


def _subject(source: ShapeWorksProject, row: Row, domain: str) -> ForeignSubject:
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
