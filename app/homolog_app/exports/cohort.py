"""The cohort's table: names, files, groups and covariates."""

from pathlib import Path

from homolog.cohort import Cohort
from homolog.files.project import ProjectFolder
from homolog.files.tables import write_table

__all__ = ["write_cohort"]


def write_cohort(path: Path, cohort: Cohort) -> None:
    """Write a cohort as CSV; the file can be read as a cohort again.

    Parameters
    ----------
    path : Path
        File to make or replace. Paths in it start at its folder.
    cohort : Cohort

    Raises
    ------
    InputError
        If the file can't be written.
    """
    relative = ProjectFolder(path.parent).describe(cohort)
    columns = list(dict.fromkeys(name for item in relative for name in item.columns))
    files = [name for name in ("landmarks", "image") if any(getattr(item, name) for item in relative)]
    write_table(
        path,
        ["name", "path", "group", *files, *columns],
        (
            [
                item.name,
                item.path,
                item.group,
                *(getattr(item, name) for name in files),
                *(item.columns.get(name) for name in columns),
            ]
            for item in relative
        ),
    )
