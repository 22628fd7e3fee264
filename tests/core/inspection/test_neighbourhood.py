"""Distances, normals and neighbours that the inspection goes by."""

import numpy as np
import pytest

from homolog.inspection.located_particles import mean_normals


def test_distances_of_a_sphere_are_arcs(make_known):
    places = make_known([(10, 10, 10)] * 3).inspect().located
    vectors = places.world[0] / 10.0
    rows, columns = places.distances[0].nonzero()
    arcs = 10.0 * np.arccos(np.clip(np.einsum("ij,ij->i", vectors[rows], vectors[columns]), -1, 1))
    scale = np.cbrt(np.linalg.det(places.alignments[0, :3, :3]))
    result = np.asarray(places.distances[0][rows, columns]) * places.spacing[0] * scale
    np.testing.assert_allclose(result, arcs, rtol=0.03)


def test_normals_of_a_sphere_point_outward_in_aligned_coordinates(make_known):
    places = make_known([(10, 10, 10)] * 3).inspect().located
    np.testing.assert_allclose(places.normals, places.world / 10.0, atol=0.02)


def test_neighbours_are_never_taken_through_a_thin_wall(thin):
    result = thin.inspect()
    top = thin.directions[:, 2] > 0.93
    across = thin.directions[result.consensus.neighbours[top]][:, :, 2] < -0.3
    assert not across.any()
    assert np.isfinite(result.consensus.distances[top]).all()


def test_the_triangles_cover_the_surface_once_and_face_outward(good):
    usual = good.consensus
    assert abs(len(usual.triangles) - 2 * len(usual.shape)) <= 0.04 * len(usual.shape)
    a, b, c = usual.shape[usual.triangles].transpose(1, 0, 2)
    outward = np.einsum("ti,ti->t", np.cross(b - a, c - a), a)
    assert (outward > 0.0).all()


def test_the_usual_shape_is_not_shifted_by_one_wrong_particle(known, good):
    local = known.local.copy()
    local[0, [3, 120]] = local[0, [120, 3]]
    shape = known.inspect(local).consensus.shape
    spread = np.linalg.norm(good.located.world[:, 3] - good.consensus.shape[3], axis=1).max()
    assert np.linalg.norm(shape[3] - good.consensus.shape[3]) < spread


@pytest.mark.parametrize("angle", [0.1, 1.0, 1.5])
def test_the_mean_of_normals_on_an_arc_is_its_middle(angle):
    along = np.array([0.0, angle / 2, angle])
    normals = np.stack([np.cos(along), np.sin(along), np.zeros(3)], axis=1)[:, None]
    middle = [np.cos(angle / 2), np.sin(angle / 2), 0.0]
    np.testing.assert_allclose(mean_normals(normals)[0], middle, atol=1e-9)


def test_the_mean_of_normals_is_stationary_on_the_sphere():
    random = np.random.default_rng(1)
    normals = random.normal(size=(7, 50, 3)) + np.array([0.0, 0.0, 2.0])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    mean = mean_normals(normals)
    cosine = np.einsum("mni,ni->mn", normals, mean)
    logs = (np.arccos(cosine) / np.sqrt(1 - cosine**2))[..., None] * (normals - cosine[..., None] * mean)
    assert np.abs(logs.mean(axis=0)).max() < 1e-5
