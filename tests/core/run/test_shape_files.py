"""The shape model on disk, and how its surface follows the particles, read back."""

import shutil

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.arrays import write_arrays
from homolog.io.project import ProjectFolder
from homolog.io.results import read_modes, read_result, write_smoothing
from homolog.run.repair import write_repaired


@pytest.fixture
def project(finished_run, tmp_path):
    """Return a copy of a finished project."""
    copy = ProjectFolder(tmp_path / "project")
    shutil.copytree(finished_run.folder, copy.folder, ignore=shutil.ignore_patterns(".lock"))
    return copy


def smoothed(project, values):
    """Let the project's record tell that the surface is smoothed at some particles."""
    record = project.read()
    changed = record.result.model_copy(update={"smoothed_particles": int(np.count_nonzero(values))})
    project.write(record.model_copy(update={"result": changed}))
    write_smoothing(project, values)


def test_a_surface_that_nothing_folds_has_no_smoothing(project):
    assert not read_result(project).smoothing.any()
    assert not (project.model / "smoothing.npz").exists()


def test_particles_torn_apart_along_a_mode_are_smoothed_over_and_told(project):
    local = np.array(read_result(project).local)
    amounts = np.linspace(-8.0, 8.0, len(local))
    patch = np.argsort(np.linalg.norm(local[0] - local[0, 0], axis=1))[:6]
    local[:, patch, 2] += amounts[:, None]
    write_repaired(project, {"": local}, {})
    result, record = read_result(project), project.read().result
    assert record.smoothed_particles == np.count_nonzero(result.smoothing) > 0
    assert f"smoothed around {record.smoothed_particles} particles" in record.surface_text
    assert len(read_modes(project, result.mean_surface)) > 0


@pytest.mark.parametrize(
    "what", ["missing", "short", "negative", "not finite", "other count", "whole numbers"]
)
def test_smoothing_that_does_not_belong_to_the_result_is_refused(project, what):
    count = read_result(project).world.shape[1]
    values = np.zeros(count)
    values[:3] = 1.5
    smoothed(project, values)
    np.testing.assert_array_equal(read_result(project).smoothing, values)
    path = project.model / "smoothing.npz"
    if what == "missing":
        path.unlink()
    else:
        wrong = {
            "short": values[:-1],
            "negative": -values,
            "not finite": np.where(values > 0.0, np.nan, 0.0),
            "other count": np.where(np.arange(count) < 2, 1.5, 0.0),
            "whole numbers": values.astype(np.int64),
        }
        write_arrays(path, {"smoothing": wrong[what]})
    with pytest.raises(InputError, match=r"smoothing\.npz"):
        read_result(project)
