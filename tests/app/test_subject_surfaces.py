"""Surfaces of large studies are read when they are looked at."""

import shutil

import pytest

from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.settings import RunSettings
from homolog_app.scenes import loaded_result
from homolog_app.scenes.loaded_result import load_result
from homolog_app.scenes.subjects import subject_contents


@pytest.fixture
def reads(monkeypatch):
    """Return the names of the subjects whose surfaces were read; two are kept at most."""
    names, usual = [], loaded_result.read_surface
    monkeypatch.setattr(
        loaded_result, "read_surface", lambda *given: names.append(given[1].name) or usual(*given)
    )
    monkeypatch.setattr(loaded_result, "_MOST_KEPT", 2)
    return names


def test_a_large_study_is_opened_without_its_surfaces(finished_run, reads):
    loaded = load_result(finished_run)
    assert list(loaded.surfaces) == ["a", "b", "c", "d"]
    assert "b" in loaded.surfaces
    assert reads == []


def test_a_study_that_fits_is_read_as_a_whole(finished_run, reads, monkeypatch):
    monkeypatch.setattr(loaded_result, "_MOST_KEPT", 4)
    loaded = load_result(finished_run)
    fine, coarse = loaded.surfaces["c"]
    assert len(coarse.vertices) <= len(fine.vertices)
    assert reads == ["a", "b", "c", "d"]


def test_the_surfaces_that_were_looked_at_last_are_kept(finished_run, reads):
    surfaces = load_result(finished_run).surfaces
    for name in ("a", "b", "a", "c", "a", "b"):
        surfaces[name]
    assert reads == ["a", "b", "c", "b"]


def test_a_page_reads_the_surfaces_of_its_subjects_only(finished_run, reads):
    loaded = load_result(finished_run)
    contents = subject_contents(finished_run.cohort().subjects, {}, {}, loaded, RunSettings())
    assert (len(contents), reads) == (4, [])
    assert [content.name for content in contents[2:4]] == ["c", "d"]
    assert contents.named("e") is None
    marked = contents.changed(lambda content: content)
    assert marked.place_of("b") == 1
    assert reads == ["c", "d"]


def test_an_older_project_gets_its_array_when_the_program_that_holds_it_reads_it(
    finished_run, tmp_path, monkeypatch
):
    folder = shutil.copytree(finished_run.folder, tmp_path / "older")
    project, array = ProjectFolder(folder), folder / "particles.npy"
    array.unlink()
    monkeypatch.setattr("homolog.io.results._MANY_FILES", 2)
    text = read_result(project)
    assert not array.exists()
    with project.locked():
        read_result(project)
    assert array.exists()
    assert (read_result(project).world == text.world).all()
