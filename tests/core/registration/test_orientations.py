"""Which way round shapes lie: what the files of a cohort say."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.registration.closest_points import Fit
from homolog.registration.orientations import Files


def registered(angles):
    """Return registrations that turn by given angles [degrees], each about its own axis."""
    axes = np.random.default_rng(0).normal(size=(len(angles), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(angles), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(np.radians(angles)[:, None] * axes).as_matrix()
    return [Fit(pose, 0.1) for pose in poses]


def test_a_turn_costs_more_where_files_lie_alike_and_hardly_anything_where_they_lie_in_any_way():
    files = [[0, 1, 2, 3, 4], [0, 20, 30, 35, 40], [0, 90, 120, 150, 170]]
    turned = registered([0, 178])
    costs = [np.ptp(Files.of(registered(angles)).costs(turned)) for angles in files]
    assert costs[0] > 1.2 > costs[1] > 0.6 > 0.3 > costs[2]


def test_a_file_that_lies_as_far_off_as_others_do_is_not_taken_for_a_turned_one():
    files = Files.of(registered([0, 20, 30, 35, 40]))
    near, far, turned = files.costs(registered([0, 40, 178]))
    assert far - near < 0.5 * (turned - near)


def test_one_turned_file_does_not_make_the_others_lie_apart():
    alike = Files.of(registered([0, 6, 8, 10, 12]))
    with_one = Files.of(registered([0, 6, 8, 10, 12, 180]))
    assert with_one.spread == pytest.approx(alike.spread, rel=0.3)
