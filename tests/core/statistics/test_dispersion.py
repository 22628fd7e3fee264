import numpy as np
import pytest
from scipy import stats

from homolog.statistics.assumptions import dispersion_test
from homolog.statistics.design import group_design, paired_design, regression_design
from homolog.statistics.mode_test import mode_test
from homolog.statistics.pointwise_test import pointwise_test


def _groups(counts):
    labels = np.repeat(["a", "b"], counts)
    return group_design(labels.tolist(), ["a", "b"]), {item: labels == item for item in "ab"}


def test_distances_to_the_centroid_are_those_of_the_definition(correlated):
    shapes = correlated(subjects=20)
    design, members = _groups((8, 12))
    result = dispersion_test(shapes, design, 19, members, permutations=99)
    for group, size in (("a", 8), ("b", 12)):
        own = shapes[members[group]]
        apart = np.sqrt(np.square(own - own.mean(axis=0)).sum(axis=2).mean(axis=1) * size / (size - 1))
        np.testing.assert_allclose(result.distances[members[group]], apart, rtol=1e-4)


def test_a_group_that_scatters_twice_as_much_is_noticed_and_equal_ones_are_not(correlated):
    shapes = correlated(subjects=42, seed=1)
    design, members = _groups((8, 34))
    assert dispersion_test(shapes, design, 4, members, permutations=499).p > 0.05
    shapes[:8] = 2.0 * shapes[:8]
    result = dispersion_test(shapes, design, 4, members, permutations=499)
    assert result.p < 0.01
    assert result.by_group["a"] > 1.5 * result.by_group["b"]
    assert result.ratio == result.by_group["a"] / result.by_group["b"]


def _without(index, shapes, design):
    """Distances of the others when a subject is held out, and the design of the others."""
    kept = np.arange(len(shapes)) != index
    return dispersion_test(shapes[kept], design.of(kept), 6, {}, permutations=1).distances, design.of(kept)


def test_intervals_of_dispersion_are_those_of_a_jackknife_that_fits_the_centroids_again():
    shapes = np.random.default_rng(5).normal(size=(20, 2, 3))
    design, members = _groups((8, 12))
    result = dispersion_test(shapes, design, 6, members, permutations=9)
    variances = []
    for own in (members["a"], members["b"]):
        logs = [
            np.log(_without(index, shapes, design)[0][np.delete(own, index)].mean())
            for index in np.flatnonzero(own)
        ]
        variances.append((len(logs) - 1) / len(logs) * np.square(logs - np.mean(logs)).sum())
    for name, variance in zip("ab", variances, strict=True):
        own = result.intervals[name]
        assert own.value == result.by_group[name]
        spread = stats.t.ppf(0.975, np.count_nonzero(members[name]) - 1) * np.sqrt(variance)
        assert np.log([own.value / own.low, own.high / own.value]) == pytest.approx(spread)
    assert result.effect.value == result.by_group["b"] / result.by_group["a"]
    dof = sum(variances) ** 2 / (variances[0] ** 2 / 7 + variances[1] ** 2 / 11)
    spread = stats.t.ppf(0.975, dof) * np.sqrt(sum(variances))
    assert np.log(result.effect.high / result.effect.value) == pytest.approx(spread)


def test_the_change_of_dispersion_along_a_variable_has_the_interval_of_its_jackknife():
    generator = np.random.default_rng(6)
    values = generator.normal(size=15)
    shapes, design = generator.normal(size=(15, 2, 3)), regression_design(values)
    result = dispersion_test(shapes, design, 6, {}, permutations=9).effect
    slopes = []
    for index in range(15):
        distances, others = _without(index, shapes, design)
        slopes.append(others.coefficients(distances[:, None])[0, 0])
    spread = stats.t.ppf(0.975, 13) * np.sqrt(14 / 15 * np.square(slopes - np.mean(slopes)).sum())
    assert [result.value - result.low, result.high - result.value] == pytest.approx([spread, spread])


def test_the_interval_of_the_ratio_of_dispersions_covers_the_truth():
    generator = np.random.default_rng(7)
    design, members = _groups((8, 14))
    inside = []
    for _ in range(200):
        shapes = generator.normal(size=(22, 1, 3)) * np.where(members["b"], 2.0, 1.0)[:, None, None]
        effect = dispersion_test(shapes, design, 3, members, permutations=1).effect
        inside.append(effect.low <= 2.0 <= effect.high)
    assert 0.92 < np.mean(inside) < 0.99


def test_outliers_in_groups_of_equal_dispersion_seldom_make_a_difference():
    """One subject in twenty has four times the deviation; 8 of 42 are in one group."""
    generator = np.random.default_rng(2)
    design, members = _groups((8, 34))
    noticed = []
    for repeat in range(300):
        factor = np.where(generator.random(42) < 0.05, 4.0, 1.0)
        shapes = generator.normal(size=(42, 2, 3)) * factor[:, None, None]
        noticed.append(dispersion_test(shapes, design, 5, members, permutations=99, seed=repeat).p <= 0.05)
    assert np.mean(noticed) < 0.09


def test_equal_scatter_in_other_directions_is_noticed(correlated):
    shapes = np.random.default_rng(3).normal(size=(42, 4, 3))
    shapes[:12, :2] *= 1.8**0.5
    shapes[:12, 2:] *= 0.2**0.5
    shapes[12:, :2] *= 0.2**0.5
    shapes[12:, 2:] *= 1.8**0.5
    design, members = _groups((12, 30))
    result = dispersion_test(shapes, design, 12, members, permutations=499)
    assert result.ratio < 1.3
    assert result.p < 0.01


def test_scatter_that_grows_along_a_variable_is_noticed_and_pairs_have_none(correlated):
    shapes = correlated(subjects=40)
    values = np.linspace(1.0, 6.0, 40)
    spread = shapes * values[:, None, None]
    assert dispersion_test(spread, regression_design(values), 4, {}, permutations=499).p < 0.01
    assert dispersion_test(shapes, paired_design(40), 4, {}) is None


def test_the_permutation_tests_hold_their_level_where_t_squared_does_not():
    """Equal means, the smaller group of 8 with twice the dispersion of the 34: scores and particles."""
    generator = np.random.default_rng(4)
    pattern = generator.normal(size=(5, 12, 3))
    design, _ = _groups((8, 34))
    counts = np.zeros(3, int)
    for repeat in range(80):
        scores = generator.normal(size=(42, 5)) * np.where(np.arange(42) < 8, 2.0, 1.0)[:, None]
        shapes = np.tensordot(scores, pattern, axes=1)
        whole = mode_test(shapes, design, modes=5, permutations=99, seed=repeat)
        local = pointwise_test(shapes, design, permutations=99, seed=repeat)
        counts += [whole.p <= 0.05, whole.p_permutation <= 0.05, local.p_fwe.min() <= 0.05]
    parametric, permuted, family_wise = counts / 80
    assert parametric > 0.25
    assert permuted < 0.1
    assert family_wise < 0.1
