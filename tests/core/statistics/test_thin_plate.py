import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from homolog.errors import NumericalError
from homolog.statistics.thin_plate import (
    evaluate_spline,
    farthest_points,
    spline_weights,
    thin_plate_operator,
    warp_displacements,
)


def test_the_operator_is_the_thin_plate_interpolant_of_scipy():
    generator = np.random.default_rng(0)
    centres, targets, points = (generator.normal(size=(count, 3)) for count in (50, 50, 30))
    mine = thin_plate_operator(centres, points) @ targets
    oracle = RBFInterpolator(centres, targets, kernel="linear", degree=1)(points)
    np.testing.assert_allclose(mine, oracle, atol=1e-9)


def test_smoothing_is_that_of_scipy():
    generator = np.random.default_rng(1)
    centres, targets, points = (generator.normal(size=(count, 3)) for count in (50, 50, 30))
    mine = thin_plate_operator(centres, points, smoothing=0.2) @ targets
    oracle = RBFInterpolator(centres, targets, kernel="linear", degree=1, smoothing=0.2)(points)
    np.testing.assert_allclose(mine, oracle, atol=1e-9)


def test_affine_motions_are_followed_exactly_even_with_smoothing():
    generator = np.random.default_rng(2)
    centres, points = generator.normal(size=(40, 3)), generator.normal(size=(25, 3))
    matrix, shift = generator.normal(size=(3, 3)), generator.normal(size=3)
    moved = thin_plate_operator(centres, points, smoothing=0.5) @ (centres @ matrix + shift)
    np.testing.assert_allclose(moved, points @ matrix + shift, atol=1e-8)


def test_particles_in_one_plane_are_refused():
    centres = np.random.default_rng(3).normal(size=(20, 3)) * [1.0, 1.0, 0.0]
    with pytest.raises(NumericalError, match="one plane"):
        thin_plate_operator(centres, centres)


def test_displacements_are_those_of_the_operator():
    generator = np.random.default_rng(4)
    centres, points = generator.normal(size=(40, 3)), generator.normal(size=(25, 3))
    displacements, smoothing = generator.normal(size=(3, 40, 3)), generator.uniform(size=40)
    expected = thin_plate_operator(centres, points, smoothing=smoothing) @ displacements
    np.testing.assert_allclose(
        warp_displacements(centres, points, displacements, smoothing), expected, atol=1e-9
    )


def test_spread_centres_leave_no_point_far_from_all_of_them(sphere):
    vertices, _ = sphere
    chosen = farthest_points(vertices, 100)
    assert len(set(chosen.tolist())) == 100
    gaps = np.linalg.norm(vertices[:, None] - vertices[chosen], axis=2).min(axis=1)
    assert gaps.max() < 0.35
    np.testing.assert_array_equal(farthest_points(vertices, 800), np.arange(800))


def test_values_of_many_points_do_not_depend_on_the_number_of_cores(monkeypatch):
    rng = np.random.default_rng(4)
    centres, points = rng.normal(size=(40, 3)), rng.normal(size=(2500, 3))
    weights = spline_weights(centres, rng.normal(size=(40, 6)), 0.0)
    results = []
    for number in (1, 3):
        monkeypatch.setattr("homolog.statistics.thin_plate.cores", lambda number=number: number)
        results.append(evaluate_spline(centres, points, weights))
    assert results[0].shape == (2500, 6)
    assert np.array_equal(*results)
    some = slice(1000, 1100)  # across the border of two pieces
    assert np.allclose(results[0][some], evaluate_spline(centres, points[some], weights), atol=1e-10)
