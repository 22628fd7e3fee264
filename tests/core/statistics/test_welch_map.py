import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests

from homolog.errors import InputError
from homolog.statistics.welch import welch_map


def _groups(seed=0):
    generator = np.random.default_rng(seed)
    second = np.arange(22) < 9
    values = generator.normal(size=(22, 40)) * np.where(second, 3.0, 1.0)[:, None]
    return values, second


def test_t_and_p_are_those_of_scipy():
    values, second = _groups()
    result = welch_map(values, second, permutations=9)
    oracle = stats.ttest_ind(values[second], values[~second], equal_var=False)
    np.testing.assert_allclose(result.t, oracle.statistic, rtol=1e-9)
    np.testing.assert_allclose(result.p, oracle.pvalue, rtol=1e-8)
    np.testing.assert_allclose(result.q, multipletests(result.p, method="fdr_bh")[1], atol=1e-12)
    np.testing.assert_allclose(result.difference, values[second].mean(axis=0) - values[~second].mean(axis=0))


def test_the_correction_counts_the_most_unlikely_t_of_each_relabelling():
    values, second = _groups()
    values[second, 7] += 8.0
    result = welch_map(values, second, permutations=300, seed=2)
    generator, largest = np.random.default_rng(5), []
    for _ in range(300):
        mixed = generator.permutation(second)
        oracle = stats.ttest_ind(values[mixed], values[~mixed], equal_var=False)
        largest.append(stats.norm.isf(oracle.pvalue / 2).max())
    deviates = stats.norm.isf(result.p / 2)
    expected = [(np.count_nonzero(largest >= deviate) + 1) / 301 for deviate in deviates]
    np.testing.assert_allclose(result.p_fwe, expected, atol=0.08)
    assert np.flatnonzero(result.p_fwe <= 0.05).tolist() == [7]


def test_values_that_do_not_vary_have_p_of_one_and_no_nan():
    values, second = _groups()
    values[:, 3] = 5.0
    result = welch_map(values, second, permutations=50)
    assert (result.t[3], result.p[3], result.p_fwe[3]) == (0.0, 1.0, 1.0)
    assert np.isfinite([result.difference, result.t, result.p, result.p_fwe, result.q]).all()


def test_a_group_of_one_is_refused():
    values, _ = _groups()
    with pytest.raises(InputError, match="subjects in each group"):
        welch_map(values, np.arange(22) < 1)
