"""Similarities and points spread over a cloud."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.geometry import (
    farthest_point_sampling,
    fit_rotation,
    fit_similarity,
    inverse_matrices,
    rms_radius,
    transform_points,
)


@pytest.fixture
def random():
    """Return a generator."""
    return np.random.default_rng(4)


def similarity_of(random, *, scale=1.0, mirrored=False):
    """Return a random similarity (4, 4)."""
    matrix = np.eye(4)
    turn = Rotation.random(random_state=random.integers(1000)).as_matrix()
    matrix[:3, :3] = scale * turn @ np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
    matrix[:3, 3] = random.normal(scale=50.0, size=3)
    return matrix


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_the_similarity_that_moved_points_is_found(random, scale, mirrored):
    points = random.normal(size=(9, 3))
    matrix = similarity_of(random, scale=scale, mirrored=mirrored)
    result = fit_similarity(points, transform_points(matrix, points), scaling=scale != 1.0, mirrored=mirrored)
    np.testing.assert_allclose(result, matrix, atol=1e-12)


def test_no_other_rotation_comes_nearer(random):
    points, targets = random.normal(size=(2, 20, 3))
    result = fit_similarity(points, targets, scaling=False)
    assert np.linalg.det(result[:3, :3]) == pytest.approx(1.0)

    def error(matrix):
        return np.square(transform_points(matrix, points) - targets).sum()

    for _ in range(50):
        other = result.copy()
        other[:3, :3] = Rotation.from_rotvec(random.normal(scale=0.05, size=3)).as_matrix() @ result[:3, :3]
        assert error(other) > error(result)


def test_points_without_extent_keep_their_size():
    points = np.ones((4, 3))
    np.testing.assert_array_equal(fit_similarity(points, points + 2.0, scaling=True)[:3, 3], [2.0, 2.0, 2.0])


def test_many_rotations_at_once_are_those_of_each(random):
    covariances = random.normal(size=(6, 3, 3))
    left, right, overlap = fit_rotation(covariances)
    for k, covariance in enumerate(covariances):
        first = fit_rotation(covariance)
        np.testing.assert_allclose(left[k] @ right[k], first[0] @ first[1], atol=1e-12)
        assert overlap[k] == pytest.approx(np.sum(covariance * (left[k] @ right[k])))


def test_each_set_of_points_is_mapped_by_its_own_matrix_and_back(random):
    matrices = np.stack([similarity_of(random, scale=2.0) for _ in range(3)])
    points = random.normal(size=(3, 5, 3))
    mapped = transform_points(matrices, points)
    for k in range(3):
        homogeneous = np.column_stack([points[k], np.ones(5)])
        np.testing.assert_allclose(mapped[k], (homogeneous @ matrices[k].T)[:, :3], atol=1e-12)
    np.testing.assert_allclose(transform_points(inverse_matrices(matrices), mapped), points, atol=1e-12)


def test_a_sphere_has_its_radius(unit_sphere):
    points = unit_sphere(500)[0]
    assert rms_radius(3.0 * points + 7.0) == pytest.approx(3.0, rel=1e-4)
    assert rms_radius(np.stack([points, 2.0 * points])).shape == (2,)


def test_each_point_is_the_farthest_from_those_before(random):
    points = random.normal(size=(60, 3))
    chosen = farthest_point_sampling(points, 10, begin=[5, 7])
    assert chosen[:2].tolist() == [5, 7]
    for count in range(2, 10):
        gaps = np.linalg.norm(points[:, None] - points[chosen[:count]], axis=2).min(axis=1)
        assert chosen[count] == gaps.argmax()
