"""Files of patients."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from homolog.cohort import (
    TABLE_SUFFIXES,
    Subject,
    is_series,
    read_cohort,
    structures_in,
    subject_at,
    suffix_of,
)
from homolog.errors import InputError
from homolog.io.label_names import same_name
from homolog.patient.reference import Reference
from homolog.settings import GroomSettings

__all__ = ["patient_at", "patients_of", "with_label"]


def patient_at(path: Path, structures: Collection[str] = ()) -> Subject:
    """Return the patient of a file, as `patients_of`; raises InputError if it contains several."""
    subjects = patients_of([path], structures)
    if len(subjects) != 1:
        raise InputError(f"{path}: contains {len(subjects)} subjects; choose one file")
    return subjects[0]


def patients_of(files: Sequence[Path], structures: Collection[str] = ()) -> tuple[Subject, ...]:
    """Return the patients of files, folders and tables.

    Parameters
    ----------
    files : sequence of Path
    structures : collection of str
        The structures of the reference, if there are several: a folder that has a file of one of them is a
        single patient.

    Raises
    ------
    InputError
        If a path does not exist, or two patients have the same name.
    """
    subjects: list[Subject] = []
    for path in files:
        if not path.exists():
            raise InputError(f"{path}: does not exist; correct the path")
        table = path.is_file() and suffix_of(path) in TABLE_SUFFIXES
        inside = structures_in(path) if structures and path.is_dir() else {}
        if any(same_name(name, own) for name in structures for own in inside):
            subjects.append(subject_at(path))
        elif table or (path.is_dir() and not is_series(path)):
            subjects += read_cohort(path).subjects
        else:
            subjects.append(subject_at(path))
    names = [subject.name for subject in subjects]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"several patients have the name {', '.join(twice)}; names must be unique")
    return tuple(subjects)


def with_label(reference: Reference, label: str | None) -> Reference:
    """Return the reference with another structure for patients' files, if given."""
    if label is None:
        return reference
    number = label.strip().isdecimal()
    structure = {"label": int(label) if number else None, "segment": None if number else label}
    groom = GroomSettings.model_validate(reference.provenance.groom.model_dump() | structure)
    return replace(reference, provenance=replace(reference.provenance, groom=groom))
