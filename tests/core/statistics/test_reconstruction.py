import numpy as np

from homolog.statistics.reconstruction import mean_surface, medoid, warp_surface


def test_the_mean_surface_of_a_sphere_among_ellipsoids_is_the_mean_ellipsoid(sphere):
    vertices, faces = sphere
    particles = vertices[::4]
    mean = particles * [3.0, 2.0, 1.0]
    surface = mean_surface(mean, particles, vertices, faces)
    assert surface.folded == 0
    assert not surface.smoothing.any()
    np.testing.assert_allclose(surface.vertices, vertices * [3.0, 2.0, 1.0], atol=1e-6)
    shape = particles * [3.3, 2.0, 0.8]
    moved = warp_surface(mean, surface.vertices, (shape - mean)[None], surface.smoothing)[0]
    np.testing.assert_allclose(surface.vertices + moved, vertices * [3.3, 2.0, 0.8], atol=1e-6)


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


def test_the_mean_surface_has_the_displacements_of_its_moves(sphere):
    vertices, faces = sphere
    particles = vertices[::4]
    moves = 0.1 * np.stack([particles * [1.0, 0.0, 0.0], np.sin(3.0 * particles)])
    surface = mean_surface(particles, particles, vertices, faces, moves=moves)
    alone = warp_surface(particles, surface.vertices, moves, surface.smoothing)
    np.testing.assert_allclose(surface.moved, alone, atol=1e-12)


def test_moves_that_would_tear_the_mean_surface_leave_it_whole(sphere):
    vertices, faces = sphere
    particles = vertices[::4]
    move = np.zeros((1, *particles.shape))
    move[0, np.argsort(particles @ [0.6, 0.8, 0.0])[-12:]] = [0.0, 0.0, 0.5]  # a patch slides by its width
    torn = mean_surface(particles, particles, vertices, faces)
    whole = mean_surface(particles, particles, vertices, faces, moves=move)
    np.testing.assert_array_equal(whole.vertices, torn.vertices)
    for way in (move, -move):
        folds = [
            np.count_nonzero(
                _turned_in(
                    item.vertices, warp_surface(particles, item.vertices, way, item.smoothing)[0], faces
                )
            )
            for item in (torn, whole)
        ]
        assert folds[0] > 3
        assert folds[1] == 0
    assert 12 < np.count_nonzero(whole.smoothing) < 80
    shift = np.ones((1, *particles.shape))  # what all do alike, the surface does too
    np.testing.assert_allclose(warp_surface(particles, vertices, shift, whole.smoothing), 1.0, atol=1e-9)


def _turned_in(vertices, move, faces):
    """Tell which faces of a sphere look inward once they have moved within it."""
    corners = (vertices + move)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("fi,fi->f", normals, corners.mean(axis=1)) < 0.0


def test_the_medoid_is_the_subject_nearest_to_the_mean(ellipsoids):
    particles = ellipsoids()
    mean = particles.mean(axis=0)
    distances = [np.linalg.norm(particle - mean) for particle in particles]
    assert medoid(particles, mean) == int(np.argmin(distances))
