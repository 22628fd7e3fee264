import numpy as np
import pytest
from statsmodels.multivariate.manova import MANOVA
from statsmodels.stats.multitest import multipletests

from homolog.errors import InputError
from homolog.statistics.design import covariate_columns, group_design, paired_design
from homolog.statistics.pointwise_test import pointwise_test


def _wilks(endog, exog, tested):
    contrast = np.eye(exog.shape[1])[tested]
    return MANOVA(endog, exog).mv_test([("x", contrast)]).results["x"]["stat"].loc["Wilks' lambda"]


@pytest.mark.parametrize("levels", ["ab", "abc"])
def test_each_particle_is_tested_as_statsmodels_tests_it(correlated, covariates, levels):
    shapes, columns = correlated(particles=6), covariate_columns(covariates())
    groups = np.random.default_rng(1).choice(list(levels), 24)
    result = pointwise_test(shapes, group_design(groups.tolist(), list(levels), columns), permutations=9)
    dummies = np.column_stack([groups == level for level in levels[1:]]).astype(float)
    exog = np.column_stack([np.ones(24), columns, dummies])
    tested = list(range(3, exog.shape[1]))
    for particle in range(6):
        wilks = _wilks(shapes[:, particle], exog, tested)
        assert result.explained[particle] == pytest.approx(1.0 - wilks["Value"], abs=1e-8)
        assert result.p_f[particle] == pytest.approx(wilks["Pr > F"], abs=1e-8)
        effect = np.linalg.lstsq(exog, shapes[:, particle], rcond=None)[0][tested]
        np.testing.assert_allclose(result.effect[:, particle], effect, atol=1e-9)


def test_dispersions_that_differ_do_not_make_differences():
    labels = ["a"] * 8 + ["b"] * 12 + ["c"] * 20
    design = group_design(labels, ["a", "b", "c"])
    spread = np.where(np.array(labels) == "c", 3.0, 1.0)[:, None, None]
    generator = np.random.default_rng(6)
    smallest = []
    for repeat in range(150):
        shapes = generator.normal(size=(40, 12, 3)) * spread
        smallest.append(pointwise_test(shapes, design, permutations=99, seed=repeat).p_fwe.min())
    assert 0 < np.count_nonzero(np.array(smallest) <= 0.05) < 17  # 7.5 expected; 18 is beyond 99.9 %


def test_q_values_are_those_of_statsmodels(correlated):
    shapes = correlated()
    shapes[::2, :5] += 4.0
    result = pointwise_test(shapes, group_design(["a", "b"] * 12, ["a", "b"]), permutations=99)
    np.testing.assert_allclose(result.q, multipletests(result.p, method="fdr_bh")[1], atol=1e-12)


def test_a_local_bump_is_found_where_it_is_and_nowhere_else():
    generator = np.random.default_rng(9)
    shapes = generator.normal(size=(30, 200, 3))
    shapes[15:, 40:50, 2] += 3.0
    result = pointwise_test(shapes, group_design(["a"] * 15 + ["b"] * 15, ["a", "b"]), permutations=1000)
    assert np.flatnonzero(result.p_fwe <= 0.05).tolist() == list(range(40, 50))
    np.testing.assert_allclose(result.effect[0, 40:50, 2], 3.0, atol=1.2)


def test_pairs_are_tested_by_flipping_signs(correlated):
    differences = correlated(particles=8)
    differences[:, 3] += 9.0
    result = pointwise_test(differences, paired_design(24), permutations=500)
    positions = differences[:, 3]
    t_squared = (
        24 * positions.mean(axis=0) @ np.linalg.solve(np.cov(positions, rowvar=False), positions.mean(axis=0))
    )
    assert result.explained[3] == pytest.approx(t_squared / (t_squared + 23), rel=1e-8)
    assert result.p_fwe[3] < 0.05


def test_particles_that_do_not_move_have_p_of_one_and_no_nan():
    shapes = np.random.default_rng(1).normal(size=(12, 5, 3))
    shapes[:, 2] = [1.0, 2.0, 3.0]
    shapes[:, 3, 0] = 7.0
    result = pointwise_test(shapes, group_design(["a", "b"] * 6, ["a", "b"]), permutations=99)
    assert result.p[2] == result.p_fwe[2] == 1.0
    for values in (result.explained, result.p, result.p_fwe, result.q, result.effect):
        assert np.isfinite(values).all()


def test_too_few_subjects_for_a_map_are_refused():
    shapes = np.random.default_rng(2).normal(size=(4, 5, 3))
    with pytest.raises(InputError, match="3 degrees of freedom"):
        pointwise_test(shapes, group_design(["a", "b"] * 2, ["a", "b"]), permutations=9)
