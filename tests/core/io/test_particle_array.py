"""The array of all particles, and the text files that it stands for."""

import json
import os

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io import particle_array
from homolog.io.particle_array import particle_file, read_all_particles, write_all_particles
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder

STEMS = ("a", "b", "c")
LOCAL = np.arange(36.0).reshape(3, 4, 3) / 7.0
WORLD = LOCAL + 100.0


@pytest.fixture
def project(tmp_path):
    project = ProjectFolder(tmp_path)
    project.particles.mkdir()
    write_all_particles(project, STEMS, LOCAL, WORLD)
    return project


@pytest.fixture
def without_text(monkeypatch):
    """Fail if a text file is read."""

    def refuse(path):
        raise AssertionError(f"{path} was read")

    monkeypatch.setattr(particle_array, "read_particles", refuse)


def read(project, stems=STEMS, count=4):
    return read_all_particles(project, stems, stems, count)


def mapped(array):
    while array is not None and not isinstance(array, np.memmap):
        array = array.base
    return array is not None


def test_particles_are_mapped_from_the_array(project, without_text):
    local, world, parsed = read(project)
    assert np.array_equal(local, LOCAL)
    assert np.array_equal(world, WORLD)
    assert parsed == 0
    assert mapped(local) is mapped(world) is (os.name != "nt")
    assert not local.flags.writeable


def test_a_moved_project_keeps_its_array(project, without_text, tmp_path):
    folder = tmp_path.with_name(tmp_path.name + " moved")
    tmp_path.rename(folder)
    assert np.array_equal(read(ProjectFolder(folder))[1], WORLD)


def test_some_subjects_in_another_order_are_read_from_the_array(project, without_text):
    local, _, parsed = read(project, ("c", "a"))
    assert np.array_equal(local, LOCAL[[2, 0]])
    assert parsed == 0


def test_a_changed_text_file_is_read_and_only_that(project, monkeypatch):
    write_particles(particle_file(project, "b", "world"), WORLD[1] + 1.0)
    seen, usual = [], particle_array.read_particles
    monkeypatch.setattr(particle_array, "read_particles", lambda path: seen.append(path.name) or usual(path))
    local, world, parsed = read(project)
    assert seen == ["b_local.particles", "b_world.particles"]
    assert np.array_equal(local, LOCAL)
    assert np.array_equal(world[1], WORLD[1] + 1.0)
    assert np.array_equal(world[[0, 2]], WORLD[[0, 2]])
    assert parsed == 1


def test_a_text_file_of_the_same_size_and_another_time_is_read(project):
    place = particle_file(project, "a", "local")
    text = place.read_text()
    place.write_text("9" + text[1:])
    assert place.stat().st_size == len(text)
    os.utime(place, ns=(0, 0))
    assert read(project)[0][0, 0, 0] == 9.0


@pytest.mark.parametrize("damage", ["no array", "no stamps", "cut", "stamps", "other shape", "not finite"])
def test_text_files_are_read_if_the_array_is_missing_or_damaged(project, damage):
    array, stamps = project.folder / "particles.npy", project.folder / "particles.json"
    match damage:
        case "no array":
            array.unlink()
        case "no stamps":
            stamps.unlink()
        case "cut":
            array.write_bytes(array.read_bytes()[:-8])
        case "stamps":
            stamps.write_text(json.dumps({"files": {"a": 3}}))
        case "other shape":
            np.save(array, np.zeros((2, 3, 5, 3)))
        case "not finite":
            np.save(array, np.full((2, 3, 4, 3), np.nan))
    local, world, parsed = read(project)
    assert np.array_equal(local, LOCAL)
    assert np.array_equal(world, WORLD)
    assert parsed == 3


def test_a_missing_text_file_is_missed_though_its_particles_are_in_the_array(project):
    particle_file(project, "c", "world").unlink()
    with pytest.raises(InputError, match="c_world"):
        read(project)


def test_another_number_of_particles_is_refused(project):
    with pytest.raises(InputError, match="particles of a are not 5"):
        read(project, count=5)
