"""Poses of structures against each other, apart from their shapes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.statistics.procrustes import align
from homolog.statistics.relative_pose import relative_poses

RANDOM = np.random.default_rng(3)
ANGLES = RANDOM.normal(0.0, 12.0, 12)
SIZES = RANDOM.normal(0.0, 0.08, 12)


def structure(axes, centre):
    points = RANDOM.normal(size=(80, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * axes + centre


def about(axis, degrees):
    return Rotation.from_euler(axis, np.asarray(degrees)[:, None], degrees=True)


@pytest.fixture(scope="module")
def two():
    """Return a structure that grows, and one beside it that turns about the axis z, all lying anywhere."""
    first = structure((20.0, 14.0, 9.0), (0.0, 0.0, 0.0))
    second = structure((8.0, 30.0, 11.0), (0.0, 40.0, 0.0))
    grown = first * (1.0 + SIZES)[:, None, None]
    turned = np.stack([turn.apply(second) for turn in about("z", ANGLES)])
    lying, shifts = about("x", RANDOM.normal(0.0, 20.0, 12)), RANDOM.normal(size=(12, 3))
    return [
        np.stack([turn.apply(item) + shift for turn, item, shift in zip(lying, items, shifts, strict=True)])
        for items in (grown, turned)
    ]


def test_angles_are_those_by_which_a_structure_was_turned(two):
    poses = relative_poses(two, ["first", "second"])
    turned = poses.rotations[:, 1]
    angles = turned @ np.linalg.svd(turned)[2][0]
    expected = ANGLES - ANGLES.mean()
    assert np.allclose(angles * np.sign(angles @ expected), expected, atol=0.05)
    assert np.allclose(poses.rotations[:, 0], 0.0, atol=1e-9)


def test_each_variance_is_where_it_belongs(two):
    poses = relative_poses(two, ["first", "second"])
    components = poses.components()
    assert components.parts == ("pose second", "shape first", "shape second")
    share = dict(zip(components.parts, components.variances / components.variances.sum(), strict=True))
    assert share["shape second"] < 1e-6
    assert share["pose second"] > 0.5
    assert np.isclose(np.square(components.standard_deviations).sum(), components.variances.sum())
    assert np.allclose(components.shares.sum(axis=1), 1.0)


def test_shapes_do_not_know_the_pose(two):
    turned = relative_poses(two, ["first", "second"])
    straight = relative_poses([two[0], align(two[1], scaling=False)], ["first", "second"])
    assert np.allclose(turned.forms[1].var(axis=0).sum(), straight.forms[1].var(axis=0).sum(), atol=1e-9)


def test_sizes_are_relative_to_those_of_the_reference(two):
    poses = relative_poses(two, ["first", "second"])
    expected = (1.0 + SIZES) / np.exp(np.log(1.0 + SIZES).mean())
    assert np.allclose(poses.sizes[:, 0], expected)
    assert np.allclose(poses.sizes[:, 1], 1.0 / expected)


def test_the_moved_mean_has_the_pose_of_the_structure_only(two):
    poses = relative_poses(two, ["first", "second"])
    again = relative_poses([poses.forms[0].mean(axis=0)[None].repeat(12, 0), poses.moved("second")], "ab")
    angles = [np.linalg.norm(item.rotations[:, 1], axis=1) for item in (again, poses)]
    assert np.allclose(*angles, atol=0.1)
    assert np.allclose(again.forms[1].var(axis=0), 0.0, atol=1e-9)
