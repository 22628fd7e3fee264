"""Cross-validation from moments gives what fitting every fold anew gives."""

import numpy as np
import pytest

from homolog.statistics.held_out import auc_bounds, held_out_by_moments, stratified_folds


def fitted_anew(rows, second, covariates, fold_of, modes, shrinkage):
    """Return held-out scores of discriminants that are fitted to the training subjects of each fold."""
    result = np.empty(len(rows))
    for fold in range(fold_of.max() + 1):
        trains = fold_of != fold
        columns = np.column_stack([np.ones(len(rows)), second, covariates])
        effect = np.linalg.lstsq(columns[trains], rows[trains], rcond=None)[0][2:]
        left = rows - covariates @ effect
        left = left - left[trains].mean(axis=0)
        _, _, axes = np.linalg.svd(left[trains], full_matrices=False)
        scores = left @ axes[:modes].T
        means = [scores[trains & (second == side)].mean(axis=0) for side in (False, True)]
        apart = scores[trains] - np.where(second[trains, None], means[1], means[0])
        covariance = apart.T @ apart / trains.sum()
        sphere = np.trace(covariance) / modes * np.eye(modes)
        covariance = shrinkage * sphere + (1.0 - shrinkage) * covariance
        direction = np.linalg.solve(covariance, means[1] - means[0])
        direction /= np.linalg.norm(direction)
        along = (scores - (means[0] + means[1]) / 2.0) @ direction
        result[~trains] = along[~trains] / ((means[1] - means[0]) @ direction)
    return result


@pytest.mark.parametrize("columns", [0, 2])
@pytest.mark.parametrize("shrinkage", [0.0, 0.3])
def test_moments_give_the_scores_of_fits_to_every_fold(columns, shrinkage):
    generator = np.random.default_rng(columns)
    rows = generator.normal(size=(60, 6)) * [5.0, 4.0, 3.0, 2.0, 1.0, 0.5]
    second = np.arange(60) % 5 < 2
    rows[second] += 0.7
    covariates = generator.normal(size=(60, columns)) + second[:, None]
    rows += covariates @ generator.normal(size=(columns, 6))
    rows -= rows.mean(axis=0)
    fold_of = stratified_folds(second, 7, generator)
    given = rows, second, covariates, fold_of, 4, shrinkage
    np.testing.assert_allclose(held_out_by_moments(*given), fitted_anew(*given), atol=1e-9)


def test_modes_without_variation_are_left_out():
    generator = np.random.default_rng(0)
    rows = np.zeros((40, 5))
    rows[:, :2] = generator.normal(size=(40, 2))
    second = np.arange(40) % 2 == 0
    fold_of = stratified_folds(second, 5, generator)
    none = np.zeros((40, 0))
    flat = held_out_by_moments(rows, second, none, fold_of, 4, 0.1)
    np.testing.assert_allclose(
        flat, held_out_by_moments(rows[:, :2], second, none, fold_of, 2, 0.1), atol=1e-9
    )


def test_bounds_of_an_area_under_the_curve_rise_with_it_up_to_one_and_mirror():
    second = np.arange(22) < 12
    areas = np.array([0.0, 0.3, 0.5, 0.8, 0.98, 1.0])
    low, high = np.array([auc_bounds(float(area), second) for area in areas]).T
    assert (np.diff(low) >= 0.0).all()
    assert (np.diff(high) >= 0.0).all()
    assert (low <= areas).all()
    assert (areas <= high).all()
    np.testing.assert_allclose(auc_bounds(0.2, second), 1.0 - np.array(auc_bounds(0.8, second))[::-1])
    bound = low[-1]  # the estimate is 1.96 standard errors of Hanley and McNeil away from it
    pairs = (1.0 - bound) / (2.0 - bound) + bound / (1.0 + bound)
    error = np.sqrt(bound * (1.0 - bound) * (1.0 + 10.0 * pairs) / (10 * 12))
    assert (1.0 - bound) / error == pytest.approx(1.96, abs=1e-3)
