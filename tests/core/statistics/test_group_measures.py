"""Measures by group."""

import numpy as np
import pytest
from scipy import stats

from homolog.errors import InputError
from homolog.statistics.welch import compare_measure, mean_difference


def test_means_deviations_and_p_of_two_groups_are_those_of_welchs_t_test():
    random = np.random.default_rng(0)
    first, second = random.normal(10.0, 1.0, 12), random.normal(11.0, 3.0, 7)
    result = compare_measure(np.concatenate([first, second]), ["b"] * 12 + ["a"] * 7)
    assert result.groups == ("a", "b")
    assert result.counts == (7, 12)
    np.testing.assert_allclose(result.means, [second.mean(), first.mean()])
    np.testing.assert_allclose(result.deviations, [second.std(ddof=1), first.std(ddof=1)])
    assert result.p == pytest.approx(stats.ttest_ind(first, second, equal_var=False).pvalue)


def test_a_difference_of_means_has_the_interval_of_welch_and_none_without_variance():
    first, second = np.array([1.0, 3.0, 4.0, np.nan]), np.array([5.0, 9.0, 7.0, 8.0, 2.0])
    found = mean_difference(first, second)
    parts = [values[np.isfinite(values)] for values in (first, second)]
    squares = [values.var(ddof=1) / len(values) for values in parts]
    dof = sum(squares) ** 2 / sum(
        square**2 / (len(values) - 1) for square, values in zip(squares, parts, strict=True)
    )
    reach = stats.t.ppf(0.975, dof) * np.sqrt(sum(squares))
    value = parts[1].mean() - parts[0].mean()
    np.testing.assert_allclose((found.value, found.low, found.high), (value, value - reach, value + reach))
    assert mean_difference(np.ones(3), np.ones(4)) is None
    assert mean_difference(first[:1], second) is None


def test_the_level_holds_for_three_groups_of_unequal_variance():
    random = np.random.default_rng(1)
    groups = ["a"] * 4 + ["b"] * 8 + ["c"] * 20
    scale = np.repeat([4.0, 2.0, 1.0], [4, 8, 20])
    p = [compare_measure(scale * random.normal(size=32), groups).p for _ in range(500)]
    assert 0.03 < np.mean(np.array(p) < 0.05) < 0.085


def test_subjects_without_a_value_or_a_group_are_excluded():
    result = compare_measure(np.array([1.0, 2.0, np.nan, 4.0, 6.0, 9.0]), ["a", "a", "a", "b", "b", ""])
    assert result.counts == (2, 2)
    assert result.means == (1.5, 5.0)


@pytest.mark.parametrize(("values", "groups"), [([1.0, 2.0], ["a", "a"]), ([1.0, 2.0, 3.0], ["a", "a", "b"])])
def test_what_cannot_be_tested_has_no_p(values, groups):
    assert compare_measure(np.array(values), groups).p is None


def test_as_many_groups_as_values_are_needed():
    with pytest.raises(InputError, match="2 values and 1 groups"):
        compare_measure(np.array([1.0, 2.0]), ["a"])
