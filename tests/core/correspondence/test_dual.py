"""The entropies across shapes and their gradients, against finite differences."""

import numpy as np
import pytest
import warp as wp

from homolog.correspondence.entropy import device_duals
from homolog.correspondence.entropy.coupling import DeviceCoupling, HostCoupling
from homolog.correspondence.entropy.dual import entropy, solve_duals
from homolog.correspondence.entropy.means import DeviceMeans, Means
from homolog.correspondence.kernels.particles import Layout, Pose, StepParameters
from homolog.correspondence.launcher import Launcher
from homolog.registration.entropy import covariance, inverse_dual

SHAPES, PARTICLES = 6, 40


@pytest.fixture
def rows():
    values = np.random.default_rng(3).normal(size=(SHAPES, 3 * PARTICLES))
    return values - values.mean(axis=0)


def energy(values, regularization):
    centred = values - values.mean(axis=0)
    return entropy(covariance(centred), regularization)


@pytest.mark.parametrize("regularization", [0.01, 1.0, 100.0])
def test_the_gradient_of_the_ensemble_entropy_matches_finite_differences(rows, regularization):
    gradient = inverse_dual(covariance(rows), regularization) @ rows / (SHAPES * PARTICLES)
    direction = np.random.default_rng(4).normal(size=rows.shape)
    step = 1e-5
    difference = energy(rows + step * direction, regularization) - energy(
        rows - step * direction, regularization
    )
    assert (gradient * direction).sum() == pytest.approx(difference / (2 * step), rel=1e-6)


def test_shapes_that_do_not_vary_have_no_entropy_whatever_the_regularization():
    assert entropy(np.zeros((4, 4)), 1e-3) == pytest.approx(0.0, abs=1e-12)
    assert entropy(np.zeros((4, 4)), 1e3) == pytest.approx(0.0, abs=1e-12)


def test_motion_common_to_all_shapes_is_neither_driven_nor_damped(rows):
    duals = solve_duals(covariance(rows), covariance(rows), 0.5, 0.5, step_weight=3.0)
    common = np.ones(SHAPES)
    np.testing.assert_allclose(duals.gradient @ common, 0.0, atol=1e-5)
    np.testing.assert_allclose(duals.damping @ common, common, atol=1e-5)


def test_damping_is_the_inverse_of_the_implicit_step(rows):
    matrix, pull = covariance(rows), 3.0
    duals = solve_duals(matrix, matrix, 0.5, 0.5, pull)
    implicit = np.eye(SHAPES) + pull * inverse_dual(matrix, 0.5)
    np.testing.assert_allclose(duals.damping @ implicit, np.eye(SHAPES), atol=1e-5)


def test_entropy_per_particle_does_not_depend_on_how_often_each_particle_is_counted(rows):
    twice = np.concatenate([rows, rows], axis=1)
    assert energy(twice, 0.3) == pytest.approx(energy(rows, 0.3), rel=1e-12)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    ("shapes", "by_tiles"), [(2, False), (4, False), (10, False), (10, True), (64, True), (71, True)]
)  # less than a block, one, no whole number; less than a tile, two, no whole number
def test_the_device_coupling_computes_what_the_host_coupling_does(shapes, by_tiles, held, monkeypatch):
    monkeypatch.setattr(device_duals, "MANY_SHAPES", 0 if by_tiles else 1000)
    random = np.random.default_rng(shapes)
    size = random.normal(size=(shapes, 1)) * random.normal(size=3 * PARTICLES)  # one mode dwarfs the others
    rows = 20.0 * size + 0.05 * random.normal(size=(shapes, 3 * PARTICLES))
    rows -= rows.mean(axis=0)
    launcher = Launcher("cpu", threads=1)
    parameters = np.zeros(1, dtype=StepParameters.numpy_dtype())
    parameters["step"], parameters["ensemble_weight"] = 2.0, 0.02
    parameters["regularization"], parameters["normals_regularization"] = 5e-4, 0.01
    stage = wp.array(parameters, dtype=StepParameters, device="cpu")
    iteration = wp.zeros(1, dtype=int, device="cpu")
    centred, logs = (
        wp.array(values.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, device="cpu")
        for values in (rows, 0.1 * rows[::-1])
    )
    layout = Layout()
    layout.shapes, layout.per_shape = shapes, PARTICLES
    free = random.random(shapes * PARTICLES) < 0.7
    movable = wp.array(free if held else np.ones_like(free), dtype=int, device="cpu")
    results = []
    for kind in (HostCoupling, DeviceCoupling):
        coupling = kind(layout, movable, held, launcher)
        out = [wp.zeros(shapes * PARTICLES, dtype=wp.vec3, device="cpu") for _ in range(3)]
        coupling.gradients(stage, iteration, (centred, logs), (out[0], out[1]))
        coupling.damp(stage, iteration, centred, out[2])
        results.append([*(array.numpy() for array in out), coupling.stiffness.numpy(), coupling.entropies()])
    for host, device in zip(*results, strict=True):
        np.testing.assert_allclose(host, device, rtol=1e-5, atol=3e-4 * np.abs(host).max())


def test_means_over_chunks_of_shapes_are_those_over_all():
    random = np.random.default_rng(5)
    shapes, launcher = 21, Launcher("cpu", threads=1)  # of which the last chunk has fewer
    layout = Layout()
    layout.shapes, layout.per_shape = shapes, PARTICLES
    poses = np.zeros(shapes, dtype=Pose.numpy_dtype())
    poses["linear"], poses["rotation"] = 1.2 * np.eye(3), np.eye(3)
    poses["shift"] = random.normal(size=(shapes, 3))
    normals = random.normal(size=(shapes, PARTICLES, 3)) + 3.0 * random.normal(size=(PARTICLES, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)

    def on_device(values, dtype):
        return wp.array(values.reshape(-1, values.shape[-1]).astype(np.float32), dtype=dtype, device="cpu")

    surface = (
        on_device(random.normal(size=normals.shape), wp.vec3),
        on_device(normals, wp.vec3),
        on_device(random.normal(size=(shapes, PARTICLES, 4)), wp.vec4),
    )
    results = []
    for kind in (Means, DeviceMeans):
        means = on_device(normals[0], wp.vec3)
        out = tuple(wp.zeros(shapes * PARTICLES, dtype=wp.vec3, device="cpu") for _ in range(2))
        kind(layout, launcher)(wp.array(poses, dtype=Pose, device="cpu"), surface, means, out)
        results.append([array.numpy() for array in (means, *out)])
    for plain, chunks in zip(*results, strict=True):
        np.testing.assert_allclose(plain, chunks, atol=1e-5)


def test_where_all_shapes_may_move_holding_others_changes_nothing(rows):
    """The kernel for held particles is the plain one where none of a column is held, and safe elsewhere."""
    launcher = Launcher("cpu", threads=1)
    parameters = np.zeros(1, dtype=StepParameters.numpy_dtype())
    parameters["step"], parameters["ensemble_weight"] = 2.0, 0.3
    parameters["regularization"], parameters["normals_regularization"] = 0.4, 0.1
    stage = wp.array(parameters, dtype=StepParameters, device="cpu")
    iteration = wp.zeros(1, dtype=int, device="cpu")
    layout = Layout()
    layout.shapes, layout.per_shape = SHAPES, PARTICLES
    free = np.ones((SHAPES, PARTICLES), dtype=np.int32)
    free[:-1, 0] = 0
    movable = wp.array(free.ravel(), dtype=int, device="cpu")
    steps = rows.reshape(SHAPES, PARTICLES, 3) * free[..., None]
    given = wp.array(steps.reshape(-1, 3).astype(np.float32), dtype=wp.vec3, device="cpu")
    results = []
    for held in (False, True):
        coupling = HostCoupling(layout, movable, held, launcher)
        unused = wp.zeros_like(given)
        coupling.gradients(stage, iteration, (given, given), (unused, unused))
        out = wp.zeros(SHAPES * PARTICLES, dtype=wp.vec3, device="cpu")
        coupling.damp(stage, iteration, given, out)
        results.append(out.numpy().reshape(SHAPES, PARTICLES, 3))
    plain, held = results
    np.testing.assert_allclose(held[:, 1:], plain[:, 1:], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(held[:-1, 0], 0.0)
    assert (np.abs(held[-1, 0]) < np.abs(steps[-1, 0])).all()
