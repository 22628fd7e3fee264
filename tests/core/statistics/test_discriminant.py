import numpy as np
import pytest

from homolog.errors import InputError
from homolog.statistics.discriminant import discriminant, shrunk_covariance


def _two_groups(correlated, shift, subjects=40):
    shapes = correlated(subjects=subjects, seed=2)
    second = np.arange(subjects) % 2 == 1
    direction = np.random.default_rng(5).normal(size=shapes.shape[1:])
    shapes[second] += shift * direction
    return shapes, second


def test_shrinkage_is_that_of_ledoit_and_wolf_written_out():
    rows = np.random.default_rng(0).normal(size=(15, 4)) * [3.0, 2.0, 1.0, 0.5]
    rows -= rows.mean(axis=0)
    sample = sum(np.outer(row, row) for row in rows) / 15
    mu = np.trace(sample) / 4
    distance = np.linalg.norm(sample - mu * np.eye(4)) ** 2
    noise = sum(np.linalg.norm(np.outer(row, row) - sample) ** 2 for row in rows) / 15**2
    weight = min(noise, distance) / distance
    covariance, shrinkage = shrunk_covariance(rows)
    assert shrinkage == pytest.approx(weight)
    np.testing.assert_allclose(covariance, weight * mu * np.eye(4) + (1 - weight) * sample)


def test_groups_far_apart_are_told_apart_and_the_way_between_them_is_found(correlated):
    shapes, second = _two_groups(correlated, 12.0)
    result = discriminant(shapes, second, 1, bootstraps=50, permutations=99)
    assert result.accuracy.value == result.auc.value == 1.0
    assert result.auc.p == result.accuracy.p == pytest.approx(0.01)
    assert 0.8 < result.auc.low < result.auc.high == 1.0
    apart = shapes[second].mean(axis=0) - shapes[~second].mean(axis=0)
    way = result.displacement
    cosine = (way * apart).sum() / np.linalg.norm(way) / np.linalg.norm(apart)
    assert cosine > 0.98
    assert (result.scores[second] > 0).all()
    assert (result.scores[~second] < 0).all()


def test_labels_without_meaning_are_not_told_apart(correlated):
    shapes = correlated(subjects=60)
    result = discriminant(shapes, np.arange(60) % 2 == 1, 4, bootstraps=10, permutations=39)
    assert 0.25 < result.auc.value < 0.65
    assert 0.25 < result.accuracy.value < 0.65
    assert result.auc.low < 0.5 < result.auc.high
    assert result.auc.p > 0.05


def test_the_direction_is_fishers_in_the_modes(correlated):
    shapes, second = _two_groups(correlated, 2.0)
    result = discriminant(shapes, second, 3, bootstraps=5, permutations=0)
    rows = shapes.reshape(40, -1) - shapes.reshape(40, -1).mean(axis=0)
    scores = rows @ result.modes.reshape(3, -1).T
    within = scores - np.where(second[:, None], scores[second].mean(axis=0), scores[~second].mean(axis=0))
    covariance, _ = shrunk_covariance(within)
    fisher = np.linalg.solve(covariance, scores[second].mean(axis=0) - scores[~second].mean(axis=0))
    np.testing.assert_allclose(
        result.weights / np.linalg.norm(result.weights), fisher / np.linalg.norm(fisher), atol=1e-8
    )
    assert result.scores[second].mean() == pytest.approx(-result.scores[~second].mean())


def test_bootstrap_bounds_hold_the_map_between_them(correlated):
    shapes, second = _two_groups(correlated, 3.0)
    result = discriminant(shapes, second, 3, bootstraps=300, permutations=0)
    maps = result.modes[:, :, 2]
    low, high = result.bounds(maps)
    inside = (low <= result.weights @ maps) & (result.weights @ maps <= high)
    assert inside.mean() > 0.95
    assert (high - low).min() > 0.0


def test_a_covariate_that_makes_the_groups_differ_is_taken_out(correlated):
    shapes = correlated(subjects=60)
    second = np.arange(60) % 2 == 1
    age = second + 0.7 * np.random.default_rng(3).normal(size=60)
    shapes += age[:, None, None] * 8.0 * np.random.default_rng(4).normal(size=shapes.shape[1:])
    blind = discriminant(shapes, second, 2, bootstraps=5, permutations=0)
    fair = discriminant(
        shapes, second, 2, covariates=(age - age.mean())[:, None], bootstraps=5, permutations=0
    )
    assert blind.auc.value > 0.75
    assert fair.auc.value < 0.65


def test_a_discriminant_without_modes_or_with_a_group_of_one_is_refused(correlated):
    shapes = correlated(subjects=6)
    with pytest.raises(InputError, match="at least one mode"):
        discriminant(shapes, np.arange(6) < 3, 0)
    with pytest.raises(InputError, match="at least one mode"):
        discriminant(shapes, np.arange(6) < 1, 2)


def test_many_subjects_are_cross_validated_in_their_leading_modes_as_in_all(correlated, monkeypatch):
    shapes, second = _two_groups(correlated, 0.5, subjects=80)
    whole = discriminant(shapes, second, 4, bootstraps=5, permutations=0)
    monkeypatch.setattr("homolog.statistics.discriminant.MANY", 10)
    reduced = discriminant(shapes, second, 4, bootstraps=5, permutations=0)
    np.testing.assert_allclose(reduced.modes, whole.modes, atol=1e-8)
    np.testing.assert_allclose(reduced.scores, whole.scores, atol=1e-7)
    np.testing.assert_allclose(reduced.held_out, whole.held_out, atol=0.02)
    assert reduced.auc.value == pytest.approx(whole.auc.value, abs=0.01)


def test_permutations_of_many_subjects_give_about_the_p_of_fits_to_every_fold(correlated, monkeypatch):
    shapes, second = _two_groups(correlated, 0.7, subjects=60)
    whole = discriminant(shapes, second, 3, bootstraps=5, repeats=2, permutations=199)
    monkeypatch.setattr("homolog.statistics.discriminant.MANY", 10)
    many = discriminant(shapes, second, 3, bootstraps=5, repeats=2, permutations=199)
    assert many.auc.p == pytest.approx(whole.auc.p, abs=0.1)
    assert many.accuracy.p == pytest.approx(whole.accuracy.p, abs=0.15)
