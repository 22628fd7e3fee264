import re

import numpy as np
import pandas as pd
import pytest
import statsmodels.formula.api as smf
from statsmodels.stats.anova import anova_lm

from homolog.errors import InputError
from homolog.statistics.design import (
    Squares,
    covariate_columns,
    group_design,
    is_missing,
    lookalikes,
    make_design,
    numbers,
    refuse_repeated,
    regression_design,
    shorthand,
)


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


def cohort(rows=40):
    """Return columns of a table, and a number that depends on them."""
    generator = np.random.default_rng(0)
    table = {
        "group": np.resize(list("abc"), rows).tolist(),
        "sex": generator.choice(["f", "m"], rows).tolist(),
    }
    table["age"] = generator.normal(60.0, 5.0, rows).tolist()
    return table, generator.normal(size=rows) + 0.1 * np.array(table["age"])


@pytest.mark.parametrize(
    ("squares", "formula"),
    [
        (Squares.SEQUENTIAL, "y ~ group + sex + group:sex"),
        (Squares.MARGINAL, "y ~ group * age + sex"),
        (Squares.PARTIAL, "y ~ C(group, Sum) * age + C(sex, Sum)"),
    ],
)
def test_sums_of_squares_of_each_type_are_those_of_statsmodels(squares, formula):
    table, y = cohort()
    fit = smf.ols(formula, pd.DataFrame(table | {"y": y})).fit()
    expected = anova_lm(fit, typ=int(squares))["sum_sq"].to_dict()
    plain = formula.replace("C(", "").replace(", Sum)", "").removeprefix("y ")
    design = make_design(plain, table)
    for term in design.terms:
        ours = np.square(design.hypothesis(term.name, squares).tested.T @ y).sum()
        names = {name.replace("C(", "").replace(", Sum)", ""): value for name, value in expected.items()}
        assert ours == pytest.approx(names[term.name], rel=1e-8)


def test_adjusted_means_and_slopes_are_combinations_of_the_coefficients_of_statsmodels():
    table, y = cohort()
    fit = smf.ols("y ~ group * age + sex", pd.DataFrame(table | {"y": y})).fit()
    design = make_design("~ group * age + sex", table)
    assert [item.name for item in design.differences("group")] == ["b - a", "c - a", "c - b"]
    difference = design.differences("group")[0].coefficients(y[:, None])[0, 0]
    mean = np.mean(table["age"])
    assert difference == pytest.approx(
        fit.params["group[T.b]"] + mean * fit.params["group[T.b]:age"], rel=1e-8
    )
    slopes = [item.coefficients(y[:, None])[0, 0] for item in design.slopes("age", "group")]
    expected = fit.params["age"] + np.array([0.0, *fit.params[["group[T.b]:age", "group[T.c]:age"]]])
    np.testing.assert_allclose(slopes, expected, rtol=1e-8)
    apart = design.slope_differences("age", "group")[2]
    assert (apart.name, apart.coefficients(y[:, None])[0, 0]) == (
        "age, c - b",
        pytest.approx(slopes[2] - slopes[1]),
    )


def test_a_common_slope_is_the_interaction_that_the_design_may_lack():
    table, _ = cohort()
    lacking, has = (make_design(formula, table) for formula in ("~ group + age", "~ group * age"))
    ours, expected = lacking.common_slope("age", "group"), has.hypothesis("group:age")
    np.testing.assert_allclose(ours.tested @ ours.tested.T, expected.tested @ expected.tested.T, atol=1e-9)


def test_strata_are_removed_before_terms():
    table, y = cohort()
    design = make_design("~ age", table, strata=table["sex"])
    other = make_design("~ sex + age", table)
    for one, two in ((design.hypothesis("age"), other.hypothesis("age")),):
        assert (one.tested.T @ y)[0] ** 2 == pytest.approx((two.tested.T @ y)[0] ** 2)


@pytest.mark.parametrize(
    ("formula", "table", "message"),
    [
        ("~ group + oops", {}, "no column 'oops'; columns are: group, sex, age"),
        ("~ log(age)", {}, "'log(age)' is not a column"),
        ("~ group +", {}, "can't be read"),
        ("~ age | group", {}, "can't be read; use columns"),
        ("~ .", {}, "can't be read; use columns"),
        ("~ 0 + group", {}, "the intercept belongs to every design"),
        ("shape ~ group", {}, "begin with '~'"),
        ("~ 1", {}, "name a column"),
        (
            "~ group + other",
            {"other": np.resize(["x", "y", "z"], 40).tolist()},
            "other can't be told from group",
        ),
        (
            "~ sex * half",
            {"sex": ["f"] * 20 + ["m"] * 20, "half": ["x"] * 10 + ["y"] * 30},
            "sex m and half x",
        ),
        ("~ sex + one", {"one": ["x"] * 39 + ["y"]}, "one 'y' has 1 of the two"),
        ("~ sex + same", {"same": ["x"] * 40}, "same is the same for all"),
    ],
)
def test_designs_that_cannot_be_estimated_are_refused_with_the_reason(formula, table, message):
    with pytest.raises(InputError, match=re.escape(message)):
        make_design(formula, cohort()[0] | table)


def test_a_term_that_hangs_on_one_subject_is_refused_with_its_variance_inflation():
    table = {"group": list("aaaaaaaaaabbbbbbbbbb"), "site": list("xxxxxxxxxxyyyyyyyyyx")}
    with pytest.raises(InputError, match=r"by p20 alone.*variance inflation 5\.5"):
        make_design("~ group + site", table, names=[f"p{k + 1}" for k in range(20)])


def test_too_few_rows_for_so_many_terms_are_refused():
    table = {name: np.random.default_rng(k).normal(size=6).tolist() for k, name in enumerate("abcdef")}
    with pytest.raises(
        InputError, match=r"6 rows are too few for ~ a [+] b [+] c [+] d [+] e, which has 6 columns"
    ):
        make_design("~ a + b + c + d + e", table)


def test_the_variance_inflation_of_a_number_is_that_of_its_regression_on_the_others():
    generator = np.random.default_rng(1)
    first = generator.normal(size=50)
    second = first + generator.normal(size=50)
    design = make_design("~ first + second", {"first": first.tolist(), "second": second.tolist()})
    expected = 1.0 / (1.0 - np.corrcoef(first, second)[0, 1] ** 2)
    assert [term.inflation for term in design.terms] == pytest.approx([expected, expected])


def test_rows_of_one_subject_are_refused_without_a_column_of_subjects():
    with pytest.raises(InputError, match="p1 stands in more than one row"):
        refuse_repeated(["p1", "p2", "p1"], {}, {}, "~ group")
    names = [f"row {number}" for number in range(20)]
    patients = [f"p{number // 2}" for number in range(20)]
    with pytest.raises(InputError, match="column 'patient' names 10 subjects in 20 rows"):
        refuse_repeated(names, {"patient": patients}, {}, "~ group")
    visits = {"time": [number % 3 for number in range(30)]}
    fewer = [number for number in range(30) if number not in (5, 11, 14)]  # some miss the last visit
    patients = [f"p{number // 3}" for number in fewer]
    with pytest.raises(InputError, match="column 'patient' names 10 subjects in 27 rows"):
        refuse_repeated(
            [f"row {number}" for number in fewer],
            {"patient": patients},
            {"time": [visits["time"][number] for number in fewer]},
            "~ time",
        )
    small = {"patient": list("aabbccddeeff"), "eye": ["left", "right"] * 6}
    with pytest.raises(InputError, match="column 'patient' names 6 subjects in 12 rows"):
        refuse_repeated(names[:12], small, {}, "~ group")
    with pytest.raises(InputError, match="p1 stands in more than one row"):
        refuse_repeated(names[:4], {"subject": ["p1", "p2", "p3", "p1"]}, {}, "~ group")


@pytest.mark.parametrize("form", ["p{}_{}", "heart-{}_{}", "p{}-{}_wall"])
def test_names_that_number_the_rows_of_a_subject_are_refused_without_a_column_of_subjects(form):
    names = [form.format(number // 2, ("ED", "ES")[number % 2]) for number in range(16)]
    with pytest.raises(InputError, match=r"by their names .* of 8 subjects.*add a column 'subject'"):
        refuse_repeated(names, {}, {}, "~ group")
    refuse_repeated(names, {"subject": names}, {}, "~ group")
    refuse_repeated([f"{'ab'[number % 2]}_{number}" for number in range(16)], {}, {}, "~ group")
    refuse_repeated([f"site{number % 8}_{number:03d}" for number in range(16)], {}, {}, "~ group")


def test_a_balanced_grade_does_not_name_subjects():
    names = [f"row {number}" for number in range(12)]
    ages = {"age": list(range(40, 52))}
    refuse_repeated(names, {"grade": [number % 4 for number in range(12)]}, ages, "~ age")


def test_few_rows_at_each_of_many_sites_are_no_subjects():
    sites = [f"s{number}" for number, count in enumerate((2, 3, 2, 4, 2, 3, 2, 2)) for _ in range(count)]
    generator = np.random.default_rng(2)
    table = {
        "group": generator.choice(["a", "b"], len(sites)).tolist(),
        "age": generator.normal(50.0, 8.0, len(sites)).round(1).tolist(),
        "year": generator.integers(1950, 1975, len(sites)).tolist(),
    }
    names = [f"row {number}" for number in range(len(sites))]
    refuse_repeated(names, {"site": sites, "scanner": [*sites[:-1], ""], **table}, {}, "~ age")


def test_simple_questions_are_formulas():
    assert shorthand("group", ["age", "shape-size"]) == "~ age + `shape-size` + group"
    assert shorthand("group", ["visit"], interaction=True) == "~ visit + group + visit:group"
