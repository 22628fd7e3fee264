import numpy as np
import pytest
from scipy import ndimage

from homolog.surfaces.redistance import redistanced


@pytest.fixture(scope="module")
def points():
    return np.stack(np.meshgrid(*[np.arange(-24.0, 25.0)] * 3, indexing="ij"), axis=-1) + np.array(
        [0.13, -0.27, 0.4]
    )


def test_a_quadric_of_a_sphere_becomes_its_distance(points):
    radius = np.linalg.norm(points, axis=-1)
    distance = redistanced((radius / 15.0) ** 2 - 1.0)
    error = np.abs(distance - (radius - 15.0))
    near = np.abs(radius - 15.0) < 4.0
    assert error[near].mean() < 0.02
    assert error[near].max() < 0.05
    assert error.mean() < 0.02


def test_a_plane_across_the_grid_is_exact(points):
    normal = np.array([2.0, 3.0, 6.0]) / 7.0
    exact = points @ normal
    near = (np.abs(exact) < 8.0) & (np.abs(points) < 14.0).all(axis=-1)  # away from where it leaves the grid
    assert np.abs(redistanced(5.0 * exact) - exact)[near].max() < 0.02


def test_second_order_is_several_times_as_accurate_as_first(points):
    exact = np.linalg.norm(points, axis=-1) - 15.0
    errors = [
        np.abs(redistanced(exact, second_order=order) - exact)[np.abs(exact) < 8.0].mean()
        for order in (False, True)
    ]
    assert errors[1] < 0.25 * errors[0]


def test_the_gradient_has_length_one(points):
    level = redistanced(((points / [18.0, 12.0, 9.0]) ** 2).sum(axis=-1) - 1.0)
    length = np.linalg.norm(np.stack(np.gradient(level)), axis=0)
    outside = (level > -3.0) & (level < 4.0)
    assert np.abs(length[outside] - 1.0).mean() < 0.01


def test_signs_stay(points):
    rough = np.sin(points[..., 0]) + np.cos(1.3 * points[..., 1]) + points[..., 2] / 10.0
    assert np.array_equal(redistanced(rough) < 0.0, rough < 0.0)


def test_it_is_nearer_to_the_truth_than_the_transform_of_the_binary_volume(points):
    exact = np.linalg.norm(points, axis=-1) - 15.0
    inside = exact < 0.0
    binary = np.where(
        inside, 0.5 - ndimage.distance_transform_edt(inside), ndimage.distance_transform_edt(~inside) - 0.5
    )
    near = np.abs(exact) < 3.0
    ours = np.abs(redistanced((exact + 15.0) ** 2 - 225.0) - exact)[near].mean()
    assert ours < 0.2 * np.abs(binary - exact)[near].mean()


def test_the_same_input_gives_the_same_bits(points):
    level = np.linalg.norm(points, axis=-1) - 15.0
    assert np.array_equal(redistanced(level), redistanced(level))


def test_a_two_node_gap_between_two_solids_is_resolved():
    x = np.arange(40.0)[:, None, None] * np.ones((40, 12, 12))
    exact = 2.5 - np.abs(x - 20.0)
    assert np.abs(redistanced(exact) + np.abs(x - 20.0) - 2.5)[10:30].max() < 0.01


@pytest.mark.timeout(60)
@pytest.mark.parametrize("scale", [0.0, 0.7, 2.0])
def test_it_ends_on_noise_where_fronts_meet_everywhere(scale):
    """Second differences alone made values swing for ever here."""
    noise = ndimage.gaussian_filter(np.random.default_rng(0).normal(size=(40, 40, 40)), scale)
    distance = redistanced(noise)
    assert np.isfinite(distance).all()
    assert np.abs(distance).max() < 40.0


def test_within_reach_distances_are_the_same_and_beyond_it_they_go_on_growing(points):
    level = ((points / [18.0, 12.0, 9.0]) ** 2).sum(axis=-1) - 1.0
    whole, near = redistanced(level), redistanced(level, reach=4)
    assert np.array_equal(near < 0.0, whole < 0.0)
    band = np.abs(whole) < 2.0
    assert np.abs(whole - near)[band].max() < 0.01
    assert np.abs(whole - near).max() < 4.0
    far = np.abs(whole) > 8.0
    assert np.abs(near)[far].min() > 4.0
