import numpy as np
import pytest
from skimage.measure import marching_cubes

from homolog.beans.ellipsoid import (
    closest_on_ellipsoid,
    ellipsoid_area,
    ellipsoid_level,
    ellipsoid_normals,
    spread_points,
)
from homolog.beans.generate import NARROW, WIDE, Bean
from homolog.beans.surface import closest_on_bean, rim, surface_areas, surface_points

AXES = np.array([40.0, 30.0, 20.0])


def test_the_nearest_point_of_an_ellipsoid_is_on_it_and_straight_below():
    points = np.random.default_rng(1).uniform(-50, 50, (2000, 3))
    nearest = closest_on_ellipsoid(points, AXES)
    np.testing.assert_allclose(ellipsoid_level(nearest, AXES), 0.0, atol=1e-9)
    offset = points - nearest
    np.testing.assert_allclose(np.cross(offset, ellipsoid_normals(nearest, AXES)), 0.0, atol=1e-6)


def test_no_point_of_a_dense_lattice_is_nearer_than_the_nearest_point():
    points = np.random.default_rng(2).uniform(-30, 30, (200, 3))
    result = np.linalg.norm(points - closest_on_ellipsoid(points, AXES), axis=1)
    brute = np.linalg.norm(points[:, None] - spread_points(AXES, 20000), axis=2).min(axis=1)
    assert (result <= brute + 1e-9).all()
    np.testing.assert_allclose(result, brute, atol=0.5)


def test_points_on_the_axes_of_an_ellipsoid_have_finite_nearest_points():
    nearest = closest_on_ellipsoid(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 50.0]]), AXES)
    np.testing.assert_allclose(np.linalg.norm(nearest[0]), 20.0, atol=1e-6)
    np.testing.assert_allclose(nearest[2], [0.0, 0.0, 20.0], atol=1e-6)
    np.testing.assert_allclose(ellipsoid_level(nearest, AXES), 0.0, atol=1e-6)


def test_ellipsoid_areas_are_those_of_the_sphere_and_the_spheroid():
    np.testing.assert_allclose(ellipsoid_area(np.full(3, 7.0)), 4.0 * np.pi * 49.0)
    eccentricity = np.sqrt(1.0 - 0.25)
    oblate = 2.0 * np.pi * 4.0 * (1.0 + 0.25 / eccentricity * np.arctanh(eccentricity))
    np.testing.assert_allclose(ellipsoid_area(np.array([2.0, 1.0, 2.0])), oblate)


@pytest.mark.parametrize(
    ("bean", "step"),
    [(Bean(WIDE, 3.0, 8.0), 0.6), (Bean(WIDE, -8.0, 8.0), 0.6), (Bean(NARROW, 9.0, 5.0), 0.4)],
)
def test_areas_are_those_of_a_fine_triangulation(bean, step):
    axes = [np.arange(-half - 2.0, half + 2.0, step) for half in bean.body_axes]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    slot_grid = grid - bean.slot_centre

    def metric(points, semi_axes):
        slope = 2.0 * np.linalg.norm(points / semi_axes**2, axis=-1)
        return ellipsoid_level(points, semi_axes) / np.maximum(slope, 0.02)

    field = np.maximum(metric(grid, bean.body_axes), -metric(slot_grid, bean.slot_axes))
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(step,) * 3)
    corners = (vertices + [axis[0] for axis in axes])[faces]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    on_slot = closest_on_bean(corners.mean(axis=1), bean).on_slot
    np.testing.assert_allclose(surface_areas(bean), [areas.sum(), areas[on_slot].sum()], rtol=0.01)


def test_the_rim_lies_on_both_ellipsoids():
    bean = Bean(WIDE, 8.0, 8.0)
    curve = rim(bean)
    np.testing.assert_allclose(ellipsoid_level(curve, bean.body_axes), 0.0, atol=1e-9)
    np.testing.assert_allclose(ellipsoid_level(curve - bean.slot_centre, bean.slot_axes), 0.0, atol=1e-9)


@pytest.mark.parametrize("bean", [Bean(WIDE, 6.0, 7.0), Bean(NARROW, -9.0, 6.0)])
@pytest.mark.parametrize("shift", [0.3, -0.7])
def test_points_moved_along_the_normal_are_measured_exactly(bean, shift):
    surface, normals = surface_points(bean, 4000)
    moved = surface + shift * normals
    to_rim = np.linalg.norm(surface[:, None] - rim(bean, 400), axis=2).min(axis=1)
    clear = to_rim > 2.0
    contact = closest_on_bean(moved[clear], bean)
    np.testing.assert_allclose(contact.distance, shift, atol=1e-9)
    np.testing.assert_allclose(contact.points, surface[clear], atol=1e-7)
    np.testing.assert_allclose(contact.normals, normals[clear], atol=1e-7)


def test_points_above_the_rim_have_normals_that_fan_from_the_slot_to_the_outside():
    bean = Bean(WIDE, 2.0, 8.0)
    curve = rim(bean, 100)
    outer = ellipsoid_normals(curve, bean.body_axes)
    inner = -ellipsoid_normals(curve - bean.slot_centre, bean.slot_axes)
    for share, on_slot in ((0.2, False), (0.8, True)):
        direction = (1.0 - share) * outer + share * inner
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        contact = closest_on_bean(curve + 0.5 * direction, bean)
        np.testing.assert_allclose(contact.distance, 0.5, atol=1e-4)
        np.testing.assert_allclose(contact.normals, direction, atol=5e-3)
        assert (contact.on_slot == on_slot).all()


def test_slot_walls_have_sides_and_its_floor_has_none():
    bean = Bean(WIDE, 5.0, 8.0)
    angle = np.radians([-60.0, 0.0, 60.0])
    across = bean.slot_centre + bean.slot_axes * np.stack(
        [0.0 * angle, np.sin(angle), -np.cos(angle)], axis=1
    )
    underside = np.array([[0.0, 5.0, -19.7]])
    contact = closest_on_bean(np.concatenate([across, underside]), bean)
    assert contact.wall.tolist() == [-1, 0, 1, 0]
    assert contact.on_slot.tolist() == [True, True, True, False]
    assert contact.normals[0, 1] > 0.5
    assert contact.normals[2, 1] < -0.5
