"""Comparisons in one call: the same as those of the analysis, for any number of groups."""

from types import SimpleNamespace

import numpy as np
import pytest

import homolog as hl
from homolog.inspection.verdict import Word
from homolog.statistics.comparison import Options
from homolog.statistics.design import covariate_columns
from homolog.statistics.studies import compare_two_groups, regress

QUICK = {"permutations": 199}
FORM = {**QUICK, "alignment": "form"}


@pytest.fixture(scope="module")
def shapes():
    """Return particles (18, 20, 3) [mm] of three groups, the third with a bump."""
    random = np.random.default_rng(2)
    directions = random.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shapes = 10.0 * directions + random.normal(scale=0.1, size=(18, 20, 3))
    shapes[12:, 4] *= 1.3
    return shapes


GROUPS = [None, *5 * ["a"], *6 * ["b"], *6 * ["c"]]
AGES = np.linspace(30.0, 80.0, 18)[np.random.default_rng(0).permutation(18)]


def test_two_groups_are_compared_as_the_analysis_does(shapes):
    missing = np.where(np.arange(18) == 7, np.nan, AGES)  # of a subject who takes no part
    result = hl.compare_groups(shapes, GROUPS, ("a", "c"), covariates={"age": missing}, **FORM)
    part = [index for index, group in enumerate(GROUPS) if group in ("a", "c")]
    expected = compare_two_groups(
        shapes[part],
        [GROUPS[index] for index in part],
        ("a", "c"),
        covariates=covariate_columns({"age": AGES[part].tolist()}),
        options=Options(**QUICK),
    )
    assert result.title == "c - a"
    assert result.subjects.tolist() == part
    assert result.p_adjusted == expected.p_adjusted
    np.testing.assert_array_equal(result.p_fwe, expected.p_fwe)
    assert result.pairwise == ()


def test_numbers_of_a_covariate_that_ends_in_c_are_codes_of_categories(shapes):
    codes = np.arange(18) % 3
    named = hl.compare_groups(
        shapes, GROUPS, ("a", "c"), covariates={"site": [f"s{code}" for code in codes]}, **FORM
    )
    result = hl.compare_groups(shapes, GROUPS, ("a", "c"), covariates={"site:c": codes}, **FORM)
    assert result.p_adjusted == named.p_adjusted
    assert result.test.dof == named.test.dof


def test_several_groups_are_tested_together_and_each_two_of_them(shapes):
    result = hl.compare_groups(shapes, GROUPS, **FORM)
    assert [pair.title for pair in result.pairwise] == ["b - a", "c - a", "c - b"]
    assert result.counts == {"a": 5, "b": 6, "c": 6}
    assert result.p_adjusted < 0.05
    apart = [int(np.argmin(pair.p_fwe)) for pair in result.pairwise[1:]]
    assert apart == [4, 4]
    assert result.pairwise[2].subjects.tolist() == list(range(6, 18))


def test_form_and_shape_are_answered_by_default_each_at_its_own_level(shapes):
    form, shape = hl.compare_groups(shapes, GROUPS, ("a", "c"), **QUICK)
    for result, alignment in ((form, "form"), (shape, "shape")):
        alone = hl.compare_groups(shapes, GROUPS, ("a", "c"), alignment=alignment, **QUICK)
        assert result.p_adjusted == alone.p_adjusted
        np.testing.assert_array_equal(result.p_fwe, alone.p_fwe)
        np.testing.assert_array_equal(result.pointwise.effect, alone.pointwise.effect)


def test_pairs_name_the_pair_of_each_subject_as_on_the_command_line(shapes):
    from homolog.statistics.comparison import Options
    from homolog.statistics.studies import compare_pairs

    names = [*(6 * [None]), *"uvwxyz", *"zyxwvu"]
    result = hl.compare_groups(shapes, GROUPS, ("b", "c"), pairs=names, **FORM)
    options = Options(permutations=QUICK["permutations"])
    same = compare_pairs(shapes, np.arange(6, 12), np.arange(17, 11, -1), "c - b", options=options)
    assert (result.title, result.counts) == ("c - b", {"pairs": 6})
    assert result.test.p_permutation == same.test.p_permutation
    np.testing.assert_array_equal(result.pointwise.effect, same.pointwise.effect)


def test_a_pair_of_groups_may_lack_categories_that_others_have():
    generator = np.random.default_rng(0)
    shapes = 10.0 * generator.normal(size=(30, 3)) + generator.normal(size=(18, 30, 3))
    groups, site = 6 * ["a"] + 6 * ["b"] + 6 * ["c"], 6 * ["s2", "s3"] + 3 * ["s1", "s2"]
    covariates = {"site": site}
    how = {"alignment": "form", "modes": 2, "permutations": 99}
    pair = hl.compare_groups(shapes, groups, covariates=covariates, **how).pairwise[0]
    alone = hl.compare_groups(shapes[:12], groups[:12], covariates={"site": site[:12]}, **how)
    assert pair.title == alone.title == "b - a"
    assert pair.test.f == pytest.approx(alone.test.f)
    assert pair.notes == ()
    covariates["year"] = 12 * [1] + [1, 1, 2, 2, 1, 2]
    pair, *others = hl.compare_groups(shapes, groups, covariates=covariates, **how).pairwise
    assert pair.test.f == pytest.approx(alone.test.f)
    assert [len(item.notes) for item in (pair, *others)] == [1, 0, 0]
    assert pair.notes[0].startswith("year: ")


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ({"groups": GROUPS[:5]}, "'groups': 5 values for 18 subjects"),
        ({"between": ("a", "d"), "pairs": list("uvwxyz") * 3}, "no subject is in 'd'; groups are: a, b, c"),
        ({"between": ("a", "z")}, "no subject is in 'z'"),
        ({"between": ("a",)}, "a comparison needs two"),
        ({"covariates": {"age": [1.0]}}, "'age': 1 values for 18"),
        ({"alignment": "rotated"}, "'rotated': choose from as-it-lies, form, shape"),
        ({"alignment": ("form", "form")}, "each once"),
        ({"pairs": [("a", "b")]}, "`between` chooses the groups"),
        ({"pairs": 9 * ["l", "r"]}, "is between two values"),
        ({"pairs": ["l"], "between": ("a", "b")}, "'pairs': 1 values for 18"),
        ({"permutations": 0}, "must be at least 19"),
        (
            {"covariates": {"age": 18 * [np.nan]}, "names": list("ABCDEFGHIJKLMNOPQR")},
            "no value for B, C",
        ),
    ],
)
def test_what_can_not_be_compared_is_refused(shapes, arguments, fault):
    with pytest.raises(hl.InputError, match=fault):
        hl.compare_groups(shapes, arguments.pop("groups", GROUPS), **(QUICK | arguments))


def test_a_site_that_is_the_group_but_for_one_subject_is_refused_with_numbers(shapes):
    site = ["x" if group in (None, "a") else "y" for group in GROUPS]
    site[2] = "y"
    with pytest.raises(hl.InputError, match=r"site can be estimated by .* alone.* \(variance inflation"):
        hl.compare_groups(shapes, GROUPS, ("a", "b"), covariates={"site": site}, **FORM)


@pytest.fixture
def result(shapes):
    """Return what `hl.compare_groups` needs of a result or project."""
    return SimpleNamespace(
        aligned=shapes,
        alignments=np.tile(np.eye(4), (18, 1, 1)),
        names=tuple("ABCDEFGHIJKLMNOPQR"),
        groups=tuple(GROUPS),
        covariates={"age": [f"{age:.3f}" for age in AGES], "centre": 9 * ["x", "y"]},
        verdict=SimpleNamespace(word=Word.SOUND, cause="", remedy=""),
    )


def test_a_result_brings_its_groups_and_covariates(shapes, result):
    ages = {"age": np.round(AGES, 3)}
    own = hl.compare_groups(result, between=("a", "b"), covariates=["age"], **FORM)
    assert own.p_adjusted == hl.compare_groups(shapes, GROUPS, ("a", "b"), covariates=ages, **FORM).p_adjusted
    assert hl.compare_groups(result, "centre", **FORM).title == "y - x"
    older = hl.regress(result, "age", **FORM)
    assert (older.title, older.p_adjusted) == (
        "age",
        hl.regress(shapes, np.round(AGES, 3), **FORM).p_adjusted,
    )
    with pytest.raises(hl.InputError, match=r"no column 'sex'; columns are age, centre, group"):
        hl.compare_groups(result, covariates=["sex"], **FORM)


def test_a_result_that_is_not_usable_is_not_compared(result):
    result.verdict.word = Word.UNUSABLE
    with pytest.raises(hl.InputError, match="not usable"):
        hl.compare_groups(result, **FORM)


def test_regressions_are_those_of_the_analysis():
    random = np.random.default_rng(4)
    shapes = random.normal(size=(14, 30, 3)) + 10.0 * random.normal(size=(30, 3))
    ages, sex = np.linspace(40.0, 70.0, 14), list("mf" * 7)
    given = {"covariates": {"sex": sex}, "permutations": 199}
    form, shape = hl.regress(shapes, ages, "age", **given)
    columns = covariate_columns({"sex": sex})
    alone = regress(shapes, ages, "age", covariates=columns, options=Options(permutations=199))
    assert form.p_adjusted == alone.test.p_permutation
    np.testing.assert_array_equal(form.pointwise.effect, alone.pointwise.effect)
    assert shape.title == "age"
    assert hl.regress(shapes, ages, "age", alignment="form", **given).p_adjusted == alone.p_adjusted
    with pytest.raises(hl.InputError, match="'age': no value for b"):
        hl.regress(shapes, [40.0, np.nan, *ages[2:]], "age", names=list("abcdefghijklmn"))
    with pytest.raises(hl.InputError, match="contains text"):
        hl.regress(shapes, ["x"] * 7 + ["y"] * 7, "age")


def test_a_comparison_and_a_model_print_as_one_line(shapes):
    for value in (hl.compare_groups(shapes, GROUPS, ("a", "c"), **FORM), hl.ShapeModel().fit(shapes)):
        assert "\n" not in repr(value)
        assert len(repr(value)) < 150


def test_complete_cases_exclude_and_count_subjects_with_missing_values(shapes):
    ages = np.where(np.isin(np.arange(18), [2, 14]), np.nan, AGES)
    with pytest.raises(hl.InputError, match="complete cases"):
        hl.compare_groups(shapes, GROUPS, ("a", "c"), covariates={"age": ages}, **FORM)
    result = hl.compare_groups(
        shapes, GROUPS, ("a", "c"), covariates={"age": ages}, complete_cases=True, **FORM
    )
    kept = [None if index in (2, 14) else group for index, group in enumerate(GROUPS)]
    expected = hl.compare_groups(shapes, kept, ("a", "c"), covariates={"age": AGES}, **FORM)
    assert result.counts == {"a": 4, "c": 5}
    assert result.subjects.tolist() == expected.subjects.tolist()
    np.testing.assert_array_equal(result.p_fwe, expected.p_fwe)
    assert any(
        "2 subjects were excluded for missing values (complete cases): subject 3, subject 15" in caution
        for caution in result.cautions
    )
    values = hl.regress(shapes, ages, "age", complete_cases=True, **FORM)
    assert values.counts == {"all": 16}
    assert not {2, 14} & set(values.subjects.tolist())


def test_complete_cases_exclude_a_subject_whose_pair_or_partner_is_missing(shapes):
    pairs = [None, *"12345", *"12345", "", *6 * "x"]
    result = hl.compare_groups(shapes, GROUPS, ("a", "b"), pairs=pairs, complete_cases=True, **FORM)
    assert result.counts == {"pairs": 5}
    pairs[6] = "alone"
    result = hl.compare_groups(shapes, GROUPS, ("a", "b"), pairs=pairs, complete_cases=True, **FORM)
    assert result.counts == {"pairs": 4}
    assert sum("the other one of their pair is missing" in caution for caution in result.cautions) == 1


def test_a_skewed_size_raises_a_caution(shapes):
    sizes = -np.log(1.0 - (np.arange(18) + 0.5) / 18)
    skewed = shapes * (1.0 + sizes[:, None, None])
    labels = ["a" if index % 3 else "b" for index in range(18)]
    answers = hl.compare_groups(skewed, labels, modes=2, permutations=199)
    assert [any("test of size" in item for item in result.cautions) for result in answers] == [True, True]
    single = hl.compare_groups(skewed, labels, modes=2, permutations=199, alignment="shape")
    assert any("test of size" in item for item in single.cautions)


def test_spellings_of_one_group_or_category_are_told_and_those_of_numbers_are_not(shapes):
    groups = ["Male", *8 * ["male"], *9 * ["female"]]
    groups[1] = "Male"
    scanners = {"scanner:c": ["1", "1.0", *16 * ["2"]], "age": ["40", "40.0", *AGES[2:].tolist()]}
    scanners["scanner:c"][5:9] = ["1", "1.0", "1", "1.0"]
    result = hl.compare_groups(shapes, groups, ("male", "female"), covariates=scanners, modes=2, **FORM)
    remarks = [caution.partition(": ")[2] for caution in result.cautions if "treated as different" in caution]
    assert remarks == [
        "Column 'groups' contains 'Male' and 'male', which were treated as different values.",
        "Column 'scanner:c' contains '1' and '1.0', which were treated as different values.",
    ]
