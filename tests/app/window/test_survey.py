"""The first look at a file."""

import numpy as np
import pytest
import pyvista as pv

from homolog.cohort import Subject
from homolog.settings import GroomSettings
from homolog_app.scenes.file_survey import survey_subject


@pytest.fixture
def labelled(tmp_path):
    """Return a file with a block of label 1 and one of label 4, turned and not at the origin."""
    import SimpleITK

    values = np.zeros((24, 20, 18), dtype=np.uint8)
    values[4:10, 5:15, 4:14] = 1
    values[14:20, 5:15, 4:14] = 4
    image = SimpleITK.GetImageFromArray(values.T)
    image.SetSpacing((2.0, 1.0, 1.5))
    image.SetDirection((-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0))
    image.SetOrigin((100.0, -50.0, 10.0))
    SimpleITK.WriteImage(image, tmp_path / "two.nrrd")
    return Subject("two", tmp_path / "two.nrrd")


def test_each_label_is_listed_with_its_volume(labelled):
    survey = survey_subject(labelled, GroomSettings())
    assert [(label.value, round(label.volume_ml, 6)) for label in survey.labels] == [(1, 1.8), (4, 1.8)]
    assert survey.awaits_choice  # they lie apart: not one structure


def test_a_closed_surface_has_a_volume_and_an_open_one_none(tmp_path):
    box = pv.Box((0.0, 10.0, 0.0, 10.0, 0.0, 10.0)).triangulate()
    open_ = box.remove_cells(np.flatnonzero(box.cell_normals[:, 2] > 0.5))
    for name, mesh, volume in (("closed", box, 1.0), ("open", open_, 0.0)):
        mesh.translate((300.0, -200.0, 900.0)).save(tmp_path / f"{name}.ply")
        survey = survey_subject(Subject(name, tmp_path / f"{name}.ply"), GroomSettings())
        assert survey.volume_ml == pytest.approx(volume)


def test_the_input_surface_lies_where_the_voxels_are(labelled):
    surface = survey_subject(labelled, GroomSettings(label=4)).surface
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    np.testing.assert_allclose(low, (100 - 39, -50 - 14.5, 10 + 3.5 * 1.5), atol=1e-4)
    np.testing.assert_allclose(high, (100 - 27, -50 - 4.5, 10 + 13.5 * 1.5), atol=1e-4)


def test_the_thumbnail_is_seen_from_the_front_with_the_patients_right_at_the_left(labelled):
    picture = survey_subject(labelled, GroomSettings(label=4)).thumbnail
    assert picture.shape == (64, 64)
    assert picture.max() > 200


def test_a_label_that_a_file_lacks_is_a_problem_in_words_without_the_path(labelled):
    survey = survey_subject(labelled, GroomSettings(label=3))
    assert survey.problem.startswith("Has no voxel")
    assert str(labelled.path) not in survey.problem
