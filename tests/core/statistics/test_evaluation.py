import numpy as np
import pytest

from homolog.errors import InputError
from homolog.statistics.evaluation import (
    compactness,
    description_length,
    generalization,
    leave_one_out_residual,
    modes_above_chance,
    specificity,
)
from homolog.statistics.shape_model import ShapeModel


def test_compactness_is_the_cumulated_share_of_the_covariance_eigenvalues(ellipsoids):
    particles = ellipsoids(subjects=10, particles=8)
    values = np.linalg.eigvalsh(np.cov(particles.reshape(10, -1), rowvar=False))[::-1][:9]
    np.testing.assert_allclose(
        compactness(ShapeModel().fit(particles)), np.cumsum(values) / values.sum(), rtol=1e-9
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
    model = ShapeModel().fit(particles)
    result = specificity(model, particles, [1], draws=4000, seed=1)[0]
    places = model.scores_[:, 0]
    generator = np.random.default_rng(7)
    drawn = generator.normal(scale=places.std(ddof=1), size=4000)
    per_unit = np.linalg.norm(model.components_[0], axis=1).mean()
    expected = np.abs(drawn[:, None] - places).min(axis=1).mean() * per_unit
    assert result == pytest.approx(expected, rel=0.12)


def test_generalization_of_two_subjects_and_specificity_of_too_many_modes_are_refused(ellipsoids):
    particles = ellipsoids(subjects=2)
    with pytest.raises(InputError, match="needs three"):
        generalization(particles)
    with pytest.raises(InputError, match="the model has"):
        specificity(ShapeModel().fit(particles), particles, [5])


def test_the_leave_one_out_residual_is_the_distance_from_the_flat_through_the_others(ellipsoids):
    particles = ellipsoids(subjects=7, particles=10, noise=0.4)
    shares = np.arange(1.0, 11.0) / 55.0
    result = leave_one_out_residual(particles, weights=shares)
    scaled = (particles * np.sqrt(shares)[:, None]).reshape(7, -1)
    for left_out in range(7):
        others = np.delete(scaled, left_out, axis=0)
        rest = scaled[left_out] - others.mean(axis=0)
        basis = np.linalg.svd(others - others.mean(axis=0))[2][:5]
        assert result.spreads[left_out] == pytest.approx(np.linalg.norm(rest), rel=1e-9)
        assert result.residuals[left_out] == pytest.approx(
            np.linalg.norm(rest - basis.T @ (basis @ rest)), rel=1e-9
        )


def test_the_residual_is_near_the_spread_for_noise_and_near_none_for_one_mode():
    generator = np.random.default_rng(1)
    noise = generator.standard_normal((12, 400, 3))
    one_mode = generator.standard_normal((12, 1, 1)) * noise[:1]
    assert leave_one_out_residual(noise).share == pytest.approx(1.0, abs=0.02)
    assert leave_one_out_residual(one_mode).share == pytest.approx(0.0, abs=1e-6)
    assert modes_above_chance(noise) == 0
    assert modes_above_chance(one_mode + 0.1 * noise) == 1


def test_a_description_length_counts_modes_above_the_precision_logarithmically():
    generator = np.random.default_rng(2)
    axes = np.linalg.qr(generator.standard_normal((300, 2)))[0].T * np.sqrt(100)  # 1 mm RMS a particle
    scores = generator.standard_normal((9, 2))
    scores = np.linalg.qr(scores - scores.mean(axis=0))[0] * 3.0  # of variance 1
    particles = (scores * [2.0, 0.05] @ axes).reshape(9, 100, 3)
    expected = 1.0 + np.log((2.0 / 0.1) ** 2) + (0.05 / 0.1) ** 2
    assert description_length(particles, 0.1) == pytest.approx(expected, rel=1e-9)


def test_weights_and_precisions_that_are_none_are_refused(ellipsoids):
    particles = ellipsoids(subjects=4, particles=5)
    with pytest.raises(InputError, match="precision"):
        description_length(particles, 0.0)
    with pytest.raises(InputError, match="weights need one number"):
        leave_one_out_residual(particles, weights=np.ones(4))
    with pytest.raises(InputError, match="needs three"):
        leave_one_out_residual(particles[:2])
