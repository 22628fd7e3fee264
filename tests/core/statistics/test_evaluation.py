import numpy as np
import pytest

from homolog.errors import InputError
from homolog.statistics.evaluation import compactness, generalization, specificity
from homolog.statistics.shape_model import ShapeModel


def test_compactness_is_the_cumulated_share_of_the_covariance_eigenvalues(ellipsoids):
    particles = ellipsoids(subjects=10, particles=8)
    values = np.linalg.eigvalsh(np.cov(particles.reshape(10, -1), rowvar=False))[::-1][:9]
    np.testing.assert_allclose(
        compactness(ShapeModel.fit(particles)), np.cumsum(values) / values.sum(), rtol=1e-9
    )


def test_generalization_is_the_mean_particle_distance_of_left_out_shapes(ellipsoids):
    particles = ellipsoids(subjects=8, particles=10, noise=0.4)
    result = generalization(particles)
    for k in range(1, 7):
        total = 0.0
        for left_out in range(8):
            others = np.array([particles[index].ravel() for index in range(8) if index != left_out])
            mean = others.mean(axis=0)
            basis = np.linalg.svd(others - mean)[2][:k]
            fit = mean + basis.T @ (basis @ (particles[left_out].ravel() - mean))
            total += np.linalg.norm((fit - particles[left_out].ravel()).reshape(-1, 3), axis=1).mean()
        assert result[k - 1] == pytest.approx(total / 8, rel=1e-9)


def test_specificity_draws_with_the_modes_own_standard_deviations(ellipsoids):
    # One mode, one real shape far from all others is never nearest: the distance has a closed form.
    particles = ellipsoids(subjects=40, noise=0.0)
    model = ShapeModel.fit(particles)
    result = specificity(model, particles, [1], draws=4000, seed=1)[0]
    places = model.scores[:, 0]
    generator = np.random.default_rng(7)
    drawn = generator.normal(scale=places.std(ddof=1), size=4000)
    per_unit = np.linalg.norm(model.components[0], axis=1).mean()
    expected = np.abs(drawn[:, None] - places).min(axis=1).mean() * per_unit
    assert result == pytest.approx(expected, rel=0.12)


def test_generalization_of_two_subjects_and_specificity_of_too_many_modes_are_refused(ellipsoids):
    particles = ellipsoids(subjects=2)
    with pytest.raises(InputError, match="needs three"):
        generalization(particles)
    with pytest.raises(InputError, match="the model has"):
        specificity(ShapeModel.fit(particles), particles, [5])
