"""Passes over the shapes of a cohort that has grown from a core set."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from homolog.correspondence.ensemble import ShapeState, StateArrays
from homolog.correspondence.passes import plan_passes
from homolog.correspondence.schedule import plan_stages
from homolog.geometry import transform_points
from homolog.settings import OptimizeSettings


def turned_and_scaled(factor):
    placement = np.diag([factor, factor, factor, 1.0])
    placement[:3, 3] = 3.0 * factor, -1.0, 2.0
    return placement


@pytest.fixture
def states():
    random = np.random.default_rng(0)
    made = []
    for factor in (0.5, 0.6, 0.75):
        local, placement = random.normal(size=(20, 3)), turned_and_scaled(factor)
        normals = random.normal(size=(20, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        made.append(
            ShapeState(
                local,
                transform_points(placement, local).astype(np.float32),
                normals.astype(np.float32),
                random.normal(size=20).astype(np.float32),
                placement,
            )
        )
    return StateArrays.of(made)


@pytest.mark.parametrize("particles", [128, 1024])
def test_passes_anneal_to_the_last_regularization_of_a_joint_optimization(particles):
    settings = OptimizeSettings(particles=particles)
    passes, last = plan_passes(settings), plan_stages(settings)[-1]
    every = [*passes.annealing, passes.settling]
    assert {plan.count for plan in every} == {particles}
    for plan, following in pairwise(every):
        assert plan.ensemble.end == pytest.approx(following.ensemble.start)
        assert plan.ensemble.start >= plan.ensemble.end
    assert passes.annealing[0].ensemble.start > 100.0 * passes.annealing[-1].ensemble.end
    assert passes.settling.ensemble == last.ensemble
    assert passes.settling.normals == last.normals


def test_a_last_regularization_beyond_that_of_few_particles_is_kept():
    passes = plan_passes(OptimizeSettings(regularization_end=5.0))
    assert passes.annealing[-1].ensemble.start == passes.annealing[-1].ensemble.end == pytest.approx(5.0)


def test_rescaled_states_have_the_mean_scale_and_placements_that_still_fit(states):
    centre = states.aligned.mean(axis=(0, 1))
    states.rescale(2.0)
    assert states.scale == pytest.approx(2.0)
    np.testing.assert_allclose(states.aligned.mean(axis=(0, 1)), centre, atol=1e-5)
    for state in states:
        np.testing.assert_allclose(transform_points(state.placement, state.local), state.aligned, atol=1e-5)


def test_extrapolated_states_are_ahead_by_a_share_of_the_motion(states):
    newer = StateArrays.of([replace(state, aligned=state.aligned + 1.0) for state in states])
    expected = newer.aligned + 0.5
    states.extrapolate(newer, 0.5)
    np.testing.assert_allclose(states.aligned, expected, rtol=1e-6)
    np.testing.assert_allclose(states.normals, newer.normals, atol=1e-6)
    newer.normals[:] = newer.normals[:, ::-1]
    states.extrapolate(newer, 0.5)
    np.testing.assert_allclose(np.linalg.norm(states.normals, axis=2), 1.0, atol=1e-6)
