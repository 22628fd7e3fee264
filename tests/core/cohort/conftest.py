"""Folders of files, and the cohorts that they are read as."""

import pytest

from homolog.cohort import read_cohort


@pytest.fixture(scope="session")
def place():
    """Return the function that makes empty files in a folder."""

    def made(folder, *names):
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(b"")

    return made


@pytest.fixture(scope="session")
def cohort_of(place):
    """Return the function that makes files in a folder and reads the cohort."""

    def made(folder, *names, pattern=None):
        place(folder, *names)
        return read_cohort(folder, pattern)

    return made


@pytest.fixture(scope="session")
def files_of():
    """Return the function that names the files of a cohort."""

    def made(cohort):
        return {
            subject.name: subject.path.relative_to(cohort.folder).as_posix() for subject in cohort.subjects
        }

    return made


@pytest.fixture(scope="session")
def dicom():
    """Return the function that writes the head of a DICOM file."""

    def made(path, kind=b"1.2.840.10008.5.1.4.1.1.2"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(128) + b"DICM" + kind)

    return made
