import numpy as np
import pytest
from scipy import stats

from homolog.statistics.design import group_design, make_design, regression_design
from homolog.statistics.effects import (
    corrected_distance,
    degrees,
    distance_of_several,
    effect_bounds,
    explained_variance,
    size_effect,
    size_variance,
    standardized_size,
)


def test_the_distance_is_unbiased_where_the_plain_one_is_too_large():
    generator = np.random.default_rng(1)
    squares, plain, inside = [], [], 0
    for _ in range(400):
        scores = generator.normal(size=(28, 5))
        scores[14:, 0] += 1.2
        apart = scores[14:].mean(axis=0) - scores[:14].mean(axis=0)
        pooled = (np.cov(scores[:14], rowvar=False) + np.cov(scores[14:], rowvar=False)) / 2
        square = apart @ np.linalg.solve(pooled, apart)
        result = corrected_distance(7.0 * square, 5, 26, 7.0)
        squares.append((28 - 5 - 3) / 26 * square - 5 / 7)
        plain.append(np.sqrt(square))
        assert result.value == pytest.approx(np.sqrt(max(squares[-1], 0.0)))
        inside += result.low <= 1.2 <= result.high
    assert np.mean(squares) == pytest.approx(1.44, abs=0.15)
    assert np.mean(plain) > 1.5
    assert 0.86 < inside / 400 < 0.94  # intervals of 90 %


def test_effects_of_several_groups_are_unbiased_and_their_intervals_cover_the_truth():
    generator = np.random.default_rng(4)
    counts, means = np.array([8, 12, 16]), np.array([0.0, 0.8, 1.4])
    labels = np.repeat(["a", "b", "c"], counts)
    members = (labels[:, None] == ["a", "b", "c"]).astype(float)
    truth = np.sqrt(counts @ np.square(means - counts @ means / 36) / 36)
    share = 1.0 - (1.0 + truth**2) ** -0.5
    squares, shares, inside = [], [], np.zeros(2)
    for _ in range(400):
        scores = generator.normal(size=(36, 3))
        scores[:, 1] += members @ means
        of_groups = members.T @ scores / counts[:, None]
        between = (counts[:, None] * (apart := of_groups - scores.mean(axis=0))).T @ apart
        rest = scores - members @ of_groups
        trace = np.trace(np.linalg.solve(rest.T @ rest, between))
        result = distance_of_several(trace, 3, 2, 33, 36)
        squares.append((29 * trace - 6) / 36)
        assert result.value == pytest.approx(np.sqrt(max(squares[-1], 0.0)))
        explained = explained_variance(
            np.linalg.det(rest.T @ rest) / np.linalg.det(rest.T @ rest + between), 3, 2, 33, 36
        )
        shares.append(explained.value)
        inside += result.low <= truth <= result.high, explained.low <= share <= explained.high
    assert np.mean(squares) == pytest.approx(truth**2, abs=0.03)
    assert np.mean(shares) == pytest.approx(share, abs=0.02)
    assert (abs(inside / 400 - 0.90) < 0.04).all()
    two = corrected_distance(9.0, 3, 26, 7.0)
    both = distance_of_several(9.0 / 26, 3, 1, 26, 28)
    np.testing.assert_allclose(
        [both.value, both.low, both.high], np.array([two.value, two.low, two.high]) / 2
    )


def test_the_explained_variance_of_two_groups_says_the_same_as_their_distance():
    """Of 14 and 14 subjects in 3 modes, T² 9: it is a function of the distance alone."""
    two = corrected_distance(9.0, 3, 26, 7.0)
    share = explained_variance(26 / (26 + 9.0), 3, 1, 26, 28)
    noncentrality = 7.0 * np.square([two.value, two.low, two.high])
    expected = noncentrality / (noncentrality + 28)
    np.testing.assert_allclose([share.value, share.low, share.high], expected, atol=1e-6)
    assert explained_variance(0.5, 0, 1, 26, 28) is None


def test_bounds_of_one_number_are_welchs_and_hold_for_a_variable_too():
    generator = np.random.default_rng(2)
    values = generator.normal(size=(30, 3)) * np.where(np.arange(30) < 9, 3.0, 1.0)[:, None]
    labels = np.where(np.arange(30) < 9, "a", "b")
    design = group_design(labels.tolist(), ["a", "b"])
    value, low, high = effect_bounds(values, design, (labels == "a", labels == "b"))
    welch = stats.ttest_ind(values[9:], values[:9], equal_var=False).confidence_interval()
    np.testing.assert_allclose(low, welch.low)
    np.testing.assert_allclose(high, welch.high)
    np.testing.assert_allclose(value, values[9:].mean(axis=0) - values[:9].mean(axis=0))
    age = generator.normal(60.0, 9.0, 30)
    slope, low, high = effect_bounds(values + 0.5 * age[:, None], regression_design(age))
    assert (low < slope).all()
    assert (slope < high).all()
    np.testing.assert_allclose(slope, np.polyfit(age, values, 1)[0] + 0.5)


def test_size_against_itself_has_no_test():
    size = np.random.default_rng(3).normal(30.0, 2.0, 20)
    assert size_effect(size, regression_design(size)) is None
    groups = group_design(["a", "b"] * 10, ["a", "b"], ((size - size.mean()) / size.std())[:, None])
    assert size_effect(size, groups) is None
    assert size_effect(size, group_design(["a", "b"] * 10, ["a", "b"]), permutations=99).p > 0.0


def test_size_of_three_groups_has_the_f_of_welch_and_a_share_of_the_variance():
    random = np.random.default_rng(3)
    groups = ["a"] * 12 + ["b"] * 9 + ["c"] * 15
    labels = np.array(groups)
    size = random.normal(50.0, 2.0, size=36) + 3.0 * (labels == "c")
    design = group_design(groups, ["a", "b", "c"])
    members = [labels == name for name in "abc"]
    welch = size_variance(size, design, members)
    parts = [size[own] for own in members]
    assert welch.f == pytest.approx(stats.f_oneway(*parts, equal_var=False).statistic)
    assert stats.f.sf(welch.f, *welch.dof) == pytest.approx(stats.f_oneway(*parts, equal_var=False).pvalue)
    assert 0.0 < welch.omega_squared.low < welch.omega_squared.value < welch.omega_squared.high < 1.0
    age = random.normal(size=(36, 1))
    adjusted = size_variance(size, group_design(groups, ["a", "b", "c"], age))
    full = np.column_stack([np.ones(36), age, labels == "b", labels == "c"])
    rest = [np.linalg.lstsq(full[:, :columns], size, rcond=None)[1][0] for columns in (2, 4)]
    assert adjusted.f == pytest.approx((rest[0] - rest[1]) / 2.0 / (rest[1] / 32.0))
    assert adjusted.dof == (2.0, 32.0)


def test_the_standardized_size_is_hedges_g_and_its_interval_covers_the_truth():
    generator = np.random.default_rng(2)
    design = group_design(["a"] * 9 + ["b"] * 12, ["a", "b"])
    result = []
    for _ in range(200):
        size = generator.normal(size=21) + np.repeat([0.0, 1.5], [9, 12])
        result.append(standardized_size(size, design))
    pooled = np.sqrt((8 * size[:9].var(ddof=1) + 11 * size[9:].var(ddof=1)) / 19)
    plain = (size[9:].mean() - size[:9].mean()) / pooled
    assert result[-1].value == pytest.approx(plain * (1 - 3 / (4 * 19 - 1)), rel=1e-3)
    assert 0.9 <= np.mean([each.low <= 1.5 <= each.high for each in result]) <= 0.99
    assert np.mean([each.value for each in result]) == pytest.approx(1.5, abs=0.1)
    assert standardized_size(np.repeat([0.0, 1.0], [9, 12]), design) is None


def test_intervals_of_repeated_measures_have_the_degrees_of_freedom_of_their_subjects():
    generator = np.random.default_rng(3)
    table = {"time": np.tile([0.0, 1.0, 2.0], 15).tolist(), "group": np.repeat(list("aabbb") * 3, 3).tolist()}
    subject = np.repeat(np.arange(15), 3).astype(str).tolist()
    design = make_design("~ group + time", table, subject=subject)
    inside = []
    for _ in range(400):
        values = np.repeat(generator.normal(size=15), 3) + 0.3 * generator.normal(size=45)
        _, low, high = effect_bounds(values[:, None], design.hypothesis("group"))
        inside.append(low[0] <= 0.0 <= high[0])
    assert 0.92 <= np.mean(inside) <= 0.98
    squares = np.ones((15, 1))
    assert degrees(squares, design.hypothesis("time"))[0] == pytest.approx(14.0, abs=0.1)
    assert degrees(squares, design.hypothesis("group"))[0] < 13.0
