import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.surfaces.distance_field import DistanceField

TURN = Rotation.from_rotvec([0.4, -0.2, 0.9]).as_matrix()
CENTRE = np.array([5.0, -3.0, 12.0])


@pytest.fixture(scope="module")
def field():
    """A sphere of 9 mm on a turned grid of 0.8 mm."""
    affine = np.eye(4)
    affine[:3, :3] = 0.8 * TURN
    affine[:3, 3] = CENTRE - 0.8 * TURN @ [16.0, 16.0, 16.0]
    index = np.stack(np.meshgrid(*[np.arange(33.0)] * 3, indexing="ij"), axis=-1)
    return DistanceField(np.linalg.norm(0.8 * (index - 16.0), axis=-1) - 9.0, affine)


@pytest.fixture(scope="module")
def points():
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return CENTRE + directions * np.linspace(8.0, 10.0, 500)[:, None]


def test_values_and_gradients_are_those_of_the_sphere_in_world_axes(field, points):
    values, slopes = field.sample_values(points), field.gradients(points)
    radius = np.linalg.norm(points - CENTRE, axis=1)
    assert np.abs(values - (radius - 9.0)).max() < 0.03
    assert np.abs(slopes - (points - CENTRE) / radius[:, None]).max() < 0.02


def test_projected_points_lie_on_the_zero_level(field, points):
    projected = field.projected(points)
    assert np.abs(field.sample_values(projected)).max() < 1e-3
    assert np.abs(np.linalg.norm(projected - points, axis=1)).max() < 1.05


def test_points_far_outside_get_the_border_value(field):
    assert field.sample_values(np.array([[500.0, 0.0, 0.0]]))[0] > 0.0


def test_spacing_and_read_only_arrays_survive_pickling(field):
    again = pickle.loads(pickle.dumps(field))
    assert again.spacing == pytest.approx(0.8)
    assert np.array_equal(again.values, field.values)
    with pytest.raises(ValueError, match="read-only"):
        again.values[0, 0, 0] = 1.0
