"""Thickness of walls and distance between surfaces, where they are known."""

import numpy as np
import pytest

from homolog.surfaces.closest import signed_distances_to
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.walls import mean_over_area, wall_thickness


def ball(radius, count=3):
    """Return an icosphere."""
    golden = (1.0 + 5.0**0.5) / 2.0
    points = [[a, b * golden, 0.0] for a in (-1, 1) for b in (-1, 1)]
    points = np.concatenate([np.roll(points, turn, axis=1) for turn in range(3)])
    from scipy.spatial import ConvexHull

    for _ in range(count):
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        faces = ConvexHull(points).simplices
        middles = points[faces[:, [0, 1, 2]]] + points[faces[:, [1, 2, 0]]]
        points = np.concatenate([points, middles.reshape(-1, 3)])
        points = np.unique(np.round(points / np.linalg.norm(points, axis=1, keepdims=True), 9), axis=0)
    faces = ConvexHull(points).simplices
    out = np.einsum(
        "fi,fi->f",
        np.cross(*(points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2))),
        points[faces].mean(axis=1),
    )
    faces = np.where(out[:, None] > 0.0, faces, faces[:, ::-1])
    return TriangleMesh(radius * points, faces)


def test_the_wall_of_a_hollow_ball_is_as_thick_as_its_radii_differ():
    outer, inner = ball(10.0), ball(7.0)
    count = len(outer.vertices)
    wall = TriangleMesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces[:, ::-1] + count]),
    )
    thickness = wall_thickness(wall)
    np.testing.assert_allclose(thickness[:count], 3.0, rtol=0.08)
    np.testing.assert_allclose(thickness[count:], 3.0, rtol=0.08)
    assert mean_over_area(wall, thickness) == pytest.approx(3.0, rel=0.04)


def test_a_slab_is_as_thick_as_it_is_wherever_it_lies():
    side = np.linspace(-20.0, 20.0, 11)
    x, y = (grid.ravel() for grid in np.meshgrid(side, side, indexing="ij"))
    at = np.arange(121).reshape(11, 11)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    top = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    vertices = np.concatenate([np.stack([x, y, np.full(121, z)], axis=1) for z in (2.5, 0.0)])
    slab = TriangleMesh(
        vertices + np.array([500.0, -300.0, 100.0]), np.concatenate([top, top[:, ::-1] + 121])
    )
    middle = np.hypot(x, y) < 15.0
    np.testing.assert_allclose(wall_thickness(slab)[:121][middle], 2.5, rtol=1e-3)


def test_where_no_side_lies_opposite_the_thickness_is_unknown():
    sheet = TriangleMesh(np.eye(3), np.array([[0, 1, 2]]))
    thickness = wall_thickness(sheet)
    assert np.isnan(thickness).all()
    assert np.isnan(mean_over_area(sheet, thickness))


def test_distances_are_negative_inside_and_positive_outside():
    points = np.array([[0.0, 0.0, 12.0], [0.0, -9.0, 0.0], [-15.0, 0.0, 0.0]])
    np.testing.assert_allclose(signed_distances_to(ball(10.0), points), [2.0, -1.0, 5.0], atol=0.1)
