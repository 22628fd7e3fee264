import tracemalloc

import numpy as np
import pytest
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.transform import Rotation

from homolog.registration.icp import OrientedPoints
from homolog.registration.typicality import by_typicality, radii_of, similar_pairs, typical_rotation


def clouds(count, seed=0):
    random = np.random.default_rng(seed)
    points = random.normal(size=(count, 30, 3)) * (1.0 + random.random((count, 1, 3)))
    return [OrientedPoints(item, item, np.zeros(3), 1.0) for item in points]


def test_the_most_typical_shape_has_the_least_difference_of_radii_from_all():
    shapes = clouds(40)
    radii = radii_of(shapes)
    sums = np.abs(radii[:, None] - radii).sum(axis=(1, 2))
    np.testing.assert_array_equal(by_typicality(shapes), np.argsort(sums, kind="stable"))


@pytest.mark.parametrize("count", [2, 7, 60, 150])
def test_similar_pairs_are_the_spanning_tree_and_the_nearest_shapes(count):
    radii = radii_of(clouds(count, seed=count))
    apart = np.abs(radii[:, None] - radii).sum(axis=2) + 1e-6
    linked = minimum_spanning_tree(apart).toarray() > 0.0
    nearest = np.argsort(apart, axis=1, kind="stable")[:, : max(4, 56 // count) + 1]
    np.put_along_axis(linked, nearest, True, axis=1)
    expected = np.argwhere(np.triu(linked | linked.T, 1))
    np.testing.assert_array_equal(similar_pairs(radii, 0), expected)


def test_two_kinds_of_many_shapes_are_connected():
    radii = np.concatenate([np.random.default_rng(0).random((100, 25)), 50.0 + np.eye(100, 25)])
    pairs = similar_pairs(radii, 3)
    assert sum(first < 100 <= second for first, second in pairs) == 1


def test_comparing_thousands_of_shapes_needs_little_memory():
    shapes = clouds(2000)
    tracemalloc.start()
    similar_pairs(radii_of(shapes), int(by_typicality(shapes)[0]))
    assert tracemalloc.get_traced_memory()[1] < 60e6  # all pairs of radii are 800 MB
    tracemalloc.stop()


def test_the_typical_rotation_of_many_is_that_of_most():
    turns = Rotation.from_rotvec(np.random.default_rng(0).normal(scale=0.02, size=(1000, 3)))
    turned = np.tile(np.eye(4), (1000, 1, 1))
    turned[:, :3, :3] = turns.as_matrix()
    turned[::4, :3, :3] = Rotation.random(250, random_state=0).as_matrix()
    assert typical_rotation(turned).magnitude() < 0.1
