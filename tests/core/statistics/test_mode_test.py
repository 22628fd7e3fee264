import numpy as np
import pytest
from scipy import stats
from statsmodels.multivariate.manova import MANOVA
from statsmodels.regression.linear_model import OLS

from homolog.errors import Cancelled, InputError
from homolog.statistics.design import covariate_columns, group_design, paired_design, regression_design
from homolog.statistics.mode_test import mode_test


def _scores(residuals, modes):
    _, _, vt = np.linalg.svd(residuals, full_matrices=False)
    return vt[:modes]


def _manova(endog, exog, tested):
    """Wilks' row and Pillai's value of statsmodels for the given columns of the design."""
    contrast = np.eye(exog.shape[1])[tested]
    table = MANOVA(endog, exog).mv_test([("effect", contrast)]).results["effect"]["stat"]
    return table.loc["Wilks' lambda"], table.loc["Pillai's trace"]


def test_t_squared_of_two_groups_is_that_of_its_definition(correlated):
    shapes = correlated()
    result = mode_test(shapes, group_design(["a"] * 9 + ["b"] * 15, ["a", "b"]), modes=3, permutations=9)
    rows = shapes.reshape(24, -1)
    scores = (rows - rows.mean(axis=0)) @ _scores(rows - rows.mean(axis=0), 3).T
    first, second = scores[:9], scores[9:]
    apart = first.mean(axis=0) - second.mean(axis=0)
    pooled = (8 * np.cov(first, rowvar=False) + 14 * np.cov(second, rowvar=False)) / 22
    square = apart @ np.linalg.solve(pooled, apart)
    t_squared = 9 * 15 / 24 * square
    f = t_squared * (24 - 3 - 1) / (3 * 22)
    assert result.t_squared == pytest.approx(t_squared, rel=1e-8)
    assert result.mahalanobis == pytest.approx(np.sqrt(square), rel=1e-8)
    assert result.f == pytest.approx(f, rel=1e-8)
    assert result.dof == (3.0, 20.0)
    assert result.p == pytest.approx(stats.f.sf(f, 3, 20), abs=1e-8)


@pytest.mark.parametrize("modes", [2, 3, 4])
def test_three_groups_with_covariates_give_the_manova_of_statsmodels(correlated, covariates, modes):
    shapes, table = correlated(), covariates()
    groups = np.random.default_rng(1).choice(["x", "y", "z"], 24).tolist()
    columns = covariate_columns(table)
    design = group_design(groups, ["x", "y", "z"], columns)
    result = mode_test(shapes, design, modes=modes, permutations=9)
    rows = shapes.reshape(24, -1)
    nuisance = np.column_stack([np.ones(24), columns])
    residuals = rows - nuisance @ np.linalg.lstsq(nuisance, rows, rcond=None)[0]
    endog = rows @ _scores(residuals, modes).T
    dummies = np.column_stack([np.array(groups) == level for level in "yz"]).astype(float)
    wilks, pillai = _manova(endog, np.column_stack([nuisance, dummies]), [3, 4])
    assert result.wilks == pytest.approx(wilks["Value"], rel=1e-8)
    assert result.pillai == pytest.approx(pillai["Value"], rel=1e-8)
    assert result.f == pytest.approx(wilks["F Value"], rel=1e-8)
    assert result.dof == pytest.approx((wilks["Num DF"], wilks["Den DF"]))
    assert result.p == pytest.approx(wilks["Pr > F"], abs=1e-8)
    assert result.t_squared is None


def test_regression_on_a_variable_gives_the_manova_of_statsmodels(correlated):
    shapes = correlated()
    values = np.random.default_rng(8).normal(50.0, 9.0, 24)
    result = mode_test(shapes, regression_design(values), modes=3, permutations=9)
    rows = shapes.reshape(24, -1) - shapes.reshape(24, -1).mean(axis=0)
    wilks, _ = _manova(rows @ _scores(rows, 3).T, np.column_stack([np.ones(24), values]), [1])
    assert result.p == pytest.approx(wilks["Pr > F"], abs=1e-8)


def test_one_mode_gives_the_f_test_of_ordinary_least_squares(correlated, covariates):
    shapes, columns = correlated(), covariate_columns(covariates())
    result = mode_test(shapes, group_design(["a", "b"] * 12, ["a", "b"], columns), modes=1, permutations=9)
    rows = shapes.reshape(24, -1)
    nuisance = np.column_stack([np.ones(24), columns])
    residuals = rows - nuisance @ np.linalg.lstsq(nuisance, rows, rcond=None)[0]
    fit = OLS(rows @ _scores(residuals, 1)[0], np.column_stack([nuisance, np.tile([0.0, 1.0], 12)])).fit()
    assert result.f == pytest.approx(fit.tvalues[3] ** 2, rel=1e-8)
    assert result.p == pytest.approx(fit.pvalues[3], abs=1e-8)


def test_pairs_give_the_one_sample_t_squared(correlated):
    differences = correlated() + 0.5
    result = mode_test(differences, paired_design(24), modes=3, permutations=9)
    rows = differences.reshape(24, -1)
    scores = rows @ _scores(rows, 3).T
    mean = scores.mean(axis=0)
    t_squared = 24 * mean @ np.linalg.solve(np.cov(scores, rowvar=False), mean)
    f = t_squared * (24 - 3) / (3 * 23)
    assert result.t_squared == pytest.approx(t_squared, rel=1e-8)
    assert result.p == pytest.approx(stats.f.sf(f, 3, 21), abs=1e-8)


def test_permutation_p_is_near_the_parametric_one_for_normal_data(correlated):
    result = mode_test(correlated(seed=4), group_design(["a", "b"] * 12, ["a", "b"]), permutations=4000)
    assert result.p_modes == pytest.approx(result.p, abs=0.03)


def test_a_difference_that_is_there_is_found(correlated):
    shapes = correlated()
    shapes[:12] += 8.0 * np.random.default_rng(1).normal(size=shapes.shape[1:])
    result = mode_test(shapes, group_design(["a"] * 12 + ["b"] * 12, ["a", "b"]), permutations=999)
    assert result.p < 0.01
    assert result.p_permutation == pytest.approx(0.001)


def test_noise_that_keeps_no_mode_has_p_of_one_and_says_so():
    noise = np.random.default_rng(1).normal(size=(20, 64, 3))
    result = mode_test(noise, group_design(["a", "b"] * 10, ["a", "b"]), permutations=99)
    assert result.modes == 0
    assert (result.p, result.p_modes, result.t_squared, result.f) == (1.0, 1.0, 0.0, 0.0)
    assert 0.0 < result.p_permutation <= 1.0
    assert len(result.warnings) == 1


def test_few_degrees_of_freedom_are_warned_of_and_too_few_refused(correlated):
    shapes = correlated(subjects=10)
    design = group_design(["a", "b"] * 5, ["a", "b"])
    assert "8 degrees of freedom" in mode_test(shapes, design, modes=4, permutations=9).warnings[0]
    with pytest.raises(InputError, match=r"9 modes .* 8 .* 10 subjects"):
        mode_test(shapes, design, modes=9, permutations=9)


def test_the_test_stops_where_it_is_cancelled(correlated):
    def cancel(fraction, message):
        if fraction > 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        mode_test(correlated(), group_design(["a", "b"] * 12, ["a", "b"]), tick=cancel)
