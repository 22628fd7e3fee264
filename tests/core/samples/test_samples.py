import csv

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.grooming.subject import groom_subject
from homolog.io.meshes import read_mesh
from homolog.samples import KINDS, make_study, write_study
from homolog.settings import GroomSettings
from homolog.surfaces.closest import distances_to
from homolog.surfaces.topology import check_mesh, euler_number

HANDLES = {"hearts": 0, "vertebrae": 1, "femora": 0}


@pytest.fixture(scope="module", params=list(KINDS))
def study(request):
    return make_study(request.param, 4, 1)


def test_surfaces_are_sound_and_share_their_faces(study):
    for subject in study.subjects:
        check_mesh(subject.mesh, subject.name)
        assert len(subject.mesh.vertices) == len(study.reference.vertices)
        assert euler_number(subject.mesh.faces) == 2 - 2 * HANDLES[study.kind]
        assert subject.mesh.volume > 0.0


def test_subjects_differ_and_the_same_seed_makes_the_same_ones(study):
    again = make_study(study.kind, 4, 1)
    other = make_study(study.kind, 4, 2)
    first, second = (subject.mesh.vertices for subject in study.subjects[:2])
    assert np.array_equal(first, again.subjects[0].mesh.vertices)
    assert np.abs(first - other.subjects[0].mesh.vertices).max() > 1.0
    assert np.ptp(first - second, axis=0).max() > 1.0


def test_the_effect_is_some_millimetres_in_places_and_nothing_elsewhere(study):
    effect = np.abs(study.effect)
    assert 2.0 < effect.max() < 10.0
    if study.kind != "hearts":  # whose cavity is wider all around
        assert np.median(effect) < 0.2


@pytest.fixture(scope="module")
def written(study, tmp_path_factory):
    folder = tmp_path_factory.mktemp(study.kind)
    return folder, write_study(folder, study, 1)


def test_files_are_a_cohort_with_groups_whose_truth_lies_beside_it(study, written):
    folder, cohort = written
    names = [subject.name for subject in cohort.subjects]
    assert len({subject.group for subject in read_cohort(folder).subjects}) == 2
    with (folder / "truth" / "parameters.csv").open(newline="") as file:
        assert [row["name"] for row in csv.DictReader(file)] == names
    for subject, made in zip(cohort.subjects, study.subjects, strict=True):
        assert subject.columns["age"] == made.columns["age"]
        truth = read_mesh(folder / "truth" / f"{subject.name}.ply")
        assert np.allclose(truth.vertices, made.mesh.vertices, atol=1e-3)


def test_a_written_subject_grooms_to_its_true_surface(study, written):
    _, cohort = written
    groomed = groom_subject(cohort.subjects[0], GroomSettings())
    off = distances_to(study.subjects[0].mesh, groomed.mesh.vertices)
    assert groomed.report.genus == HANDLES[study.kind]
    assert np.mean(off) < 0.5


@pytest.mark.parametrize("values", [("cats", 8, 1), ("hearts", 3, 1), ("hearts", 8, -1)])
def test_what_cannot_be_made_is_refused(values):
    with pytest.raises(InputError):
        make_study(*values)


def test_a_right_femur_has_its_head_in_front_and_its_lesser_trochanter_behind():
    points = make_study("femora", 4, 1).reference.vertices  # x to the left, y backward
    innermost = points[points[:, 0].argmax()]
    below_the_neck = points[np.abs(points[:, 2] + 16.0) < 4.0]
    hindmost = below_the_neck[below_the_neck[:, 1].argmax()]
    assert innermost[1] < -5.0
    assert hindmost[0] > 10.0
