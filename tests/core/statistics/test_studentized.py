import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.oneway import anova_oneway

from homolog.statistics.design import group_design, paired_design, regression_design
from homolog.statistics.mode_test import ModeStatistic, mode_test
from homolog.statistics.permutation import draw_permutations, permutation_p_value
from homolog.statistics.pointwise_test import PointwiseStatistic
from homolog.statistics.statistics import (
    WelchStatistic,
    design_columns,
    equalize_groups,
    equalize_subjects,
    observed_design,
    studentized_ratio,
)


@pytest.mark.parametrize("counts", [(7, 12), (6, 9, 14), (4, 5, 6, 7)])
def test_f_of_one_coordinate_is_the_welch_anova_of_statsmodels(counts):
    labels = [name for name, count in zip("abcd", counts, strict=False) for _ in range(count)]
    values = np.random.default_rng(3).normal(size=(len(labels), 5)) * (
        1.0 + (np.array(labels) == "a")[:, None]
    )
    values -= values.mean(axis=0)
    design = group_design(labels, sorted(set(labels)))
    for scaled in (False, True):
        groups = equalize_groups(values, design, scaled=scaled)
        f, dof = WelchStatistic(groups.values[None], np.ones(5), groups, design).f(observed_design(design))
        for place in range(5):
            parts = [values[np.array(labels) == name, place] for name in sorted(set(labels))]
            expected = anova_oneway(parts, use_var="unequal", welch_correction=True)
            assert f[0, place] == pytest.approx(expected.statistic, rel=1e-9)
            assert dof[0, place] == pytest.approx(expected.df_denom, rel=1e-9)


def test_the_deviate_is_as_unlikely_as_f():
    labels = ["a"] * 9 + ["b"] * 6 + ["c"] * 5
    design = group_design(labels, list("abc"))
    values = np.random.default_rng(4).normal(size=(20, 40))
    values[:9] += np.linspace(0.0, 3.0, 40)
    groups = equalize_groups(values - values.mean(axis=0), design)
    welch = WelchStatistic(groups.values[None], np.ones(40), groups, design)
    f, dof = welch.f(observed_design(design))
    p = stats.f.sf(f, 2.0, dof)
    np.testing.assert_allclose(stats.norm.sf(welch.deviate(observed_design(design))), p, rtol=0.15, atol=0.01)


def test_equalized_groups_have_one_dispersion():
    labels = ["a"] * 30 + ["b"] * 60
    values = np.random.default_rng(5).normal(size=(90, 50)) * np.repeat([3.0, 1.0], [30, 60])[:, None]
    groups = equalize_groups(values - values.mean(axis=0), group_design(labels, ["a", "b"]))
    first, second = groups.values[:30].std(axis=0), groups.values[30:].std(axis=0)
    assert first.mean() == pytest.approx(second.mean(), rel=0.05)
    assert groups.dispersions[0] / groups.dispersions[1] == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize(
    "design",
    [
        paired_design(6),
        regression_design(np.arange(6.0)),
        group_design(["a", "b"] * 3, ["a", "b"], np.arange(6.0)[:, None] ** 2),
    ],
)
def test_only_groups_without_covariates_are_equalized(design):
    assert equalize_groups(np.random.default_rng(1).normal(size=(6, 4)), design) is None


def test_subjects_equalized_along_a_variable_have_one_dispersion():
    generator = np.random.default_rng(5)
    values = generator.uniform(-1.0, 1.0, size=300)
    rows = generator.normal(size=(300, 6)) * np.exp(values)[:, None]
    design = regression_design(values)
    along = equalize_subjects(rows - rows.mean(axis=0), design, variables=True)
    spread = np.linalg.norm(along.values, axis=1)
    assert spread[values > 0.5].mean() / spread[values < -0.5].mean() == pytest.approx(1.0, abs=0.1)
    (dispersions,) = along.dispersions(design_columns(observed_design(design)))
    assert np.polyfit(values, np.log(dispersions), 1)[0] == pytest.approx(1.0, abs=0.15)


def test_groups_adjusted_for_a_covariate_have_one_dispersion_and_get_theirs_back():
    generator = np.random.default_rng(5)
    age = generator.normal(size=(90, 1)) + 0.5 * (np.arange(90) < 30)[:, None]
    design = group_design(["a"] * 30 + ["b"] * 60, ["a", "b"], age)
    rows = (generator.normal(size=(90, 50)) * np.repeat([3.0, 1.0], [30, 60])[:, None]) + age
    residuals = design.residuals(rows)
    result = equalize_subjects(residuals, design)
    assert result.values[:30].std() / result.values[30:].std() == pytest.approx(1.0, rel=0.05)
    (dispersions,) = result.dispersions(design_columns(observed_design(design)))
    assert np.ptp(dispersions[:30]) == pytest.approx(0.0, abs=1e-9)
    assert dispersions[0] / dispersions[-1] == pytest.approx(3.0, rel=0.06)
    np.testing.assert_allclose(
        result.restored(result.values, observed_design(design))[0], residuals, atol=1e-9
    )


def test_pointwise_statistics_with_restored_dispersions_are_those_of_refitted_particles():
    generator = np.random.default_rng(7)
    design = group_design(["a"] * 6 + ["b"] * 9, ["a", "b"], generator.normal(size=(15, 1)))
    particles = generator.normal(size=(15, 4, 3)) * np.repeat([2.0, 1.0], [6, 9])[:, None, None]
    residuals = design.residuals(particles.reshape(15, -1))
    (some,) = draw_permutations(design, 5, chunk=5, seed=1)
    result = PointwiseStatistic(residuals.reshape(particles.shape), design).studentized(some)
    equal = equalize_subjects(residuals, design)
    for place in range(4):
        rows = equal.values.reshape(15, 4, 3)[:, place]
        white = rows @ np.linalg.inv(np.linalg.cholesky(rows.T @ rows)).T
        expected = studentized_ratio(equal.restored(white, some), some, design)
        np.testing.assert_allclose(result[:, place], expected, rtol=1e-9)


def test_a_dispersion_that_grows_along_the_variable_leaves_the_level_as_it_is():
    """The statistic of permuted values alone finds an effect in none of these."""
    generator = np.random.default_rng(6)
    noticed = 0
    for repeat in range(120):
        values = generator.normal(size=42)
        rows = generator.normal(size=(42, 30)) * np.exp(0.4 * values)[:, None]
        design = regression_design(values)
        statistic = ModeStatistic(rows - rows.mean(axis=0), design, 5)
        (some,) = draw_permutations(design, 99, chunk=99, seed=repeat)
        observed = statistic.studentized(observed_design(design))
        noticed += permutation_p_value(observed, statistic.studentized(some))[0] <= 0.05
    assert 1 <= noticed <= 12  # of 120: the statistic finds 6 on average


def test_small_groups_of_unequal_dispersion_are_scaled_though_all_permutations_are_taken():
    """Without scaling three of four such cohorts, whose means are equal, would be called different."""
    generator = np.random.default_rng(8)
    spread = np.repeat([2.0, 1.0], [5, 6])[:, None, None]
    design = group_design(["a"] * 5 + ["b"] * 6, ["a", "b"])
    result = [mode_test(spread * generator.normal(size=(11, 30, 3)), design, modes=5) for _ in range(15)]
    assert all(test.exact for test in result)
    assert sum(test.p_permutation <= 0.05 for test in result) <= 3
