import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from homolog.analysis.reconstruction import mean_surface, medoid, spread_centres, thin_plate_operator
from homolog.errors import NumericalError


@pytest.fixture
def sphere():
    """Vertices and outward faces of a unit sphere."""
    from scipy.spatial import ConvexHull

    index = np.arange(800)
    height = 1.0 - (2.0 * index + 1.0) / 800
    turn = np.pi * (1.0 + 5**0.5) * index
    radius = np.sqrt(1.0 - height**2)
    vertices = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])
    faces = ConvexHull(vertices).simplices.copy()
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, corners.mean(axis=1)) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


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


def test_spread_centres_leave_no_point_far_from_all_of_them(sphere):
    vertices, _ = sphere
    chosen = spread_centres(vertices, 100)
    assert len(set(chosen.tolist())) == 100
    gaps = np.linalg.norm(vertices[:, None] - vertices[chosen], axis=2).min(axis=1)
    assert gaps.max() < 0.35
    np.testing.assert_array_equal(spread_centres(vertices, 800), np.arange(800))


def test_the_mean_surface_of_a_sphere_among_ellipsoids_is_the_mean_ellipsoid(sphere):
    vertices, faces = sphere
    particles = vertices[::4]
    surface = mean_surface(particles * [3.0, 2.0, 1.0], particles, vertices, faces)
    assert surface.folded == 0
    assert not surface.smoothing.any()
    np.testing.assert_allclose(surface.vertices, vertices * [3.0, 2.0, 1.0], atol=1e-6)
    shape = particles * [3.3, 2.0, 0.8]
    np.testing.assert_allclose(surface.moved(shape), vertices * [3.3, 2.0, 0.8], atol=1e-6)


def test_particles_that_changed_places_do_not_fold_the_mean_surface(sphere):
    vertices, faces = sphere
    particles = vertices[::4]
    near = np.argsort(np.linalg.norm(particles - particles[0], axis=1))[1]
    swapped = particles.copy()
    swapped[[0, near]] = particles[[near, 0]]
    surface = mean_surface(swapped, particles, vertices, faces)
    assert surface.folded == 0
    smoothed = np.flatnonzero(surface.smoothing)
    assert {0, near} <= set(smoothed.tolist())
    assert len(smoothed) < 40
    far = np.linalg.norm(vertices - particles[0], axis=1) > 1.0
    np.testing.assert_allclose(surface.vertices[far], vertices[far], atol=0.02)


def test_the_medoid_is_the_subject_nearest_to_the_mean(ellipsoids):
    particles = ellipsoids()
    mean = particles.mean(axis=0)
    distances = [np.linalg.norm(one - mean) for one in particles]
    assert medoid(particles, mean) == int(np.argmin(distances))
