import numpy as np
import pytest

import homolog as hl

QUICK = {"permutations": 199, "alignment": "form", "modes": 3}


@pytest.fixture
def cohort():
    """Thirty spheres of 40 particles that grow along one axis with age; groups, sexes and three sites."""
    random = np.random.default_rng(5)
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ages = random.uniform(40.0, 80.0, 30)
    shapes = 10.0 * directions + random.normal(scale=0.05, size=(30, 40, 3))
    shapes[:, :, 0] *= 1.0 + 0.01 * (ages[:, None] - 60.0)
    groups = ["control", "patient"] * 15
    return shapes, groups, ages, ["f", "f", "m"] * 10, [str(1 + index % 3) for index in range(30)]


def test_effects_of_covariates_are_those_of_a_regression_on_them(cohort):
    shapes, groups, ages, sexes, _ = cohort
    found = hl.compare_groups(shapes, groups, covariates={"age": ages, "sex": sexes}, **QUICK)
    age, sex = found.covariates
    turned = hl.regress(shapes, ages, "age", covariates={"group": groups, "sex": sexes}, **QUICK)
    assert (age.title, sex.title) == ("age", "sex: m - f")
    np.testing.assert_allclose(age.pointwise.effect, turned.pointwise.effect, atol=1e-9)
    assert age.test.p_permutation == turned.test.p_permutation == 1 / 200
    assert age.distance.value == pytest.approx(turned.distance.value)
    assert age.size.value == pytest.approx(turned.size.value)
    both = hl.compare_groups(shapes, sexes, covariates={"age": ages, "group": groups}, **QUICK)
    assert sex.distance.value == pytest.approx(both.distance.value)
    assert sex.test.studentized == pytest.approx(both.test.studentized)
    assert found.without_outliers is None or found.without_outliers.covariates == ()


def test_numbers_that_are_declared_categories_are_tested_as_such(cohort):
    shapes, groups, ages, _, sites = cohort
    found = hl.regress(shapes, ages, "age", covariates={"site:c": sites, "group": groups}, **QUICK)
    site, group = found.covariates
    assert (site.title, group.title) == ("site:c", "group: patient - control")
    assert site.test.dof[0] == 6
    assert site.distance.low <= site.distance.value <= site.distance.high
    assert hl.regress(shapes, ages, **QUICK).covariates == ()
