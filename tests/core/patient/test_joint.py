"""Patients with several structures: each against its own reference, and how they lie to each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.core.patient.test_patient import AGE, patient

from homolog.errors import InputError
from homolog.patient import JointReference, compare_groomed, compare_joint_patient, read_reference
from homolog.patient.findings import findings, pose_rows, reference_text
from homolog.patient.joint import PoseNorm


def poses(random, count, turn=3.0, shift=2.0):
    """Return relative poses that vary by degrees and millimetres about 60 mm to the feet."""
    result = np.tile(np.eye(4), (count, 1, 1))
    turns = Rotation.from_rotvec(random.normal(scale=turn, size=(count, 3)), degrees=True)
    result[:, :3, :3] = turns.as_matrix()
    result[:, :3, 3] = np.array([0.0, 0.0, -60.0]) + random.normal(scale=shift, size=(count, 3))
    return result


@pytest.fixture(scope="module")
def joint(reference):
    """Return a reference of two structures that have the same shapes."""
    norm = PoseNorm.of("tibia", "femur", poses(np.random.default_rng(4), 24), np.zeros((24, 1)), np.zeros(3))
    return JointReference({"femur": reference, "tibia": reference}, (norm,))


def placed(subject, reference, pose):
    """Return a groomed subject where a pose puts it, relative to where the reference would lie."""
    back = compare_groomed(reference, subject, AGE).placement
    return replace(subject, mesh=subject.mesh.placed(pose @ back))


@pytest.fixture(scope="module")
def turned(joint, reference, template):
    """Return a patient whose tibia is turned by 20° about the left axis beyond the usual."""
    usual = joint.poses[0].expected(np.zeros(1))
    pose = usual.copy()
    pose[:3, :3] = Rotation.from_rotvec((20.0, 0.0, 0.0), degrees=True).as_matrix() @ usual[:3, :3]
    parts = {
        "femur": placed(patient(template), reference, np.eye(4)),
        "tibia": placed(patient(template, seed=12), reference, pose),
    }
    return compare_joint_patient(joint, parts, AGE)


def test_a_turned_structure_is_told_from_its_shape(turned, joint, reference, template):
    (pose,) = turned.poses
    assert pose.rotation == pytest.approx([20.0, 0.0, 0.0], abs=0.5)
    assert pose.distance < 0.5
    assert pose.turn.percent == 100.0
    assert pose.shift.percent < 50.0
    alone = compare_groomed(reference, patient(template, seed=12), AGE)
    assert turned.structures["tibia"].measures.outside == pytest.approx(alone.measures.outside, rel=0.02)
    assert len(findings(turned, joint)) == 3
    assert [row[0] for row in pose_rows(turned)] == [
        "Turn of tibia against femur",
        "Shift of tibia against femur",
    ]


def test_a_reference_of_several_structures_is_kept_in_one_file(joint, turned, tmp_path):
    joint.save(tmp_path / "knees.npz")
    again = read_reference(tmp_path / "knees.npz")
    assert [own.fingerprint for own in again.structures.values()] == [
        own.fingerprint for own in joint.structures.values()
    ]
    assert np.array_equal(again.poses[0].covariances, joint.poses[0].covariances)
    assert reference_text(again) == reference_text(joint)
    with pytest.raises(InputError, match="several structures"):
        type(joint.first).load(tmp_path / "knees.npz")


def test_a_structure_that_a_patient_lacks_is_named_and_the_others_are_compared(joint, template):
    comparison = compare_joint_patient(joint, {"femur": patient(template)}, AGE)
    assert list(comparison.structures) == ["femur"]
    assert list(comparison.problems) == ["tibia"]
    assert not comparison.poses
    with pytest.raises(InputError, match=r"femur: .*\ntibia: "):
        compare_joint_patient(joint, {}, AGE)


def test_percentiles_of_poses_are_those_of_healthy_people():
    random, beyond = np.random.default_rng(5), []
    for _ in range(400):
        relative = poses(random, 16)
        norm = PoseNorm.of("tibia", "femur", relative[1:], np.zeros((15, 0)), np.zeros(3))
        turn, shift = norm.distances(relative[0], np.zeros(0))
        beyond.append([turn > norm.turns[-1], shift > norm.shifts[-1]])
    assert np.mean(beyond, axis=0) == pytest.approx([1 / 16, 1 / 16], abs=0.035)
