import numpy as np
import pytest
from scipy import stats

from homolog.analysis.assumptions import dispersion_test
from homolog.analysis.design import group_design, paired_design, regression_design
from homolog.analysis.mode_test import mode_test
from homolog.analysis.pointwise_test import pointwise_test


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
    f = stats.f_oneway(result.distances[:8], result.distances[8:]).statistic
    assert result.f == pytest.approx(f)


def test_a_group_that_scatters_twice_as_much_is_noticed_and_equal_ones_are_not(correlated):
    shapes = correlated(subjects=42, seed=1)
    design, members = _groups((8, 34))
    assert dispersion_test(shapes, design, 4, members, permutations=499).p > 0.05
    shapes[:8] = 2.0 * shapes[:8]
    result = dispersion_test(shapes, design, 4, members, permutations=499)
    assert result.p < 0.01
    assert result.by_group["a"] > 1.5 * result.by_group["b"]
    assert result.ratio == result.by_group["a"] / result.by_group["b"]


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
    for repeat in range(150):
        scores = generator.normal(size=(42, 5)) * np.where(np.arange(42) < 8, 2.0, 1.0)[:, None]
        shapes = np.tensordot(scores, pattern, axes=1)
        whole = mode_test(shapes, design, modes=5, permutations=199, seed=repeat)
        local = pointwise_test(shapes, design, permutations=199, seed=repeat)
        counts += [whole.p <= 0.05, whole.p_permutation <= 0.05, local.p_fwe.min() <= 0.05]
    parametric, permuted, family_wise = counts / 150
    assert parametric > 0.25
    assert permuted < 0.1
    assert family_wise < 0.1
