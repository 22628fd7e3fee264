"""Errors of particles where the correspondence of surfaces is known."""

import numpy as np
import pytest

from homolog.samples import make_study
from homolog.samples.evaluate import place_errors


@pytest.fixture(scope="module")
def meshes():
    return [subject.mesh for subject in make_study("hearts", 4, 1).subjects]


def true_particles(meshes, count=60):
    rng = np.random.default_rng(0)
    on = rng.choice(len(meshes[0].faces), count, replace=False)
    weights = rng.dirichlet(np.ones(3), count)
    return np.stack([np.einsum("nc,ncx->nx", weights, mesh.vertices[mesh.faces[on]]) for mesh in meshes])


def test_particles_in_their_true_places_have_no_error(meshes):
    errors = place_errors(meshes, true_particles(meshes))
    assert errors.distances.shape == (4, 3, 60)
    assert errors.distances.max() < 0.05
    assert errors.opposed == 0.0


def test_particles_of_one_subject_in_another_order_have_errors_and_opposed_normals(meshes):
    particles = true_particles(meshes)
    particles[2] = particles[2][::-1]
    errors = place_errors(meshes, particles)
    assert np.median(errors.distances[2]) > 10.0
    assert errors.opposed > 0.05
