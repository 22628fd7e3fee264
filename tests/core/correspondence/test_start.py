"""What the first particles tell: the weight of H(Z), and whether the optimization improves on them."""

import numpy as np
import pytest

from homolog.correspondence import optimize, recorder
from homolog.correspondence.entropy.weight import independent_parts, with_weight
from homolog.correspondence.start import Start
from homolog.correspondence.types import Reason
from homolog.settings import OptimizeSettings

QUICK = OptimizeSettings(particles=40, split_iterations=5, anneal_iterations=30, settle_iterations=60)


def modes_of(rows):
    """Return the variances along the modes of rows (M, P)."""
    return np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)[:-1] ** 2 / (len(rows) - 1)


def shapes_of(rng, subjects, parts, noise=0.0):
    """Return particles (M, 60, 3) of which some groups move together, and each a little."""
    moves = rng.normal(size=(subjects, parts, 3))[:, np.arange(60) % parts]
    return moves + noise * rng.normal(size=(subjects, 60, 3))


@pytest.mark.parametrize("parts", [1, 4, 20])
def test_parts_that_vary_independently_are_counted_without_bias_on_few_subjects(parts):
    rng = np.random.default_rng(3)
    found = [independent_parts(modes_of(rng.normal(size=(9, parts))), 9) for _ in range(200)]
    assert np.median(found) == pytest.approx(parts, rel=0.2)


def test_the_weight_falls_with_the_parts_and_an_explicit_one_stays():
    few, many = (with_weight(OptimizeSettings(), parts).ensemble_weight for parts in (2.0, 20.0))
    assert few == pytest.approx(10.0 * many)
    assert with_weight(OptimizeSettings(ensemble_weight=0.3), 20.0).ensemble_weight == 0.3


def test_two_subjects_get_a_weight_and_no_verdict():
    start = Start.of(np.random.default_rng(0).normal(size=(2, 30, 3)))
    assert start.parts == 1.0
    assert not start.is_better_than(np.random.default_rng(1).normal(size=(2, 30, 3)))


def test_particles_that_go_their_own_ways_are_worse_and_equal_ones_are_not():
    rng = np.random.default_rng(5)
    shapes = shapes_of(rng, 10, 3, noise=0.05)
    start = Start.of(shapes)
    assert start.is_better_than(shapes + rng.normal(size=shapes.shape))
    assert not start.is_better_than(shapes)
    assert not start.is_better_than(shapes_of(rng, 10, 3, noise=0.05))


def test_a_run_that_does_not_improve_ends_with_all_particles_registered(ellipsoid_shapes, monkeypatch):
    better = optimize(ellipsoid_shapes, QUICK)
    monkeypatch.setattr(Start, "is_better_than", lambda *_: True)
    first = []
    kept = optimize(ellipsoid_shapes, QUICK, observe=lambda frame: first or first.append(frame))
    assert (better.reason, kept.reason) != (Reason.REGISTRATION, Reason.CONVERGED)
    assert kept.reason is Reason.REGISTRATION
    assert kept.local.shape == better.local.shape
    gaps = np.linalg.norm(kept.world - first[0].world, axis=2)
    assert np.median(gaps) < np.median(np.linalg.norm(better.world - first[0].world, axis=2))


def test_such_a_run_resumes_to_the_same_particles(ellipsoid_shapes, monkeypatch):
    monkeypatch.setattr(recorder, "CHECKPOINT_INTERVAL_S", 0.0)
    monkeypatch.setattr(Start, "is_better_than", lambda *_: True)
    kept = []
    whole = optimize(ellipsoid_shapes, QUICK, checkpoint=kept.append)
    rest = optimize(ellipsoid_shapes, QUICK, resume=kept[len(kept) // 2])
    assert rest.reason is whole.reason is Reason.REGISTRATION
    np.testing.assert_array_equal(rest.local, whole.local)
