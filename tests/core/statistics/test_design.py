import numpy as np
import pytest

from homolog.errors import InputError
from homolog.statistics.design import (
    covariate_columns,
    group_design,
    is_missing,
    lookalikes,
    numbers,
    paired_design,
    regression_design,
)
from homolog.statistics.permutation import draw_permutations, permutation_count, permutation_p_value


def test_coefficients_are_those_of_least_squares_with_all_columns(covariates):
    columns = covariate_columns(covariates())
    data = np.random.default_rng(0).normal(size=(24, 7))
    values = np.random.default_rng(1).normal(size=24)
    exog = np.column_stack([np.ones(24), columns, values])
    expected = np.linalg.lstsq(exog, data, rcond=None)[0]
    design = regression_design(values, columns)
    np.testing.assert_allclose(design.coefficients(data)[0], expected[3], atol=1e-10)
    assert design.error_dof == 20


def test_covariates_are_standardised_and_words_become_columns():
    columns = covariate_columns({"age": ["40", "50", "60"], "site": ["b", "a", "c"]})
    np.testing.assert_allclose(columns[:, 0], [-np.sqrt(1.5), 0.0, np.sqrt(1.5)])
    assert columns.shape == (3, 3)
    np.testing.assert_allclose(columns.mean(axis=0), 0.0, atol=1e-12)
    assert columns[0, 1] > 0 > columns[1, 1]


def test_decimals_with_commas_are_the_numbers_that_they_mean():
    np.testing.assert_array_equal(numbers(["40,5", " 41", "-0,125", "1e2"]), [40.5, 41.0, -0.125, 100.0])
    assert numbers(["40,5", "a,5"]) is None
    assert covariate_columns({"age": ["40,5", "41,25", "39"]}).shape == (3, 1)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"age": ["40", "", "60"]}, "'age': no value for Ben"),
        ({"age": [40.0, 50.0, np.nan]}, "'age': no value for Cleo"),
        ({"sex": ["m", "NA", "f"]}, "'sex': no value for Ben"),
        ({"age": ["40", "40", "40"]}, "'age' is the same for all compared subjects"),
        ({"sex": ["m", "m", "m"]}, "'sex' is the same for all compared subjects"),
        ({"dose": ["1,250", "900", "1,100"]}, "'dose': 1,250 may be a decimal number or thousands"),
        ({"age": ["40", "?", "60"]}, "'age' contains numbers, but also '\\?' of Ben"),
        ({"age": ["40", "30 y", "60"]}, "'30 y' of Ben"),
        ({"age": [40.0, np.inf, 60.0]}, "inf of Ben is not finite"),
    ],
)
def test_covariates_that_are_missing_or_constant_are_refused_by_name(table, message):
    with pytest.raises(InputError, match=message):
        covariate_columns(table, ["Ann", "Ben", "Cleo"])


def test_spellings_of_one_category_are_found_and_other_values_are_not():
    assert lookalikes(["Male", "male", "female", "1", "1.0", "NA", "na", "2"]) == [
        ("Male", "male"),
        ("1", "1.0"),
    ]
    assert lookalikes(["a", "b", ""]) == []


def test_numbers_are_columns_of_categories_where_that_is_declared():
    codes = {"site": ["1", "2", "3", "1", "2", "3"]}
    assert covariate_columns(codes).shape == (6, 1)
    assert covariate_columns(codes, categories={"site"}).shape == (6, 2)


@pytest.mark.parametrize(
    ("groups", "order", "message"),
    [
        (["a", "a", "a", "b"], ["a", "b"], "'b' has 1 of the two or more subjects"),
        (["a", "a", "b", "b"], ["a", "c"], "'b' is not among those compared"),
        (["a", "a", "b", "b"], ["a"], "two or more different groups"),
        (["a", "a", "b", "b"], ["a", "a"], "two or more different groups"),
    ],
)
def test_groups_that_cannot_be_compared_are_refused(groups, order, message):
    with pytest.raises(InputError, match=message):
        group_design(groups, order)


def test_a_covariate_that_is_the_group_is_refused():
    sex = covariate_columns({"sex": ["m", "f"] * 5})
    with pytest.raises(InputError, match="is confounded with"):
        group_design(["a", "b"] * 5, ["a", "b"], sex)


def test_two_covariates_that_say_the_same_are_refused():
    age = np.arange(10.0)
    both = covariate_columns({"age": age.tolist(), "months": (12 * age).tolist()})
    with pytest.raises(InputError, match="combination of the others"):
        group_design(["a", "b"] * 5, ["a", "b"], both)


def test_too_many_covariates_for_the_subjects_are_refused():
    table = {f"c{index}": np.random.default_rng(index).normal(size=6).tolist() for index in range(4)}
    with pytest.raises(InputError, match=r"6 subjects .* 6 columns"):
        group_design(["a", "b"] * 3, ["a", "b"], covariate_columns(table))


@pytest.mark.parametrize("cell", ["", " ", "NA", "na", "N/A", "n/a", "nan", "NaN", "None", "null", np.nan])
def test_missing_values_have_many_spellings(cell):
    assert is_missing(cell)
    with pytest.raises(InputError, match="no value for"):
        covariate_columns({"age": [1.0, 2.0, cell, 3.0]})


@pytest.mark.parametrize(
    ("values", "message"), [([1.0, 1.0, 1.0, 1.0], "the same for all"), ([1.0, np.nan, 2.0, 3.0], "missing")]
)
def test_variables_that_cannot_be_regressed_on_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        regression_design(np.array(values))


def test_relabellings_keep_group_sizes_and_do_not_depend_on_the_chunk():
    design = group_design(["a"] * 3 + ["b"] * 5, ["a", "b"])
    whole = next(iter(draw_permutations(design, 50, chunk=50, seed=4))).tested
    parts = np.concatenate([some.tested for some in draw_permutations(design, 50, chunk=7, seed=4)])
    np.testing.assert_array_equal(whole, parts)
    np.testing.assert_allclose(np.sort(whole[:, :, 0]), np.sort(np.repeat(design.tested.T, 50, axis=0)))


def test_pairs_are_relabelled_by_signs():
    flipped = next(iter(draw_permutations(paired_design(16), 200, chunk=200, seed=0))).tested[:, :, 0]
    np.testing.assert_allclose(np.abs(flipped), 0.25)
    assert len(np.unique(flipped, axis=0)) > 190


@pytest.mark.parametrize(
    ("design", "different"),
    [
        (paired_design(4), 16),
        (group_design(["a", "b", "a", "b", "b"], ["a", "b"]), 10),
        (group_design(["a", "b", "c"] * 2, ["a", "b", "c"]), 90),
        (regression_design(np.array([1.0, 2.0, 4.0, 4.0])), 12),
    ],
)
def test_small_designs_are_relabelled_in_each_way_once(design, different):
    assert permutation_count(design, 200) == (different - 1, True)
    rows = [some.tested for some in draw_permutations(design, 200, chunk=7, seed=0)]
    everything = np.concatenate([*rows, design.tested[None]]).round(9)
    assert len(everything) == len(np.unique(everything, axis=0)) == different
    assert permutation_count(design, 5) == (5, False)


def test_counted_p_counts_ties_and_the_real_labels():
    drawn = np.array([1.0, 2.0, 2.0, 3.0])
    np.testing.assert_allclose(permutation_p_value(np.array([2.0, 5.0, 0.0]), drawn), [4 / 5, 1 / 5, 1.0])
    assert permutation_p_value(2.0 * (1 + 1e-12), drawn) == pytest.approx(4 / 5)
