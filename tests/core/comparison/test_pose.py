"""Questions about the pose of a structure."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.comparison.ask import ask
from homolog.comparison.pose import NUMBERS, PoseSample
from homolog.comparison.question import questions
from homolog.comparison.stored import stored_answers, stored_poses
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.io.results import Part, Result
from homolog.surfaces.mesh import TriangleMesh

RANDOM = np.random.default_rng(5)
GROUPS = 10 * ["plain"] + 10 * ["turned"]
ANGLES = RANDOM.normal(0.0, 3.0, 20) + np.where(np.array(GROUPS) == "turned", 12.0, 0.0)
SIZES = 1.0 + RANDOM.normal(0.0, 0.08, 20)


@pytest.fixture(scope="module")
def result():
    """Return a fixed structure that grows, and one beside it that one of the groups has turned by 12°."""
    first, second = (RANDOM.normal(size=(40, 3)) * axes for axes in ([20.0, 14.0, 9.0], [8.0, 30.0, 11.0]))
    wobbles = np.random.default_rng(6).normal(0.0, 0.3, (20, 3))
    turns = Rotation.from_euler("z", ANGLES[:, None], degrees=True)
    turns = Rotation.from_rotvec(wobbles, degrees=True) * turns
    shifts = np.array([0.0, 60.0, 0.0]) + RANDOM.normal(0.0, 0.5, (20, 3))
    world = np.array(
        [
            np.concatenate([first * size, turn.apply(second - second.mean(axis=0)) + shift])
            for size, turn, shift in zip(SIZES, turns, shifts, strict=True)
        ]
    )
    none = slice(0, 0)
    return Result(
        tuple(f"s{k}" for k in range(20)),
        tuple(GROUPS),
        20 * ({},),
        world,
        world,
        np.tile(np.eye(4), (20, 1, 1)),
        TriangleMesh(np.eye(3), np.array([[0, 1, 2]])),
        np.zeros(80),
        parts=(Part("first", slice(0, 40), none), Part("second", slice(40, 80), none)),
    )


def test_a_turn_is_told_in_degrees_and_apart_from_the_shift(result):
    poses = PoseSample.of(result, "second")
    (question,) = questions(
        ["as-it-lies"], kind="groups", column="group", between=("plain", "turned"), permutations=499
    )
    answer = ask(poses.sample, question)
    turn, shift = answer.overall.p_fwe
    assert turn < 0.01
    assert shift > 0.05
    text = poses.text(answer)
    assert "Pose of second against first" in text
    expected = np.mean(ANGLES[10:]) - np.mean(ANGLES[:10])
    told = float(text.split("turn ")[1].split("°")[0])
    assert told == pytest.approx(expected, abs=0.6)


def test_turn_and_shift_sum_to_the_displacement_of_the_particles(result):
    poses = PoseSample.of(result, "second").poses
    moved = poses.moved("second")
    far = np.square(moved - moved.mean(axis=0)).sum(axis=2).mean(axis=1)
    own = np.square(poses.displacements("second")).sum(axis=(1, 2))
    assert np.allclose(far, own, rtol=0.03, atol=0.02)


def test_poses_are_asked_about_by_formula_and_stored_apart_from_shapes(result, tmp_path):
    ages = tuple({"age": str(40 + 3 * (k % 7))} for k in range(20))
    poses = PoseSample.of(replace(result, columns=ages), "second")
    given = {"kind": "formula", "column": "", "formula": "~ group + age", "modes": NUMBERS}
    (question,) = questions(["as-it-lies"], permutations=199, pose="second", **given)
    answer = ask(poses.sample, question)
    project = ProjectFolder(tmp_path)
    project.write(ProjectRecord())
    folder = poses.store(project, answer)
    with (folder / "pose.csv").open() as stream:
        rows = {row["comparison"]: row for row in csv.DictReader(stream)}
    assert float(rows["group: turned - plain"]["p_turn"]) < 0.05 < float(rows["age"]["p_turn"])
    assert float(rows["group: turned - plain"]["turn_degrees"]) == pytest.approx(12.0, abs=3.0)
    assert [item.question for item in stored_poses(project)] == [question]
    assert stored_answers(project) == ([], [])
    assert poses.store(project, answer) == folder


def test_what_has_no_pose_is_refused(result):
    with pytest.raises(InputError, match="those of second against first"):
        PoseSample.of(result, "first")
    with pytest.raises(InputError, match="of first against second"):
        PoseSample.of(result, "third", "second")
