"""A result with particles optimized again takes the place of the one before, whole or not at all."""

import shutil

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.run.repair import read_inputs, write_repaired
from homolog.run.shape_files import surface_of_model
from homolog.statistics.shape_model import ShapeModel


@pytest.fixture
def project(finished_run, tmp_path):
    """Return a copy of a finished project."""
    copy = ProjectFolder(tmp_path / "project")
    shutil.copytree(finished_run.folder, copy.folder, ignore=shutil.ignore_patterns(".lock"))
    return copy


def moved(local):
    """Return the particles with the first two of the first subject exchanged."""
    changed = local.copy()
    changed[0, :2] = local[0, 1::-1]
    return changed


def test_a_written_result_is_read_back_with_its_note_and_its_history(project):
    before, local = project.read(), moved(read_result(project).local)
    write_repaired(project, {"": local}, {"a": "exchanged by a test"})
    after, result = project.read(), read_result(project)
    np.testing.assert_array_equal(result.local, local)
    world = np.einsum("mij,mnj->mni", result.alignments[:, :3, :3], local) + result.alignments[:, None, :3, 3]
    np.testing.assert_allclose(result.world, world, atol=1e-9)
    assert after.result.subjects[0].notes[-1] == "exchanged by a test"
    kept = {"iterations", "ended", "fingerprint", "settings", "seconds", "particles"}
    assert after.result.model_dump(include=kept) == before.result.model_dump(include=kept)
    assert (after.subjects, after.settings, after.unfinished) == (
        before.subjects,
        before.settings,
        before.unfinished,
    )


def test_a_result_that_cannot_be_written_leaves_the_former_one(project, monkeypatch):
    before = {path: path.read_bytes() for path in project.folder.rglob("*") if path.is_file()}

    def fails(*_):
        raise InputError("the disk is full")

    monkeypatch.setattr("homolog.run.result.write_table", fails)
    with pytest.raises(InputError, match="disk is full"):
        write_repaired(project, {"": moved(read_result(project).local)}, {})
    after = {path: path.read_bytes() for path in project.folder.rglob("*") if path.is_file()}
    assert {path: after.get(path) for path in before} == before


def test_the_input_files_are_not_needed(project):
    record = project.read()
    gone = [
        subject.model_copy(update={"path": f"../nowhere/{subject.name}.nrrd"}) for subject in record.subjects
    ]
    project.write(record.model_copy(update={"subjects": gone}))
    inputs = read_inputs(project)
    assert [shape.name for shape in inputs.shapes] == ["a", "b", "c", "d"]
    np.testing.assert_array_equal(inputs.shapes[1].alignment, read_result(project).alignments[1])


def test_a_missing_surface_is_named(project):
    (project.groomed / "c.npz").unlink()
    with pytest.raises(InputError, match=r"c\.npz"):
        read_inputs(project)


def test_the_mean_surface_is_the_one_that_the_run_made(project):
    inputs, result = read_inputs(project), read_result(project)
    meshes = [shape.mesh for shape in inputs.shapes]
    mean = surface_of_model(ShapeModel().fit(result.world), result.world, meshes, result.alignments)
    np.testing.assert_allclose(mean.vertices, result.mean_surface.vertices, atol=1e-4)
    np.testing.assert_allclose(mean.smoothing, result.smoothing)
