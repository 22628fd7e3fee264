"""Subjects whose folders have a file for each side of the body: one subject per side."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from homolog.cohort.dicom import holds_dicom
from homolog.cohort.sides import SIDE_COLUMN, side_of_word, sides_among
from homolog.cohort.subject import Cohort, Subject, image_beside, landmarks_beside
from homolog.cohort.subject_folder import mask_files

__all__ = ["with_both_sides"]


def with_both_sides(cohort: Cohort) -> Cohort:
    """Return a cohort in which both sides of each subject are subjects, if files differ only in side.

    The subjects' folders must contain files of only one structure, ``left.nii.gz`` and ``right.nii.gz``, or
    ``hippocampus_L.nii.gz`` and ``hippocampus_R.nii.gz``; a subject may lack one of them. Subject ``p1``
    becomes ``p1_left`` and ``p1_right``, with a column ``side`` and the subject's group and covariates. Other
    cohorts are returned unchanged.
    """
    files = {subject.name: _files(subject) for subject in cohort.subjects}
    codes = sides_among(list(dict.fromkeys(name for own in files.values() for name in own)))
    sides = {name: side_of_word(code) for name, code in codes.items()}
    own_sides = [[sides.get(name) for name in own] for own in files.values()]
    if len(set(sides.values())) < 2 or any(len(set(own)) < max(len(own), 1) for own in own_sides):
        return cohort
    subjects = [
        replace(
            subject,
            name=f"{subject.name}_{sides[name]}",
            path=file,
            columns={**subject.columns, SIDE_COLUMN: sides[name]},
            landmarks=landmarks_beside(file),
            image=image_beside(file),
        )
        for subject in cohort.subjects
        for name, file in files[subject.name].items()
    ]
    note = (
        f"the files {' and '.join(sides)} of a subject are its sides, each one a subject; for one "
        f"side only choose it by its name (label: {next(iter(sides))})"
    )
    return Cohort(tuple(subjects), cohort.folder, (*cohort.notes, note))


def _files(subject: Subject) -> Mapping[str, Path]:
    """Return the files in a subject's folder by structure; empty for a file or a series of slices."""
    path = subject.path
    return {} if path.is_file() or (path.is_dir() and holds_dicom(path)) else mask_files(path)
