import numpy as np
import pytest
from scipy import ndimage
from skimage.measure import find_contours

from homolog.grooming.antialias import antialiased, near_distance, smoothed
from homolog.surfaces.isosurface import marching_cubes


def test_every_voxel_stays_on_its_side(grid):
    mask = np.linalg.norm(grid(12.0) - [0.1, 0.2, 0.3], axis=-1) < 8.3
    level = antialiased(mask)
    assert np.array_equal(level < 0.0, mask)


def test_a_sphere_is_met_within_a_twentieth_of_a_voxel(grid):
    centre = np.array([0.13, 0.27, 0.41])
    points = grid(17.0)
    vertices, _ = marching_cubes(antialiased(np.linalg.norm(points - centre, axis=-1) < 12.0))
    error = np.linalg.norm(vertices + points[0, 0, 0] - centre, axis=1) - 12.0
    assert np.abs(error).mean() < 0.05
    assert np.percentile(np.abs(error), 95) < 0.12
    assert abs(error.mean()) < 0.01


def test_a_wall_of_two_voxels_stays_whole(grid):
    radius = np.linalg.norm(grid(18.0) - [0.13, 0.27, 0.41], axis=-1)
    vertices, faces = marching_cubes(antialiased((radius < 13.0) & (radius > 11.0)))
    assert len(vertices) - len(faces) // 2 == 2


def test_a_single_voxel_does_not_vanish():
    mask = np.zeros((7, 7, 7), bool)
    mask[3, 3, 3] = True
    assert antialiased(mask)[3, 3, 3] < 0.0


def test_a_disc_in_a_slice_is_met_too():
    y, x = np.mgrid[-15:16, -15:16]
    (contour,) = find_contours(antialiased(np.hypot(x - 0.13, y - 0.27) < 10.0), 0.0)
    radius = np.hypot(*(contour - [15.27, 15.13]).T)
    assert radius.mean() == pytest.approx(10.0, abs=0.05)
    assert np.abs(radius - 10.0).max() < 0.3


def test_without_smoothing_the_distance_of_the_voxels_remains():
    mask = np.zeros((9, 9), bool)
    mask[2:7, 2:7] = True
    assert antialiased(mask, 0.0)[4].tolist() == [1.5, 0.5, -0.5, -1.5, -2.5, -1.5, -0.5, 0.5, 1.5]


def test_smoothing_keeps_cubics_and_dampens_noise():
    x = np.linspace(-1.0, 1.0, 81)
    cubic = (x**3 - 0.5 * x**2)[:, None] * np.ones(81)
    assert np.allclose(smoothed(cubic, 1.0)[20:-20], cubic[20:-20], atol=1e-6)
    noise = np.random.default_rng(1).normal(size=(64, 64))
    assert smoothed(noise, 1.0).std() < 0.45


@pytest.mark.parametrize("sigma", [1.0, (0.7, 0.0, 2.5)])
def test_smoothing_is_twice_a_gaussian_minus_its_square(sigma):
    values = np.random.default_rng(2).normal(size=(70, 33, 41))
    once = ndimage.gaussian_filter(values, sigma, mode="nearest")
    expected = 2.0 * once - ndimage.gaussian_filter(once, sigma, mode="nearest")
    assert np.allclose(smoothed(values, sigma), expected, atol=1e-5)


def test_near_the_border_distances_are_exact(grid):
    mask = np.linalg.norm(grid(14.0, (1.0, 1.3, 0.8)) - [0.1, 0.2, 0.3], axis=-1) < 8.3
    exact = ndimage.distance_transform_edt(~mask)
    assert np.array_equal(near_distance(mask, 7), np.minimum(exact, 7.0).astype(np.float32))


def test_distances_near_the_border_give_the_same_surface(grid):
    mask = np.linalg.norm(grid(17.0) - [0.13, 0.27, 0.41], axis=-1) < 12.0
    whole, near = antialiased(mask), antialiased(mask, near_only=True)
    band = np.abs(whole) < 0.8
    assert np.abs(whole - near)[band].max() < 0.02
