"""Groups, covariates and variables are shorthands for formulas: the answers are the same."""

import numpy as np
import pytest

from homolog.comparison.ask import ask
from homolog.comparison.question import questions
from homolog.comparison.sample import Sample

SUBJECTS = 24
GROUPS = {"kind": "groups", "column": "group", "between": ("a", "b")}


@pytest.fixture(scope="module")
def sample():
    draw = np.random.default_rng(0)
    shapes = 10.0 * draw.normal(size=(40, 3)) + draw.normal(scale=0.5, size=(SUBJECTS, 40, 3))
    shapes[1::2, :5, 2] += 1.0
    columns = {"group": ["a", "b"] * (SUBJECTS // 2), "age": list(draw.normal(50.0, 8.0, SUBJECTS))}
    return Sample.of_arrays(shapes, columns)


def ends_of(effect):
    """Return value and interval; nothing without retained modes."""
    return [] if effect is None else [effect.value, effect.low, effect.high]


@pytest.mark.parametrize("alignment", ["form", "shape", "as-it-lies"])
@pytest.mark.parametrize(
    ("asked", "formula", "place"),
    [
        (GROUPS, "~ group", 0),
        ({**GROUPS, "covariates": ("age",)}, "~ age + group", 1),
        ({"kind": "regression", "column": "age"}, "~ age", 0),
        ({"kind": "regression", "column": "age", "covariates": ("group",)}, "~ group + age", 1),
    ],
)
def test_a_question_has_the_answer_of_its_formula(sample, alignment, asked, formula, place):
    (question,) = questions([alignment], permutations=199, **asked)
    (longer,) = questions([alignment], permutations=199, kind="formula", column="", formula=formula)
    short, long = ask(sample, question).overall, ask(sample, longer).terms[place]
    assert short.p_adjusted == long.p_adjusted
    assert short.p_fwe.tolist() == long.p_fwe.tolist()
    np.testing.assert_allclose(short.pointwise.effect, long.pointwise.effect, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(short.pointwise.q, long.pointwise.q, rtol=0.0, atol=1e-8)
    assert short.size.value == pytest.approx(long.size.value, rel=1e-8)  # two groups have Welch's interval
    for name in ("distance", "explained"):
        mine, theirs = ends_of(getattr(short, name)), ends_of(getattr(long, name))
        np.testing.assert_allclose(mine, theirs, rtol=1e-8, atol=1e-8)
