"""Optimizations on a GPU."""

import numpy as np
import pytest
import warp as wp

from homolog.correspondence import load_kernels, optimize
from homolog.correspondence.entropy import device_duals
from homolog.settings import Method, OptimizeSettings

pytestmark = pytest.mark.cuda
QUICK = OptimizeSettings(particles=40, split_iterations=20, anneal_iterations=80, settle_iterations=60)


@pytest.mark.parametrize("method", list(Method))
def test_a_gpu_reaches_the_objective_of_the_cpu(ellipsoid_shapes, method, gpu):
    load_kernels(gpu)
    settings = QUICK.model_copy(update={"method": method})
    here, there = (optimize(ellipsoid_shapes, settings, device=device) for device in ("cpu", gpu))
    objectives = [result.energies[-1, 1:].sum() for result in (here, there)]
    assert abs(objectives[1] - objectives[0]) < 0.02
    for index, points in enumerate(there.local):
        level = np.linalg.norm(points / [12.0, 9.0, 6.0 + 0.5 * index], axis=1)
        assert np.abs(level - 1.0).max() < 0.01


def test_a_resumed_optimization_goes_on_where_it_stopped(ellipsoid_shapes, gpu):
    checkpoints = []
    result = optimize(ellipsoid_shapes, QUICK, device=gpu, checkpoint=checkpoints.append)
    rest = optimize(ellipsoid_shapes, QUICK, device=gpu, resume=checkpoints[-1])
    assert np.abs(rest.world - result.world).max() < 0.5
    assert abs(rest.energies[-1, 1:].sum() - result.energies[-1, 1:].sum()) < 0.01


@pytest.mark.parametrize("by_tiles", [False, True])
@pytest.mark.parametrize("apart", [False, True])
def test_two_gpus_place_particles_as_one_does(ellipsoid_shapes, gpu, apart, by_tiles, monkeypatch):
    if apart and wp.get_cuda_device_count() < 2:
        pytest.skip("there is one GPU, which the other case takes twice")
    monkeypatch.setattr(device_duals, "MANY_SHAPES", 0 if by_tiles else 1000)
    devices = f"{gpu},cuda:1" if apart else f"{gpu},{gpu}"
    first, two = (optimize(ellipsoid_shapes, QUICK, device=name) for name in (gpu, devices))
    assert np.abs(two.world - first.world).max() < 0.5
    objectives = [result.energies[:, 1:].sum(axis=1) for result in (first, two)]
    common = min(map(len, objectives))  # rounding may decide when the objective has settled
    assert common >= 6
    np.testing.assert_allclose(objectives[1][:common], objectives[0][:common], atol=2e-3)
    assert abs(objectives[1][-1] - objectives[0][-1]) < 2e-3
