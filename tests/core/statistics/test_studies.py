from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests

from homolog.errors import InputError
from homolog.statistics.comparison import Options
from homolog.statistics.design import covariate_columns
from homolog.statistics.procrustes import Alignment
from homolog.statistics.studies import compare_groups, compare_pairs, compare_two_groups, holm, regress

LIES = Alignment.AS_IT_LIES
QUICK = Options(alignment=LIES, permutations=199, bootstraps=20, classifications=9)


def test_two_groups_are_compared_among_their_own_subjects_only(correlated):
    shapes = correlated(subjects=30)
    groups = ["n", "h", "d"] * 10
    kept = [item for item, group in enumerate(groups) if group != "d"]
    whole = compare_two_groups(shapes, groups, ("n", "h"), options=QUICK)
    apart = compare_two_groups(shapes[kept], [groups[item] for item in kept], ("n", "h"), options=QUICK)
    assert whole.title == "h - n"
    assert whole.counts == {"n": 10, "h": 10}
    assert whole.test.p == apart.test.p
    np.testing.assert_array_equal(whole.subjects, kept)
    difference = shapes[1::3].mean(axis=0) - shapes[0::3].mean(axis=0)
    np.testing.assert_allclose(whole.pointwise.effect[0], difference, atol=1e-10)


def test_size_is_tested_apart_and_taken_out_of_the_shapes(ellipsoids):
    shapes = ellipsoids(subjects=20, noise=0.3)
    groups = ["small"] * 10 + ["large"] * 10
    shapes[10:] *= 1.3
    result = compare_two_groups(
        shapes, groups, ("small", "large"), options=replace(QUICK, alignment=Alignment.SHAPE)
    )
    assert result.size.p == 0.005  # the smallest of 199 permutations
    size = np.sqrt(np.square(shapes - shapes.mean(axis=1, keepdims=True)).sum(axis=2).mean(axis=1))
    welch = stats.ttest_ind(size[10:], size[:10], equal_var=False)
    interval = welch.confidence_interval()
    np.testing.assert_allclose((result.size.low, result.size.high), (interval.low, interval.high))
    assert result.size.value == pytest.approx(size[10:].mean() - size[:10].mean())
    assert result.test.p > 0.01
    with_size = compare_two_groups(shapes, groups, ("small", "large"), options=QUICK)
    assert with_size.test.p < 1e-4


def test_pose_size_and_shape_are_compared_as_the_alignment_keeps_them(ellipsoids):
    shapes = ellipsoids(subjects=20, noise=0.3)
    shifted, larger = shapes.copy(), shapes.copy()
    shifted[10:] += [30.0, 0.0, 0.0]
    larger[10:] *= 1.3

    def found(particles, alignment):
        options = replace(QUICK, alignment=alignment, modes=2)
        result = compare_two_groups(particles, ["a"] * 10 + ["b"] * 10, ("a", "b"), options=options)
        return result.test.p_permutation <= 0.01

    kept = {
        Alignment.AS_IT_LIES: (True, True),
        Alignment.FORM: (False, True),
        Alignment.SHAPE: (False, False),
    }
    for alignment, expected in kept.items():
        assert (found(shifted, alignment), found(larger, alignment)) == expected, alignment


def test_three_groups_are_tested_together_and_each_two_with_holms_correction(correlated):
    shapes = correlated(subjects=30)
    groups = ["n", "h", "d"] * 10
    shapes[2::3] += 8.0 * np.random.default_rng(0).normal(size=shapes.shape[1:])
    overall, pairs = compare_groups(shapes, groups, ["n", "h", "d"], options=QUICK)
    assert overall.test.p_permutation < 0.02
    assert overall.pointwise.effect.shape == (2, 30, 3)
    assert [pair.title for pair in pairs] == ["h - n", "d - n", "d - h"]
    raw = [pair.test.p_permutation for pair in pairs]
    np.testing.assert_allclose([pair.p_adjusted for pair in pairs], multipletests(raw, method="holm")[1])
    assert pairs[0].p_adjusted > 0.05 > pairs[1].p_adjusted


def test_p_values_of_the_discriminant_are_corrected_for_pairs_and_answers(correlated):
    shapes = correlated(subjects=30)
    shapes[2::3] += 8.0 * np.random.default_rng(0).normal(size=shapes.shape[1:])
    two = replace(QUICK, answers=2, classifications=199)
    _, pairs = compare_groups(shapes, ["n", "h", "d"] * 10, ["n", "h", "d"], options=two)
    for name in ("accuracy", "auc"):
        raw = [min(2 * getattr(pair.discriminant, name).p, 1.0) for pair in pairs]
        adjusted = [getattr(pair, f"{name}_p_adjusted") for pair in pairs]
        np.testing.assert_allclose(adjusted, multipletests(raw, method="holm")[1])
        assert min(adjusted) < 0.05


def test_holm_is_that_of_statsmodels():
    p = np.random.default_rng(1).random(12) ** 3
    np.testing.assert_allclose(holm(p), multipletests(p, method="holm")[1])


def test_regression_finds_the_change_per_unit_and_allows_for_covariates(correlated, covariates):
    shapes = correlated()
    values = np.random.default_rng(6).normal(50.0, 8.0, 24)
    slope = np.random.default_rng(7).normal(size=shapes.shape[1:])
    shapes += values[:, None, None] * slope
    columns = covariate_columns(covariates())
    result = regress(shapes, values, "age", covariates=columns, options=QUICK)
    assert result.test.p_permutation == pytest.approx(1 / 200)
    assert np.corrcoef(result.pointwise.effect[0].ravel(), slope.ravel())[0, 1] > 0.9


def test_pairs_show_what_changed_between_them(correlated):
    before = correlated(subjects=15)
    after = before + 0.3 * np.random.default_rng(8).normal(size=before.shape)
    after[:, 4] += [0.0, 0.0, 2.0]
    shapes = np.concatenate([before, after])
    result = compare_pairs(shapes, np.arange(15), np.arange(15, 30), "after - before", options=QUICK)
    assert np.flatnonzero(result.pointwise.p_fwe <= 0.01).tolist() == [4]
    np.testing.assert_allclose(result.pointwise.effect[0, 4], [0.0, 0.0, 2.0], atol=0.4)


def test_a_subject_that_is_there_twice_is_refused_by_name(correlated):
    shapes = correlated(subjects=6)
    shapes[4] = shapes[1]
    names = [f"s{index}" for index in range(6)]
    with pytest.raises(InputError, match=r"s4: .* s1"):
        compare_two_groups(shapes, ["a", "b"] * 3, ("a", "b"), names=names)
    with pytest.raises(InputError, match=r"s0: .* more than once"):
        compare_two_groups(correlated(subjects=6), ["a", "b"] * 3, ("a", "b"), names=["s0"] * 2 + names[2:])


def test_a_subject_in_two_pairs_is_refused(correlated):
    with pytest.raises(InputError, match="one pair only"):
        compare_pairs(correlated(), np.array([0, 1]), np.array([2, 1]), "after - before")


def test_a_cohort_that_differs_by_noise_only_has_no_discriminant_and_no_nan():
    shapes = np.random.default_rng(1).normal(size=(20, 64, 3))
    result = compare_two_groups(shapes, ["a", "b"] * 10, ("a", "b"), options=QUICK)
    assert result.test.modes == 0
    assert result.discriminant is None
    assert np.isfinite([result.test.p, result.size.p, result.test.wilks, result.p_adjusted]).all()


def test_p_of_all_permutations_depends_neither_on_the_seed_nor_on_the_order_of_groups_and_subjects():
    generator = np.random.default_rng(3)
    labels = np.repeat(["a", "b"], [4, 5])
    shapes = generator.normal(size=(9, 12, 3)) * np.where(labels == "a", 2.0, 1.0)[:, None, None]
    order = generator.permutation(9)
    options = Options(modes=2, classifications=19, bootstraps=5)
    answers = [
        compare_two_groups(shapes, list(labels), ("a", "b"), options=options),
        compare_two_groups(shapes, list(labels), ("b", "a"), options=options),
        compare_two_groups(shapes, list(labels), ("a", "b"), options=replace(options, seed=7)),
        compare_two_groups(shapes[order], list(labels[order]), ("a", "b"), options=options),
    ]
    assert all(result.test.exact for result in answers)
    p = [(result.test.p_permutation, result.size.p, result.pointwise.p_fwe.min()) for result in answers]
    np.testing.assert_allclose(p, [p[0]] * 4, rtol=1e-12)
