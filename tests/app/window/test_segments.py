"""Files that name their segments, as the window shows them."""

import numpy as np
import pytest

from homolog.cohort import Subject
from homolog.settings import GroomSettings
from homolog_app.scenes.file_survey import survey_subject


@pytest.fixture
def folder(tmp_path):
    """Return a folder with two files of overlapping segments, whose values differ from file to file."""
    for name, (heart, lung) in (("x", (1, 2)), ("y", (2, 1))):
        layers = np.zeros((2, 20, 20, 20), np.uint8)
        layers[0, 3:12, 3:12, 3:12] = heart
        layers[1, 8:17, 8:17, 8:16] = lung
        header = (
            "NRRD0004\ntype: uchar\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 20 20 20\n"
            "space directions: none (1,0,0) (0,1,0) (0,0,1)\nkinds: list domain domain domain\n"
            "encoding: raw\nspace origin: (0,0,0)\n"
            f"Segment0_Name:=heart\nSegment0_LabelValue:={heart}\nSegment0_Layer:=0\n"
            f"Segment1_Name:=lung\nSegment1_LabelValue:={lung}\nSegment1_Layer:=1\n\n"
        )
        (tmp_path / f"{name}.seg.nrrd").write_bytes(header.encode() + layers.transpose(1, 2, 3, 0).tobytes())
    return tmp_path


def test_segments_are_listed_by_name_though_they_overlap(folder):
    survey = survey_subject(Subject("x", folder / "x.seg.nrrd"), GroomSettings())
    assert [(label.name, label.value, round(label.volume_ml, 6)) for label in survey.labels] == [
        ("heart", 1, 0.729),
        ("lung", 2, 0.648),
    ]
    assert survey.awaits_choice
    assert "overlap" in survey.problem


@pytest.mark.window
def test_a_segment_is_picked_by_its_name_whatever_its_value(window, folder, wait):
    window.projects.open_paths([folder])
    session, picker = window.workspace.session, window.inspector.cohort.labels
    wait(lambda: len(session.surveys) == 2)
    assert [member.name for member in session.study.members] == ["x", "y"]
    assert all(member.included for member in session.study.members)
    assert picker.isVisibleTo(window)
    texts = [picker.choice.itemText(index) for index in range(picker.choice.count())]
    assert texts[1] == "heart · 0.729 ml"  # in all subjects
    picker.choice.setCurrentIndex(picker.choice.findData("lung"))
    picker.choice.activated.emit(picker.choice.currentIndex())
    assert session.study.settings.groom.segment == "lung"
    wait(lambda: all(not survey.problem for survey in session.surveys.values()))
    assert {round(survey.volume_ml, 6) for survey in session.surveys.values()} == {0.648}


@pytest.mark.window
def test_the_views_are_fitted_to_a_small_structure_that_is_chosen(window, tmp_path, wait):
    import SimpleITK

    voxels = np.zeros((30, 30, 30), np.uint8)
    voxels[2:28, 2:28, 2:28], voxels[6:10, 6:10, 6:10] = 1, 2
    for name in "ab":
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(voxels), tmp_path / f"{name}.nrrd")
    window.projects.open_paths([tmp_path])
    session, scene = window.workspace.session, window.views.stage.scene
    picker = window.inspector.cohort.labels
    wait(lambda: len(session.surveys) == 2)
    (camera, *_) = scene.grid.cameras.each
    before = camera.GetParallelScale()
    picker.choice.setCurrentIndex(picker.choice.findData("2"))
    picker.choice.activated.emit(picker.choice.currentIndex())
    wait(lambda: camera.GetParallelScale() < 0.5 * before, 10.0)
