import tracemalloc

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.registration.icp import OrientedPoints
from homolog.registration.typicality import by_typicality, radii_of, typical_rotation


def clouds(count, seed=0):
    random = np.random.default_rng(seed)
    points = random.normal(size=(count, 30, 3)) * (1.0 + random.random((count, 1, 3)))
    return [OrientedPoints(item, item, np.zeros(3), 1.0) for item in points]


def test_the_most_typical_shape_has_the_least_difference_of_radii_from_all():
    shapes = clouds(40)
    radii = radii_of(shapes)
    sums = np.abs(radii[:, None] - radii).sum(axis=(1, 2))
    np.testing.assert_array_equal(by_typicality(shapes), np.argsort(sums, kind="stable"))


def test_comparing_thousands_of_shapes_needs_little_memory():
    shapes = clouds(2000)
    tracemalloc.start()
    by_typicality(shapes)
    assert tracemalloc.get_traced_memory()[1] < 60e6  # all pairs of radii are 800 MB
    tracemalloc.stop()


def test_the_typical_rotation_of_many_is_that_of_most():
    turns = Rotation.from_rotvec(np.random.default_rng(0).normal(scale=0.02, size=(1000, 3)))
    turned = np.tile(np.eye(4), (1000, 1, 1))
    turned[:, :3, :3] = turns.as_matrix()
    turned[::4, :3, :3] = Rotation.random(250, random_state=0).as_matrix()
    assert typical_rotation(turned).magnitude() < 0.1
