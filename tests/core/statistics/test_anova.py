import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homolog.geometry import fit_rotation
from homolog.statistics.anova import allometry, differences, mode_scores, procrustes_anova
from homolog.statistics.design import Squares, make_design
from homolog.statistics.procrustes import align, rms_radii

PLETHODON = os.environ.get("HOMOLOG_PLETHODON", "")
"""A table of the 40 salamanders of geomorph's `plethodon`: species, site, x1, y1 … x12, y12."""


@pytest.fixture
def table():
    generator = np.random.default_rng(2)
    return {
        "group": np.resize(["a", "b"], 24).tolist(),
        "size": generator.normal(30.0, 3.0, 24).tolist(),
        "site": np.resize(["x", "x", "y"], 24).tolist(),
    }


def test_sums_of_squares_are_those_of_models_with_and_without_the_term(correlated, table):
    shapes = correlated()
    rows = shapes.reshape(24, -1)
    design = make_design("~ group * size", table)
    found = {row.term: row for row in procrustes_anova(shapes, design, permutations=19)}
    group, size = (np.array(table["group"]) == "b").astype(float), np.array(table["size"])
    one = np.ones(24)

    def left(*columns):
        return np.square(
            rows - (X := np.column_stack(columns)) @ np.linalg.lstsq(X, rows, rcond=None)[0]
        ).sum()

    whole = left(one, group, size, group * size)
    assert found["group"].squares == pytest.approx(left(one, size) - left(one, group, size), rel=1e-8)
    assert found["size"].squares == pytest.approx(left(one, group) - left(one, group, size), rel=1e-8)
    assert found["group:size"].squares == pytest.approx(left(one, group, size) - whole, rel=1e-8)
    assert found["residuals"].squares == pytest.approx(whole, rel=1e-8)
    assert (found["residuals"].dof, found["total"].dof) == (20, 23)
    assert found["group"].f == pytest.approx(found["group"].squares / (whole / 20), rel=1e-8)
    assert found["group"].r_squared == pytest.approx(found["group"].squares / left(one), rel=1e-8)


def test_sequential_sums_of_squares_add_up_to_the_total_with_strata(correlated, table):
    design = make_design("~ group + size", table, strata=table["site"])
    rows = procrustes_anova(correlated(), design, squares=Squares.SEQUENTIAL, permutations=19)
    assert [row.term for row in rows] == ["strata", "group", "size", "residuals", "total"]
    assert sum(row.squares for row in rows[:-1]) == pytest.approx(rows[-1].squares, rel=1e-9)


def test_an_effect_is_found_in_its_term_and_in_the_difference_of_its_levels(correlated, table):
    shapes = correlated()
    shapes[1::2] += 6.0 * np.random.default_rng(1).normal(size=shapes.shape[1:])
    design = make_design("~ group + size", table)
    found = {row.term: row for row in procrustes_anova(shapes, design, permutations=999)}
    assert found["group"].p < 0.01 < 0.05 < found["size"].p
    assert found["group"].z > 2.0
    scores = mode_scores(shapes, design, modes=3)
    size = rms_radii(shapes)
    (apart,) = differences(shapes, scores, size, design.differences("group"), permutations=999)
    assert (apart.name, apart.p_adjusted) == ("b - a", apart.p)
    assert apart.p == pytest.approx(found["group"].p)
    assert 0.0 < apart.distance.low < apart.distance.value < apart.distance.high
    moved = np.sqrt(np.square(apart.effect).sum() / shapes.shape[1])
    assert apart.length == pytest.approx(moved)
    assert apart.size.low < apart.size.value < apart.size.high


def test_change_compared_between_groups_counts_subjects_not_rows():
    """Of 12 subjects with 3 visits: visits within one subject are alike, and say nothing about groups."""
    generator = np.random.default_rng(3)
    found = np.zeros(2)
    table = {"group": np.repeat(["a", "b"], 18).tolist(), "time": np.tile([0.0, 1.0, 2.0], 12).tolist()}
    subject = np.repeat([f"p{k}" for k in range(12)], 3).tolist()
    designs = [make_design("~ group * time", table, subject=own) for own in (subject, None)]
    for repeat in range(60):
        own = 2.0 * np.repeat(generator.normal(size=(12, 10, 3)), 3, axis=0)
        shapes = own + generator.normal(size=(36, 10, 3))
        for which, design in enumerate(designs):
            rows = procrustes_anova(shapes, design, permutations=99, seed=repeat)
            found[which] += rows[0].p <= 0.05
    assert found[0] <= 8  # of 60
    assert found[1] >= 20


def test_regression_scores_lie_along_the_slope_and_predictions_on_lines(correlated, table):
    shapes = correlated() + 0.5 * np.array(table["size"])[:, None, None] * correlated(seed=5)[0]
    result = allometry(shapes, make_design("~ group + size", table), "size")
    size = np.array(table["size"])
    assert np.corrcoef(result.scores, size)[0, 1] > 0.9
    own = np.array(table["group"]) == "a"
    line = np.polyfit(size[own], result.predicted[own], 1)
    np.testing.assert_allclose(result.predicted[own], np.polyval(line, size[own]), atol=1e-8)
    assert line[0] > 0.0


@pytest.mark.skipif(not Path(PLETHODON).is_file(), reason="HOMOLOG_PLETHODON names no file")
def test_the_published_example_of_geomorph_has_its_sums_of_squares():
    data = pd.read_csv(PLETHODON)
    names = [f"{axis}{point}" for point in range(1, 13) for axis in "xy"]
    flat = data[names].to_numpy().reshape(len(data), 12, 2)
    shapes = align(np.dstack([flat, np.zeros((len(data), 12))]), scaling=True)
    shapes -= shapes.mean(axis=1, keepdims=True)
    shapes /= np.linalg.norm(shapes, axis=(1, 2), keepdims=True)
    consensus = shapes.mean(axis=0) / np.linalg.norm(shapes.mean(axis=0))
    left, right, _ = fit_rotation(np.einsum("mni,nj->mij", shapes, consensus))
    shapes = shapes @ (left @ right)
    along = np.einsum("mni,ni->m", shapes, consensus)
    tangent = shapes - along[:, None, None] * consensus
    table = {name: data[name].tolist() for name in ("species", "site")}
    design = make_design("~ species * site", table)
    rows = procrustes_anova(tangent, design, squares=Squares.SEQUENTIAL, permutations=99)
    published = [0.029258, 0.064375, 0.030885, 0.072422, 0.196940]
    np.testing.assert_allclose([row.squares for row in rows], published, atol=1e-6)
