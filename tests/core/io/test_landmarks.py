"""Landmarks of subjects: read, carried by the correspondence, used for the first particles."""

import shutil

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.correspondence import Shape
from homolog.errors import InputError
from homolog.grooming import check_cohort
from homolog.io.markups import write_markups
from homolog.io.meshes import read_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, surface_file
from homolog.run.landmarks import project_landmark_errors, with_landmarks
from homolog.settings import GroomSettings
from homolog.statistics.thin_plate import landmark_errors


@pytest.fixture
def scans(ellipsoids, tmp_path):
    """Return a copy of the ellipsoids."""
    shutil.copytree(ellipsoids, tmp_path / "scans")
    return tmp_path / "scans"


@pytest.fixture
def marked(finished_run, scans):
    """Return a function that copies the finished run, with given particles moved a little as landmarks."""

    def make(moved, names=("left", "right", "top"), leave_out=()):
        result = read_result(finished_run)
        for name, points in zip(result.names, result.local, strict=True):
            if name not in leave_out:
                write_markups(scans / f"{name}.mrk.json", points[[3, 11, 30]] + moved, names)
        shutil.copytree(finished_run.folder, scans.parent / "project")
        project = ProjectFolder(scans.parent / "project")
        record = project.read()
        project.write(record.model_copy(update={"subjects": project.describe(read_cohort(scans))}))
        return project

    return make


def test_landmarks_that_move_as_the_particles_do_are_carried_without_error():
    random = np.random.default_rng(0)
    shape = random.normal(scale=20.0, size=(80, 3))
    maps = [np.eye(3) + 0.1 * random.normal(size=(3, 3)) for _ in range(4)]
    points = random.normal(scale=10.0, size=(5, 3))
    particles = np.stack([shape @ item + 3.0 for item in maps])
    errors = landmark_errors(particles, np.stack([points @ item + 3.0 for item in maps]))
    others = ~np.eye(4, dtype=bool)
    assert np.abs(errors[others]).max() < 1e-6
    assert np.isnan(errors[~others]).all()


def test_an_error_is_the_distance_by_which_a_landmark_was_misplaced():
    particles = np.repeat(np.random.default_rng(1).normal(size=(1, 40, 3)), 3, axis=0)
    landmarks = np.zeros((3, 2, 3))
    landmarks[2, 1] = [3.0, 4.0, 0.0]
    landmarks[1, 0] = np.nan
    errors = landmark_errors(particles, landmarks)
    assert errors[0, 2] == pytest.approx([0.0, 5.0])
    assert np.isnan(errors[0, 1, 0])
    assert errors[1, 0, 1] == pytest.approx(0.0)
    assert np.isnan(errors[1, 0, 0])


def test_landmarks_lie_beside_the_file_or_where_the_table_says(scans, tmp_path):
    write_markups(scans / "a.mrk.json", np.eye(3))
    write_markups(tmp_path / "b.json", np.eye(3))
    assert [subject.landmarks for subject in read_cohort(scans).subjects] == [
        scans / "a.mrk.json",
        None,
        None,
        None,
    ]
    (scans / "cohort.csv").write_text("name,path,landmarks\na,a.nrrd,\nb,b.nrrd,../b.json\n")
    first, second = read_cohort(scans).subjects
    assert (first.landmarks, second.landmarks) == (scans / "a.mrk.json", scans / "../b.json")
    assert "landmarks" not in second.columns


def test_a_project_keeps_where_landmarks_are(marked, scans):
    project = marked(0.0)
    assert project.read().subjects[0].landmarks == "../scans/a.mrk.json"
    assert project.cohort().subjects[0].landmarks == scans.resolve() / "a.mrk.json"


def test_particles_as_landmarks_have_hardly_any_error(marked):
    result = project_landmark_errors(marked(0.0))
    assert result.names == ("left", "right", "top")
    assert result.subjects == ("a", "b", "c", "d")
    assert result.mean < 0.5  # mm; particles of a short run are not quite on the surface


def test_the_error_of_misplaced_landmarks_is_reported(marked):
    shifted = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    project = marked(shifted)
    result = read_result(project)
    write_markups(
        project.folder.parent / "scans" / "a.mrk.json", result.local[0, [3, 11, 31]], ("left", "right", "top")
    )
    actual = project_landmark_errors(project)
    assert actual.by_landmark.argmax() == 2
    assert actual.by_landmark[2] > 1.0


def test_landmarks_of_no_second_subject_make_no_error(marked):
    assert project_landmark_errors(marked(0.0, leave_out=("b", "c", "d"))) is None


def test_landmarks_in_another_frame_are_refused_by_name(marked):
    with pytest.raises(InputError, match=r"a\.mrk\.json: .* 1\d\d mm from .* of a"):
        project_landmark_errors(marked(100.0))


def test_a_bad_landmark_file_is_found_before_any_work(scans):
    (scans / "c.mrk.json").write_text("{}")
    (problem,) = check_cohort(read_cohort(scans), GroomSettings())
    assert problem.subject == "c"
    assert "c.mrk.json" in problem.message


@pytest.fixture
def shapes_of(finished_run):
    """Return the finished run's shapes, as far as landmarks need them."""
    record = finished_run.read().result
    shapes = []
    for subject in record.subjects:
        mesh = read_mesh(surface_file(finished_run, subject.file))
        shapes.append(Shape(subject.name, None, mesh, mesh, np.array(subject.alignment)))
    return shapes


def test_shapes_get_the_landmarks_that_all_subjects_have(marked, scans, shapes_of):
    marked(0.0)
    write_markups(
        scans / "a.mrk.json", read_result(ProjectFolder(scans.parent / "project")).local[0, [11, 3]], "rl"
    )
    with pytest.raises(InputError, match="on all subjects"):
        with_landmarks(shapes_of, read_cohort(scans))
    names = ("right", "left")
    write_markups(
        scans / "a.mrk.json", read_result(ProjectFolder(scans.parent / "project")).local[0, [11, 3]], names
    )
    result = with_landmarks(shapes_of, read_cohort(scans))
    assert {item.landmarks.shape for item in result} == {(2, 3)}
    assert np.allclose(
        result[1].landmarks[0], read_result(ProjectFolder(scans.parent / "project")).local[1, 11]
    )


def test_a_subject_without_landmarks_is_named(marked, scans, shapes_of):
    marked(0.0, leave_out=("c",))
    with pytest.raises(InputError, match="c: has no landmarks"):
        with_landmarks(shapes_of, read_cohort(scans))
