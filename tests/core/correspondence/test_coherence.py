"""Coherence of particles with their neighbours."""

import numpy as np
import pytest
import warp as wp

from homolog.correspondence.entropy.coherence import Coherence, find_neighbourhoods
from homolog.correspondence.kernels.particles import Layout, StepParameters
from homolog.correspondence.launcher import Launcher


@pytest.fixture(scope="module")
def sphere():
    """Evenly spread points of a unit sphere, which are their own normals (a Fibonacci lattice)."""
    number = np.arange(300) + 0.5
    height, angle = 1.0 - 2.0 * number / 300, np.pi * (1.0 + np.sqrt(5.0)) * number
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def predicted(neighbourhoods, values):
    neighbours, weights = neighbourhoods
    return np.einsum("nk,nkd->nd", weights, values[neighbours])


def coherence_of(deviations, neighbourhoods, free=None):
    """Return the term for deviations (M, n, 3), with arrays of stage and iteration."""
    layout = Layout()
    layout.shapes, layout.per_shape = deviations.shape[:2]
    parameters = np.zeros(1, dtype=StepParameters.numpy_dtype())
    parameters["ensemble_weight"], parameters["coherence"], parameters["step"] = 0.5, 2.0, 0.7
    flags = np.ones(deviations.shape[:2], int) if free is None else free
    term = Coherence(layout, wp.array(flags.ravel(), dtype=int, device="cpu"), Launcher("cpu", 1))
    term.set(neighbourhoods)
    stage = wp.array(parameters, dtype=StepParameters, device="cpu")
    return term, stage, wp.zeros(1, dtype=int, device="cpu")


def vectors(values):
    return wp.array(values.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, device="cpu")


def test_neighbours_predict_a_smooth_deformation_and_no_independent_one(sphere):
    random = np.random.default_rng(0)
    neighbourhoods = find_neighbourhoods(sphere, sphere)
    smooth = sphere @ random.normal(size=(3, 3))
    rough = random.normal(size=sphere.shape)
    tangential = smooth - predicted(neighbourhoods, smooth)
    tangential -= sphere * np.einsum("nd,nd->n", tangential, sphere)[:, None]
    assert np.abs(tangential).max() < 0.05 * np.abs(smooth).max()  # the sphere is curved
    assert np.square(rough - predicted(neighbourhoods, rough)).mean() > np.square(rough).mean()


def test_weights_of_neighbours_sum_to_one(sphere):
    _, weights = find_neighbourhoods(sphere, sphere)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-5)


def test_particles_on_opposite_sides_of_a_wall_are_no_neighbours(sphere):
    shell = np.concatenate([sphere, 0.99 * sphere])
    normals = np.concatenate([sphere, -sphere])
    neighbours, _ = find_neighbourhoods(shell, normals)
    assert ((neighbours < 300) == (np.arange(600) < 300)[:, None]).all()


def test_the_fewest_particles_have_all_others_as_neighbours(sphere):
    neighbours, weights = find_neighbourhoods(sphere[::75], sphere[::75])
    assert neighbours.shape == weights.shape == (4, 3)


def test_particles_in_one_place_are_still_each_others_neighbours_and_never_their_own(sphere):
    centres = np.concatenate([sphere[:40], np.repeat(sphere[:1], 40, axis=0)])
    neighbours, weights = find_neighbourhoods(centres, centres)
    assert (neighbours != np.arange(80)[:, None]).all()
    assert np.isfinite(weights).all()


def test_the_gradient_is_the_derivative_of_the_roughness(sphere):
    deviations = np.random.default_rng(1).normal(size=(3, 300, 3))
    term, stage, iteration = coherence_of(deviations, find_neighbourhoods(sphere, sphere))
    gradient = vectors(np.zeros((3, 300, 3)))
    term.add_gradient(stage, iteration, vectors(deviations), gradient)
    direction = np.random.default_rng(2).normal(size=deviations.shape)

    def roughness(step):
        moved = vectors(deviations + step * direction)
        term.add_gradient(stage, iteration, moved, vectors(0.0 * deviations))
        return term.roughness()

    change = 0.5 * (roughness(1.0) - roughness(-1.0)) * 3 * 300  # exact for a quadratic function
    expected = (gradient.numpy().reshape(3, 300, 3) * direction).sum() * 0.5 / 2.0
    assert change == pytest.approx(expected, rel=0.01)


def test_damping_leaves_what_all_shapes_have_in_common(sphere):
    common = np.tile(np.random.default_rng(3).normal(size=(300, 3)), (4, 1, 1))
    own = np.random.default_rng(4).normal(size=common.shape)
    own -= own.mean(axis=0)
    term, stage, iteration = coherence_of(common, find_neighbourhoods(sphere, sphere))
    steps = vectors(common + own)
    term.damp(stage, iteration, steps)
    damped = steps.numpy().reshape(common.shape)
    np.testing.assert_allclose(damped.mean(axis=0), common[0], atol=1e-5)
    ratio = (damped - common) / own
    np.testing.assert_allclose(ratio, ratio.flat[0], rtol=1e-3)
    assert 0.0 < ratio.flat[0] < 0.7


def test_fixed_particles_stay_fixed_when_steps_are_damped(sphere):
    steps = np.random.default_rng(5).normal(size=(2, 300, 3))
    steps[0] = 0.0
    free = np.array([[0], [1]]) * np.ones((2, 300), int)
    term, stage, iteration = coherence_of(steps, find_neighbourhoods(sphere, sphere), free)
    given = vectors(steps)
    term.damp(stage, iteration, given)
    assert not given.numpy().reshape(steps.shape)[0].any()


def test_explicit_steps_stay_stable_whatever_their_length(sphere):
    neighbourhoods = find_neighbourhoods(sphere, sphere)
    deviations = np.random.default_rng(6).normal(size=(2, 300, 3))
    deviations -= deviations.mean(axis=0)
    term, stage, iteration = coherence_of(deviations, neighbourhoods)
    parameters = stage.numpy().copy()
    parameters["step"] = 1e4
    stage = wp.array(parameters, dtype=StepParameters, device="cpu")
    for _ in range(30):
        gradient = vectors(0.0 * deviations)
        term.add_gradient(stage, iteration, vectors(deviations), gradient)
        steps = vectors(-1e4 * 0.5 * gradient.numpy().reshape(deviations.shape))
        term.damp(stage, iteration, steps)
        deviations = deviations + steps.numpy().reshape(deviations.shape)
    assert np.abs(deviations).max() < 20.0
