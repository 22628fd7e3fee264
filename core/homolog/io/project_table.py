"""Groups and covariates of a project, changed without touching its particles."""

from collections.abc import Sequence

from homolog.cohort import Cohort, Subject
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultSubject, SubjectRecord
from homolog.io.tables import write_table
from homolog.spreadsheets import read_rows

__all__ = ["update_table"]


def update_table(project: ProjectFolder, subjects: Sequence[Subject]) -> None:
    """Set groups, columns and scans of a project's subjects, and of its result, from subjects of equal names.

    Particles, surfaces and models are unchanged; the groups in ``model/scores.csv`` are updated. Each file is
    replaced atomically.

    Parameters
    ----------
    project : ProjectFolder
        The project, locked by the caller.
    subjects : sequence of Subject

    Raises
    ------
    InputError
        If the project can't be read or written to.
    """
    record = _with_columns(project.read(), project.describe(Cohort(tuple(subjects), project.folder)))
    project.write(record)
    scores = project.model / "scores.csv"
    if record.result is None or not scores.is_file():
        return
    groups = {subject.name: subject.group for subject in record.result.subjects}
    columns, rows = read_rows(scores)
    if columns[:2] != ["name", "group"]:
        return
    write_table(
        scores,
        columns,
        ([groups.get(row["name"]) if key == "group" else row[key] for key in columns] for _, row in rows),
    )


def _with_columns(record: ProjectRecord, subjects: Sequence[SubjectRecord]) -> ProjectRecord:
    """Return a record with the groups, columns and scans of others by name; its result stores no scans."""
    changed = {subject.name: {"group": subject.group, "columns": subject.columns} for subject in subjects}
    images = {subject.name: {"image": subject.image} for subject in subjects}
    listed = [
        subject.model_copy(update=changed.get(subject.name, {}) | images.get(subject.name, {}))
        for subject in record.subjects
    ]
    result = record.result
    if result is not None:
        known: list[ResultSubject] = [
            subject.model_copy(update=changed.get(subject.name, {})) for subject in result.subjects
        ]
        result = result.model_copy(update={"subjects": known})
    return record.model_copy(update={"subjects": listed, "result": result})
