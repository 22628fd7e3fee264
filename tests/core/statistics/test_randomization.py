import numpy as np
import pytest
from scipy import stats

from homolog.statistics.design import (
    group_design,
    make_design,
    paired_design,
    regression_design,
)
from homolog.statistics.mode_test import mode_test
from homolog.statistics.randomization import Randomization, dispersions, p_values


def made(units, tested=1):
    """Return data, and a hypothesis on random columns with a covariate, of the given units."""
    generator = np.random.default_rng(3)
    table = {"age": generator.normal(size=len(units)).tolist()}
    table |= {"group": np.resize(list("abc"[: tested + 1]), len(units)).tolist()}
    subject = None if len(set(units)) == len(units) else [str(unit) for unit in units]
    design = make_design("~ age + group", table, subject=subject)
    return generator.normal(size=(len(units), 4, 3)), design.hypothesis("group")


def refitted(flat, hypothesis):
    """Return coefficients and what each unit contributes to their variance (CR2), from its own algebra."""
    columns = np.hstack([hypothesis.tested, hypothesis.nuisance])
    rest = flat - columns @ (columns.T @ flat)
    parts = []
    for unit in range(hypothesis.n_units):
        own = np.flatnonzero(hypothesis.units == unit)
        values, vectors = np.linalg.eigh(np.eye(len(own)) - columns[own] @ columns[own].T)
        parts.append(hypothesis.tested[own].T @ (vectors / np.sqrt(values)) @ vectors.T @ rest[own])
    return hypothesis.tested.T @ flat, np.array(parts)


@pytest.mark.parametrize(("units", "tested"), [(range(20), 1), (np.repeat(np.arange(14), 2), 2)])
def test_statistics_of_flipped_residuals_are_those_of_refitted_data(units, tested):
    data, hypothesis = made(units, tested)
    flat = data.reshape(len(data), -1)
    spread = dispersions(hypothesis, flat)
    weighted = hypothesis.nuisance / spread[:, None]
    fitted = hypothesis.nuisance @ np.linalg.lstsq(weighted, flat / spread[:, None], rcond=None)[0]
    signs = np.random.default_rng(1).choice([-1.0, 1.0], size=hypothesis.n_units)[hypothesis.units]
    coefficients, parts = refitted(signs[:, None] * (flat - fitted), hypothesis)
    drawn = Randomization(hypothesis, flat)
    walds = drawn.wald(data)(lambda rows: (rows.T * signs).T[None])[0]
    for place in range(4):
        own = coefficients.reshape(tested, 4, 3)[:, place].ravel()
        each = parts.reshape(-1, tested, 4, 3)[:, :, place].reshape(len(parts), -1)
        assert walds[place] == pytest.approx(own @ np.linalg.solve(each.T @ each, own), rel=1e-8)
    coefficients, parts = refitted(flat - fitted, hypothesis)
    expected = np.square(coefficients).sum() / np.square(parts).sum()
    error = spread * np.eye(len(flat))
    error -= hypothesis.nuisance @ np.linalg.lstsq(weighted, error / spread[:, None], rcond=None)[0]
    coefficients, parts = refitted(error, hypothesis)
    expected /= np.square(coefficients).sum() / np.square(parts).sum()
    assert drawn.ratio(flat).statistic == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("counts", [(7, 12), (4, 5)])
def test_of_two_groups_and_one_number_the_statistic_is_the_square_of_welch_t(counts):
    labels = ["a"] * counts[0] + ["b"] * counts[1]
    values = np.random.default_rng(3).normal(size=(sum(counts), 5)) * 2.0
    result = Randomization(group_design(labels, ["a", "b"]), draws=19).surface(values[:, :, None])
    t = stats.ttest_ind(values[: counts[0]], values[counts[0] :], equal_var=False).statistic
    np.testing.assert_allclose(result.statistic, np.square(t), rtol=1e-9)


def test_p_of_pairs_is_the_exact_test_of_their_signs():
    differences = np.random.default_rng(2).normal(0.5, 1.0, size=(9, 1))
    drawn = Randomization(paired_design(9))
    assert (drawn.count, drawn.exact) == (2**8 - 1, True)
    signs = 1.0 - 2.0 * ((np.arange(2**9)[:, None] >> np.arange(9)) & 1)
    means = np.abs(signs @ differences[:, 0])
    assert drawn.ratio(differences).p == pytest.approx(np.mean(means >= means[0] - 1e-12))


def test_a_subject_column_of_two_visits_gives_the_test_of_pairs():
    generator = np.random.default_rng(5)
    first = generator.normal(size=(9, 6))
    second = first + 0.3 * generator.normal(size=(9, 6)) + 0.2
    table = {"visit": ["1"] * 9 + ["2"] * 9}
    design = make_design("~ visit", table, subject=[str(k) for k in range(9)] * 2, categories=["visit"])
    both = Randomization(design.hypothesis("visit")).ratio(np.vstack([first, second]))
    assert both.p == pytest.approx(Randomization(paired_design(9)).ratio(second - first).p)


def test_few_rows_along_a_number_are_permuted_and_groups_and_many_rows_flipped():
    number = regression_design(np.arange(7.0) ** 2)
    groups = group_design(["a"] * 4 + ["b"] * 4, ["a", "b"])
    assert Randomization(number).permuted
    assert Randomization(number).count == 5039
    assert not Randomization(groups).permuted
    assert Randomization(groups).count == 127
    assert not Randomization(regression_design(np.arange(13.0))).permuted


def test_a_strong_effect_in_eight_rows_is_found():
    """The smallest p of permutations is far below that of 128 flips."""
    ages = np.arange(8.0)
    shapes = np.random.default_rng(1).normal(size=(8, 90)) + ages[:, None]
    assert Randomization(regression_design(ages)).ratio(shapes).p < 0.001


def test_randomizations_do_not_depend_on_the_number_of_processors(monkeypatch):
    data, hypothesis = made(range(24))
    results = []
    for cores in (1, 3):
        monkeypatch.setattr("homolog.statistics.randomization.cores", lambda cores=cores: cores)
        results.append(Randomization(hypothesis, draws=300, seed=4).surface(data).p)
    np.testing.assert_array_equal(*results)


def test_dispersions_are_those_of_groups_and_grow_along_a_number():
    generator = np.random.default_rng(5)
    rows = generator.normal(size=(90, 200)) * np.repeat([3.0, 1.0], [30, 60])[:, None]
    spread = dispersions(group_design(["a"] * 30 + ["b"] * 60, ["a", "b"]), rows)
    assert spread[0] / spread[-1] == pytest.approx(3.0, rel=0.05)
    ages = generator.uniform(-1.0, 1.0, size=300)
    spread = dispersions(regression_design(ages), generator.normal(size=(300, 9)) * np.exp(ages)[:, None])
    assert np.polyfit(ages, np.log(spread), 1)[0] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("pattern", [False, True])
def test_dispersions_of_other_amount_or_pattern_leave_the_level_as_it_is(pattern):
    """Permutations of subjects find an effect in more than half of the first, at particles of the second."""
    generator = np.random.default_rng(8)
    hypothesis = group_design(["a"] * 8 + ["b"] * 24, ["a", "b"])
    spread = np.where(np.arange(40) < 20, 1.8, 0.2) if pattern else np.full(40, 4.0)
    others = 2.0 - spread if pattern else np.ones(40)
    scale = np.vstack([np.tile(spread, (8, 1)), np.tile(others, (24, 1))])
    found = np.zeros(2)
    for repeat in range(100):
        shapes = generator.normal(size=(32, 40, 3)) * np.sqrt(scale)[:, :, None]
        drawn = Randomization(hypothesis, shapes.reshape(32, -1), draws=99, seed=repeat)
        found += drawn.ratio(shapes.reshape(32, -1)).p <= 0.05, drawn.surface(shapes).p_fwe.min() <= 0.05
    assert (found <= 11).all()  # of 100; by chance in one of 100 such tests


def test_designs_whose_p_cannot_reach_the_level_say_so():
    generator = np.random.default_rng(2)
    for first, second, few in ((3, 3, True), (2, 4, True), (3, 4, False), (4, 4, False)):
        labels = ["a"] * first + ["b"] * second
        shapes = generator.normal(size=(len(labels), 12, 3))
        shapes[:first] += 100.0
        test = mode_test(shapes, group_design(labels, ["a", "b"]), permutations=999)
        assert any(warning.startswith("Too few subjects") for warning in test.warnings) == few
        assert (test.whole.p > 0.05) == few
    pairs = mode_test(generator.normal(size=(5, 12, 3)) + 100.0, paired_design(5), permutations=999)
    assert "16 distinct arrangements" in pairs.warnings[0]


def test_counted_p_counts_ties_and_the_observed_labels():
    drawn = np.array([1.0, 2.0, 2.0, 3.0])
    np.testing.assert_allclose(p_values(np.array([2.0, 5.0, 0.0]), drawn), [4 / 5, 1 / 5, 1.0])
    assert p_values(2.0 * (1 + 1e-12), drawn) == pytest.approx(4 / 5)
