import numpy as np

from homolog.statistics.assumptions import shape_outliers


def test_broken_subjects_are_named_farthest_first(correlated):
    shapes = correlated(subjects=20)
    shapes[3] += 60.0 * np.random.default_rng(0).normal(size=shapes.shape[1:])
    shapes[11] += 30.0 * np.random.default_rng(1).normal(size=shapes.shape[1:])
    assert shape_outliers(shapes).tolist() == [3, 11]


def test_ordinary_cohorts_have_no_outlying_subject(correlated, ellipsoids):
    assert shape_outliers(correlated(subjects=60)).size == 0
    assert shape_outliers(ellipsoids(subjects=60)).size == 0
    assert shape_outliers(np.repeat(ellipsoids(subjects=2)[:1], 6, axis=0)).size == 0
