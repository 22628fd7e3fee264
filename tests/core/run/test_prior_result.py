"""Runs that start from a finished result: more particles, and new subjects fitted to it."""

import shutil

import numpy as np
import pytest

from homolog.cohort import Cohort, read_cohort
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, read_surfaces
from homolog.run import FinishReason, Phase, Run, adds_particles


def asking_for(settings, particles):
    return settings.model_copy(
        update={"optimize": settings.optimize.model_copy(update={"particles": particles})}
    )


@pytest.fixture
def cohort(project):
    return read_cohort(project.folder.parent / "scans")


@pytest.fixture(scope="module")
def finished_of_three(finished_run, ellipsoids, short_settings, tmp_path_factory):
    """Return a project with a result of all ellipsoids but the last; not to be written to."""
    project = ProjectFolder(tmp_path_factory.mktemp("three") / "project")
    shutil.copytree(finished_run.groomed, project.groomed)
    cohort = read_cohort(ellipsoids)
    Run(project, Cohort(cohort.subjects[:3], cohort.folder), short_settings).execute()
    return project


@pytest.fixture
def of_three(finished_of_three, project):
    """Return a copy of that project."""
    shutil.copytree(finished_of_three.folder, project.folder)
    return project


def on_surfaces(project):
    for surface, points in zip(read_surfaces(project), read_result(project).world, strict=True):
        gaps = np.linalg.norm(points[:, None] - surface.vertices, axis=2).min(axis=1)
        assert gaps.max() < surface.mean_edge


def test_particles_are_added_to_those_of_the_result(start, again, settings):
    before = read_result(again)
    more = asking_for(settings, 90)
    assert start(settings=more, from_result=True).execute() is FinishReason.COMPLETED
    after = read_result(again)
    assert after.world.shape == (4, 90, 3)
    on_surfaces(again)
    np.testing.assert_allclose(after.alignments, before.alignments, atol=0.2)  # by other particles
    nearest = np.linalg.norm(after.local[0][:, None] - before.local[0], axis=2).argmin(axis=1)
    assert len(set(nearest.tolist())) > 40
    assert not again.read().unfinished


def test_a_new_subject_is_fitted_and_the_particles_of_the_others_stay_to_the_bit(of_three, cohort, settings):
    before = read_result(of_three)
    assert Run(of_three, cohort, settings, from_result=True).execute() is FinishReason.COMPLETED
    after = read_result(of_three)
    assert after.names == ("a", "b", "c", "d")
    np.testing.assert_array_equal(after.local[:3], before.local)
    np.testing.assert_array_equal(after.world[:3], before.world)
    np.testing.assert_array_equal(after.alignments[:3], before.alignments)
    on_surfaces(of_three)


@pytest.mark.parametrize("phase", [Phase.GROOMING, Phase.OPTIMIZING])
def test_a_fit_that_was_broken_off_goes_on_as_a_fit(of_three, cohort, settings, phase):
    before = read_result(of_three)
    run = Run(of_three, cohort, settings, from_result=True)
    run.execute(lambda status: run.cancel() if status.phase is phase else None)
    assert not run.keep()
    assert of_three.read().from_result
    Run(of_three, cohort, settings, resume=True).execute()
    after = read_result(of_three)
    np.testing.assert_array_equal(after.local[:3], before.local)
    assert after.names == ("a", "b", "c", "d")


def test_only_a_result_of_the_same_settings_and_subjects_is_added_to(again, cohort, settings):
    record = again.read().result
    more = asking_for(settings, 90)
    assert adds_particles(record, cohort, more)
    assert not adds_particles(record, cohort, settings)
    assert not adds_particles(record, Cohort(cohort.subjects[1:], cohort.folder), more)
    other = more.optimize.model_copy(update={"seed": 1})
    assert not adds_particles(record, cohort, more.model_copy(update={"optimize": other}))


def test_what_cannot_start_from_the_result_is_said(of_three, cohort, settings):
    with pytest.raises(InputError, match="fit them first"):
        Run(of_three, cohort, asking_for(settings, 90), from_result=True).execute()
    with pytest.raises(InputError, match="already"):
        Run(of_three, Cohort(cohort.subjects[:3], cohort.folder), settings, from_result=True).execute()
    with pytest.raises(InputError, match="not in the cohort"):
        Run(of_three, Cohort(cohort.subjects[1:], cohort.folder), settings, from_result=True).execute()
    other = settings.groom.model_copy(update={"smoothing": 0.5})
    with pytest.raises(InputError, match="other settings"):
        Run(of_three, cohort, settings.model_copy(update={"groom": other}), from_result=True).execute()


def test_a_surface_that_changed_since_the_result_is_named(of_three, cohort, settings):
    scans = of_three.folder.parent / "scans"
    (scans / "a.nrrd").write_bytes((scans / "d.nrrd").read_bytes())
    with pytest.raises(InputError, match="a: the surface is not"):
        Run(of_three, cohort, settings, from_result=True).execute()
