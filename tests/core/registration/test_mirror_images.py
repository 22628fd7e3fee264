"""Which subjects are mirror images of the usual ones, by how much better they fit reflected."""

import numpy as np
import pytest

from homolog.registration.mirror_images import reversed_ones


def flagged(*values, majority=True):
    return np.flatnonzero(reversed_ones(np.array(values), majority=majority)).tolist()


def test_a_mirror_image_is_found_where_shapes_tell_sides():
    assert flagged(1.2, 1.0, 1.1, -1.1, 1.3, 0.9) == [3]


def test_small_asymmetries_count_if_subjects_are_alike():
    assert flagged(0.2, 0.22, 0.18, -0.2, 0.21, 0.19) == [3]


def test_where_subjects_differ_more_than_their_sides_nobody_is_flagged():
    assert flagged(0.1, -0.27, 0.08, 0.01, -0.1, 0.03, 0.02, 0.28) == []


@pytest.mark.parametrize("seed", range(5))
def test_symmetric_shapes_are_not_flagged(seed):
    assert flagged(*np.random.default_rng(seed).normal(0.0, 0.1, 12)) == []


@pytest.mark.parametrize(
    "measured",
    [
        (0.0, -0.03, -0.14, 0.14, 0.15, -0.1, -0.04, 0.12),  # hyoid bones with one longer horn
        (0.03, -0.14, -0.19, -0.07, -0.13, -0.14, 0.04, 0.08),
        (0.21, 0.26, 0.27, 0.19, 0.28, 0.19, 0.08, -0.15),  # ribs that drop less or more
        (0.48, 0.41, 0.13, -0.18, -0.27, 0.29, -0.45, 0.6),  # twisted rings
        (-0.64, -0.57, -0.47, 0.14, 0.23, 0.39, 0.52, 0.52),  # mandibles
        (-0.23, -0.22, -0.18, -0.18, 0.1, 0.14, 0.17, 0.21),  # caudate nuclei
        (-0.43, -0.31, -0.26, 0.14, 0.3, 0.33, 0.34, 0.41),  # menisci
    ],
)
def test_chance_asymmetries_of_few_subjects_are_no_sides(measured):
    assert flagged(*measured) == []


def test_preferences_that_are_all_large_may_differ_much():
    assert flagged(3.8, -4.0, 1.1, -3.9, 3.0, -1.3, 1.4, -1.3) == [1, 3, 5, 7]


def test_half_of_a_cohort_is_flagged_where_its_sides_differ_clearly():
    hippocampi = (0.66, -0.76, 0.89, -0.75, 0.59, -0.66, 0.81, -0.86, 0.65, -0.51)
    assert flagged(*hippocampi) == [1, 3, 5, 7, 9]


def test_a_preference_near_zero_is_left_alone():
    assert flagged(1.2, 1.0, 1.1, -0.1, 1.3, 0.9) == []


def test_of_two_sides_the_rarer_is_flagged_unless_the_usual_one_is_known():
    values = (-1.0, -1.1, -0.9, -1.2, 1.0, 1.1, 0.9)
    assert flagged(*values) == [4, 5, 6]
    assert flagged(*values, majority=False) == [0, 1, 2, 3]


def test_of_very_few_subjects_none_can_be_odd():
    assert flagged(1.0, -1.0, 1.0) == []
