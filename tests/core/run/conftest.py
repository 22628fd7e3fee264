import shutil

import pytest

from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.run import Run


@pytest.fixture
def settings(short_settings):
    return short_settings


@pytest.fixture
def finished(finished_run):
    return finished_run


@pytest.fixture
def project(ellipsoids, tmp_path):
    """Return a project that isn't there yet, beside a copy of the ellipsoids in ``scans``."""
    shutil.copytree(ellipsoids, tmp_path / "scans")
    return ProjectFolder(tmp_path / "project")


@pytest.fixture
def groomed(finished, project):
    """Return the project, with nothing in it but the groomed ellipsoids."""
    shutil.copytree(finished.groomed, project.groomed)
    shutil.copy(finished.registrations, project.registrations)
    return project


@pytest.fixture
def again(finished, project):
    """Return a copy of the finished project."""
    shutil.copytree(finished.folder, project.folder)
    return project


@pytest.fixture
def start(project, settings):
    """Return a function that makes a run of the ellipsoids."""

    def make(cohort=None, settings=settings, **options):
        return Run(project, cohort or read_cohort(project.folder.parent / "scans"), settings, **options)

    return make
