"""Further content of an imported ShapeWorks project, stored for a later export."""

import json
import os
from pathlib import Path

from homolog.errors import InputError
from homolog.exchange.shapeworks_files import PATH_PREFIXES, Row, ShapeWorksProject
from homolog.exchange.shapeworks_paths import place_of
from homolog.io.atomic import write_text
from homolog.io.bounded import read_json
from homolog.io.project import ProjectFolder

__all__ = ["load_source_metadata", "moved_paths", "save_source_metadata"]

_FILE = "shapeworks.json"


def save_source_metadata(project: ProjectFolder, source: ShapeWorksProject, domain: str) -> None:
    """Write a ShapeWorks project's rows and settings into a Homolog project; raises as `write_text` does.

    Parameters
    ----------
    project : ProjectFolder
        The project that stores it.
    source : ShapeWorksProject
        The imported project.
    domain : str
        The imported anatomy.
    """
    rows = [moved_paths(row, source.path.parent, project.folder) for row in source.rows]
    content = {"file": source.path.name, "domain": domain, "data": rows, "others": source.others}
    write_text(project.folder / _FILE, json.dumps(content, indent=1) + "\n")


def load_source_metadata(project: ProjectFolder) -> tuple[ShapeWorksProject, str]:
    """Return the stored content, and the imported domain; empty if the project was not imported.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    path = project.folder / _FILE
    if not path.is_file():
        return ShapeWorksProject(path, (), {}), "1"
    content = read_json(path, "record of a ShapeWorks project")
    rows, others = content.get("data"), content.get("others")
    good = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    return (
        ShapeWorksProject(
            path,
            tuple({str(key): str(value) for key, value in row.items()} for row in good),
            others if isinstance(others, dict) else {},
        ),
        str(content.get("domain", "1")),
    )


def moved_paths(row: Row, old: Path, new: Path) -> Row:
    """Return a row with paths relative to another folder.

    Parameters
    ----------
    row : dict
        A subject's row of a ShapeWorks project.
    old, new : Path
        The folders to which paths are relative, before and after.

    Returns
    -------
    dict
    """
    return {
        key: _moved(value, old, new) if value and key.startswith(PATH_PREFIXES) else value
        for key, value in row.items()
    }


def _moved(value: str, old: Path, new: Path) -> str:
    """Return a path relative to another folder; unchanged if its target is unknown here."""
    try:
        place = place_of(value, old.resolve())
        if place is None:
            return value
        moved = Path(os.path.relpath(place, new.resolve())).as_posix()
    except (InputError, ValueError):  # not a path, or on another drive
        return value
    return moved.replace(" ", "%20") if "%20" in value else moved
