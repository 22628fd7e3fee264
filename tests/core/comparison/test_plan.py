"""Planning a study from a pilot: predicted power, needed numbers, stability."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from homolog.comparison.plan import Plan, PlanSettings, bump, plan_study, power_curve
from homolog.errors import InputError
from homolog.statistics.design import group_design
from homolog.statistics.procrustes import Alignment
from homolog.statistics.randomization import Randomization, shape_test

PARTICLES = 40
SETTINGS = PlanSettings(
    effect=2.4,
    width=14.0,
    particle=7,
    per_group=(6, 12, 20),
    studies=100,
    permutations=99,
    alignment=Alignment.AS_IT_LIES,
)


def sphere():
    """Return unit directions that are spread evenly."""
    index = np.arange(PARTICLES) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * index / PARTICLES), np.pi * (1.0 + np.sqrt(5.0)) * index
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def drawn(count, random):
    """Return shapes of the population: five smooth modes and noise."""
    normals = sphere()
    modes = np.random.default_rng(99).normal(size=(5, 3))
    waves = np.cos(2.0 * normals @ modes.T) * np.array([1.2, 1.0, 0.8, 0.6, 0.5])
    radial = random.normal(size=(count, 5)) @ waves.T + random.normal(scale=0.5, size=(count, PARTICLES))
    noise = random.normal(scale=0.3, size=(count, PARTICLES, 3))
    return 15.0 * normals + radial[:, :, None] * normals + noise


@pytest.fixture(scope="module")
def plan():
    random = np.random.default_rng(4)
    pilot = drawn(60, random)
    pilot[30:, :5, 0] += 1.5
    return plan_study(pilot, ["a"] * 30 + ["b"] * 30, sphere(), SETTINGS)


def test_predicted_power_is_within_five_points_of_simulated_studies(plan):
    normals, number, studies = sphere(), 12, 250
    effect = bump(15.0 * normals, normals, SETTINGS.particle, SETTINGS.effect, SETTINGS.width)
    near = np.linalg.norm(effect, axis=1) >= 0.5 * SETTINGS.effect
    design = group_design(["a"] * number + ["b"] * number, ["a", "b"])
    found = np.zeros(2)
    for study in range(studies):
        shapes = drawn(2 * number, np.random.default_rng([8, study]))
        shapes[number:] += effect
        rows = shapes.reshape(len(shapes), -1)
        surface = Randomization(design, rows, draws=199, seed=study).surface(shapes)
        found += (
            shape_test(shapes, design, draws=199, seed=study).p <= 0.05,
            surface.p_fwe[near].min() <= 0.05,
        )
    (row,) = (row for row in plan.rows if row.per_group == number)
    assert 0.2 < row.place < 0.9
    assert [row.whole, row.place] == pytest.approx(found / studies, abs=0.05)


def test_more_subjects_have_more_power_and_the_needed_number_reaches_it(plan):
    places = [row.place for row in plan.rows]
    assert places == sorted(places)
    assert plan.needed_place is not None
    more = replace(SETTINGS, per_group=(plan.needed_place,), studies=20)
    assert more.per_group[0] > 4
    sizes = [row.size_mm for row in plan.rows]
    assert sizes == sorted(sizes, reverse=True)


def test_intervals_hold_the_power_and_shrink_with_the_pilot(plan):
    small = plan_study(
        drawn(20, np.random.default_rng(3)), ["a"] * 20, sphere(), replace(SETTINGS, studies=50)
    )
    for made in (plan, small):
        for row in made.rows:
            assert row.place_range[0] <= row.place <= row.place_range[1]
    low, high = plan.needed_place_range
    assert low < plan.needed_place < high
    ends = [np.array(made.needed_place_range, float) for made in (plan, small)]
    assert ends[0][1] / ends[0][0] < ends[1][1] / ends[1][0]
    ratio = stats.chi2.ppf([0.95, 0.05], plan.subjects - len(plan.between))
    assert high / low == pytest.approx(ratio[0] / ratio[1], rel=0.2)


def test_a_clear_group_difference_is_stable_and_groups_are_no_variation(plan):
    (parts, particles) = plan.stability
    assert parts.map_agreement is not None
    assert parts.map_agreement[0] > 0.9
    assert parts.modes[0][0] > 0.8
    assert parts.p_place is not None
    assert parts.p_place[1] < 0.05
    assert particles.modes[0][0] > 0.9
    assert plan.between == ("a", "b")


def test_a_curve_through_simulated_studies_is_the_probit_function_that_made_them():
    numbers = [6, 12, 24, 48]
    true = 0.05 + 0.95 * stats.norm.cdf(-2.0 + 0.5 * np.sqrt(numbers))
    power = power_curve(numbers, 10_000 * true, 10_000)
    assert [power(number) for number in numbers] == pytest.approx(true, abs=0.002)
    assert power_curve(numbers, [5, 4, 6, 5], 100)(1000) < 0.1
    assert power(12, 0.5) == pytest.approx(power(3))  # twice the deviation, a quarter of the subjects


def test_a_plan_survives_its_record(plan):
    import json

    assert Plan.from_record(json.loads(json.dumps(plan.record))) == plan


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"effect": 0.0}, "effect 0"),
        ({"width": -1.0}, "width"),
        ({"particle": 40}, "0 to 39"),
        ({"per_group": (2,)}, "at least 4"),
        ({"power": 1.0}, "power 1"),
    ],
)
def test_settings_that_mean_nothing_are_refused(given, message):
    pilot = drawn(20, np.random.default_rng(0))
    with pytest.raises(InputError, match=message):
        plan_study(pilot, [""] * 20, sphere(), replace(SETTINGS, **given))


def test_a_small_pilot_is_refused():
    pilot = drawn(6, np.random.default_rng(0))
    with pytest.raises(InputError, match="too small to plan"):
        plan_study(pilot, ["a", "b"] * 3, sphere(), SETTINGS)
