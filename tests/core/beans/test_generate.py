import numpy as np
import pytest
from scipy import stats

from homolog.beans.generate import NARROW, WIDE, Bean, draw_beans, draw_moments, voxelize
from homolog.beans.surface import closest_on_bean


@pytest.mark.parametrize(("seed", "moments"), [(5, (6.90, 1.92, -0.08)), (12, (6.70, 2.06, 0.15))])
def test_published_seeds_have_their_published_moments(seed, moments):
    np.testing.assert_allclose(draw_moments(draw_beans(10, seed)), moments, atol=0.005)


def test_the_same_seed_draws_the_same_cohort_and_another_seed_another():
    assert draw_beans(6, 3) == draw_beans(6, 3)
    assert draw_beans(6, 3) != draw_beans(6, 4)


@pytest.mark.parametrize("geometry", [WIDE, NARROW])
def test_draws_have_the_papers_distributions(geometry):
    beans = draw_beans(4000, 0, geometry)
    position = np.array([bean.position for bean in beans])
    width = np.array([bean.width for bean in beans])
    assert np.abs(position).max() <= 10.0
    np.testing.assert_allclose(position.std(), 20.0 / np.sqrt(12.0), rtol=0.03)
    assert width.min() >= geometry.width_range[0]
    assert width.max() <= geometry.width_range[1]
    low, high = (np.array(geometry.width_range) - 8.0) / 2.0
    np.testing.assert_allclose(width.mean(), 8.0, rtol=0.01)
    np.testing.assert_allclose(width.std(), stats.truncnorm(low, high, 8.0, 2.0).std(), rtol=0.03)


def test_width_is_the_semi_axis_in_wide_and_the_full_width_in_narrow_beans():
    assert Bean(WIDE, 0.0, 8.0).slot_axes[1] == 8.0
    assert Bean(NARROW, 0.0, 8.0).slot_axes[1] == 4.0


def test_voxels_are_inside_where_the_exact_surface_says_so():
    bean = Bean(WIDE, 4.3, 6.1)
    inside, index_to_world = voxelize(bean)
    index = np.argwhere(np.ones_like(inside))
    points = index @ index_to_world[:3, :3].T + index_to_world[:3, 3]
    near = np.random.default_rng(0).choice(len(points), 5000, replace=False)
    distance = closest_on_bean(points[near], bean).distance
    np.testing.assert_array_equal(distance <= 0.0, inside[tuple(index[near].T)])


def test_volumes_are_padded_and_a_mirrored_slot_gives_a_mirrored_volume():
    left, _ = voxelize(Bean(WIDE, -7.0, 8.0))
    right, _ = voxelize(Bean(WIDE, 7.0, 8.0))
    np.testing.assert_array_equal(left, right[:, ::-1])
    filled = np.argwhere(left)
    assert filled.min(axis=0).tolist() == [6, 6, 6]
    assert (np.array(left.shape) - 1 - filled.max(axis=0))[:2].tolist() == [6, 6]
