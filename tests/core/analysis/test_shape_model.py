import numpy as np
import pytest

from homolog.analysis.shape_model import fit_shape_model
from homolog.errors import InputError


def test_modes_and_variances_are_those_of_the_full_covariance_matrix(ellipsoids):
    particles = ellipsoids(subjects=12, particles=9)
    model = fit_shape_model(particles)
    covariance = np.cov(particles.reshape(12, -1), rowvar=False)
    values, vectors = np.linalg.eigh(covariance)
    np.testing.assert_allclose(model.variances, values[::-1][:11], rtol=1e-8)
    for mode, vector in zip(model.modes.reshape(11, -1), vectors.T[::-1], strict=False):
        assert abs(mode @ vector) == pytest.approx(1.0, abs=1e-9)


def test_the_primal_side_is_used_when_subjects_outnumber_coordinates(ellipsoids):
    particles = ellipsoids(subjects=40, particles=5)
    model = fit_shape_model(particles)
    values = np.linalg.eigvalsh(np.cov(particles.reshape(40, -1), rowvar=False))
    np.testing.assert_allclose(model.variances, values[::-1], rtol=1e-8)
    np.testing.assert_allclose(model.reconstruct(model.scores), particles, atol=1e-9)


def test_modes_are_orthonormal_and_scores_rebuild_every_subject(ellipsoids):
    particles = ellipsoids()
    model = fit_shape_model(particles)
    flat = model.modes.reshape(len(model.modes), -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(len(flat)), atol=1e-9)
    np.testing.assert_allclose(model.reconstruct(model.scores), particles, atol=1e-9)
    np.testing.assert_allclose(model.project(particles), model.scores, atol=1e-9)
    assert model.explained.sum() == pytest.approx(1.0)


def test_one_standard_deviation_along_a_mode_is_that_far_from_the_mean(ellipsoids):
    model = fit_shape_model(ellipsoids())
    shape = model.shape([0.0, -2.0])
    distance = np.linalg.norm(shape - model.mean)
    assert distance == pytest.approx(2.0 * model.scores[:, 1].std(ddof=1))
    assert model.project(shape)[1] == pytest.approx(-2.0 * model.standard_deviations[1])


def test_a_cohort_that_differs_in_size_only_has_no_modes_left_after_scaling(ellipsoids):
    one = ellipsoids(subjects=2)[0]
    particles = one * np.linspace(0.8, 1.2, 9)[:, None, None]
    assert fit_shape_model(particles).explained[0] == pytest.approx(1.0)
    scaled = fit_shape_model(particles, scaling=True)
    assert scaled.variances.sum() < 1e-12
    np.testing.assert_allclose(scaled.sizes / scaled.sizes[4], np.linspace(0.8, 1.2, 9))


def test_the_same_shape_again_and_again_gives_a_model_without_modes(ellipsoids):
    particles = np.repeat(ellipsoids(subjects=2)[:1], 5, axis=0)
    model = fit_shape_model(particles)
    np.testing.assert_allclose(model.mean, particles[0], atol=1e-12)
    assert np.isfinite(model.explained).all()
    assert model.variances.sum() < 1e-20


@pytest.mark.parametrize(
    ("particles", "words"),
    [
        (np.zeros((1, 8, 3)), "at least two subjects"),
        (np.zeros((4, 8, 2)), "shape"),
        (np.full((3, 8, 3), np.nan), "Ann, Ben, Cleo: particle positions that are not finite"),
    ],
)
def test_particles_that_no_model_can_be_fitted_to_are_refused_by_name(particles, words):
    with pytest.raises(InputError, match=words):
        fit_shape_model(particles, names=["Ann", "Ben", "Cleo", "Dan"])
