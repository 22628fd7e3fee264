"""Cohorts that commands are given: what was left out while reading is said at once."""

import sys
from pathlib import Path

from homolog.cohort import Cohort, read_cohort
from homolog.files.project import ProjectFolder

__all__ = ["cohort_of", "read_and_tell"]


def cohort_of(path: Path) -> Cohort:
    """Return the cohort of a folder, table or project."""
    project = ProjectFolder(path)
    return project.cohort() if project.exists else read_and_tell(path)


def read_and_tell(path: Path) -> Cohort:
    """Return the cohort of a folder or table, and print which files were skipped and why."""
    cohort = read_cohort(path)
    for note in cohort.notes:
        sys.stderr.write(f"homolog: note: {note}\n")
    return cohort
