"""Cautions: raised where a test's assumptions fail, and only there."""

import numpy as np
import pytest

import homolog as hl
from homolog.statistics.assumptions import outliers_by, relative_distances, size_skewness
from homolog.statistics.cautions import outlier_caution, size_caution
from homolog.statistics.design import group_design, paired_design

LABELS = 8 * ["a"] + 14 * ["b"] + 20 * ["c"]


def _shapes(spread, seed=0):
    """Return particles (42, 30, 3) [mm] of which each subject differs from the mean by its spread."""
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return 20.0 * directions + np.asarray(spread)[:, None, None] * generator.normal(size=(42, 30, 3))


def test_three_groups_of_unequal_dispersion_raise_a_caution_in_the_api():
    shapes = _shapes(np.where(np.array(LABELS) == "a", 2.0, 1.0))
    result = hl.compare_groups(shapes, LABELS, modes=3, permutations=99, alignment="form")
    assert result.title == "a, b, c"
    assert any("differ in covariance" in caution for caution in result.cautions)
    raised = {
        pair.title: any("differ in covariance" in item for item in pair.cautions) for pair in result.pairwise
    }
    assert raised == {"b - a": True, "c - a": True, "c - b": False}


@pytest.mark.parametrize(
    ("first", "factor", "raised"),
    [(8, 1.0, "number of subjects"), (21, 3.0, "dispersion of size"), (21, 1.0, None)],
)
def test_skewed_sizes_raise_a_caution_where_groups_differ_in_number_or_dispersion(first, factor, raised):
    labels = np.array(first * ["a"] + (42 - first) * ["b"])
    skewed = np.concatenate([_quantiles(first) * factor, _quantiles(42 - first)])
    design, members = group_design(labels.tolist(), ["a", "b"]), {name: labels == name for name in "ab"}
    counts = {"a": first, "b": 42 - first}
    shapes = _shapes(np.ones(42))
    caution = size_caution(size_skewness(50.0 + skewed, shapes, design, members), counts)
    assert (raised in caution) if raised else caution == ""
    even = 50.0 + np.arange(42.0)
    assert size_caution(size_skewness(even, shapes, design, members), counts) == ""
    skewed_shapes = shapes + skewed[:, None, None] * shapes[0]
    caution = size_caution(size_skewness(even, skewed_shapes, design, members), counts)
    assert ("shapes are skewed" in caution) == (first == 8)


def _quantiles(count):
    """Return values (count,) that are distributed exponentially."""
    return -np.log(1.0 - (np.arange(count) + 0.5) / count)


def test_skewed_differences_of_pairs_raise_a_caution():
    result = size_skewness(_quantiles(15), _shapes(np.ones(42))[:15], paired_design(15), {})
    assert "symmetric" in size_caution(result, {"pairs": 15})


def test_an_outlier_is_found_in_its_group_whatever_the_groups_differ_by():
    shapes = _shapes(np.where(np.arange(42) == 3, 6.0, 1.0))
    shapes[8:] += 40.0
    two = ["a" if label == "a" else "b" for label in LABELS]
    members = [np.array(two) == name for name in "ab"]
    assert outliers_by(relative_distances(shapes, group_design(two, ["a", "b"]), members)).tolist() == [3]
    result = hl.compare_groups(shapes, [None, *two[1:]], modes=2, permutations=99, alignment="as-it-lies")
    assert result.outliers.tolist() == [3]
    assert any("subject 4 is an outlier" in caution for caution in result.cautions)
    others = [*shapes[:3], *shapes[4:]]
    rest = hl.compare_groups(
        others, [None, *two[1:3], *two[4:]], modes=2, permutations=99, alignment="as-it-lies"
    )
    assert rest.without_outliers is None
    assert result.without_outliers.test.p_permutation == rest.test.p_permutation
    assert result.without_outliers.distance.value == pytest.approx(rest.distance.value)
    assert result.without_outliers.size.value == pytest.approx(rest.size.value)
    assert result.without_outliers.discriminant.auc.value == pytest.approx(rest.discriminant.auc.value)
    np.testing.assert_array_equal(result.without_outliers.p_fwe, rest.p_fwe)
    assert 3 not in result.without_outliers.subjects


@pytest.mark.parametrize(
    ("counts", "far_from"),
    [
        ({"a": 4, "b": 5}, "from the rest of the group"),
        ({"all": 9}, "from the shape that the regression predicts"),
        ({"pairs": 9}, "difference within the pair"),
    ],
)
def test_an_outlier_is_said_to_be_far_from_what_its_design_compares_it_with(counts, far_from):
    assert far_from in outlier_caution(np.array([2]), counts)
    assert "subject 3 is an outlier" in outlier_caution(np.array([2]), counts)
