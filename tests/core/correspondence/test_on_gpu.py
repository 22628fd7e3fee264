"""Optimizations on a GPU."""

import dataclasses

import numpy as np
import pytest
import warp as wp

from homolog.correspondence import load_kernels, optimize
from homolog.correspondence.entropy import device_duals
from homolog.correspondence.types import InitialParticles
from homolog.settings import Method, OptimizeSettings, Procrustes
from homolog.surfaces.closest import distances_to
from homolog.surfaces.mesh import TriangleMesh, joined

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


def objective_difference(shapes, settings, gpu, **options):
    here, there = (optimize(shapes, settings, device=device, **options) for device in ("cpu", gpu))
    return abs(float(there.energies[-1, 1:].sum() - here.energies[-1, 1:].sum())), there


def test_a_gpu_optimizes_several_structures_as_the_cpu_does(ellipsoid_shapes, make_shape, gpu):
    beside = make_shape("beside", (5.0, 11.0, 8.0), centre=(25.0, 0.0, 0.0))
    subjects = [
        dataclasses.replace(
            one,
            mesh=joined([one.mesh, beside.mesh]),
            coarse_mesh=joined([one.coarse_mesh, beside.coarse_mesh]),
            parts=(one, dataclasses.replace(beside, name=one.name)),
        )
        for one in ellipsoid_shapes
    ]
    settings = QUICK.model_copy(update={"procrustes": Procrustes.RIGID})
    apart, there = objective_difference(subjects, settings, gpu)
    assert apart < 0.02
    assert there.local.shape == (5, 80, 3)


def test_a_gpu_keeps_particles_on_open_surfaces(ellipsoid_shapes, gpu):
    def cut(mesh):
        kept = mesh.faces[mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 4.0]
        numbers, faces = np.unique(kept, return_inverse=True)
        return TriangleMesh(mesh.vertices[numbers], faces.reshape(kept.shape))

    cups = [
        dataclasses.replace(shape, field=None, mesh=cut(shape.mesh), coarse_mesh=cut(shape.coarse_mesh))
        for shape in ellipsoid_shapes
    ]
    first = optimize(cups, QUICK.model_copy(update={"settle_iterations": 0}), device="cpu")
    start = InitialParticles(np.array(first.local))  # at jagged rims, rounding decides where particles go
    apart, there = objective_difference(cups, QUICK, gpu, initial=start)
    assert apart < 0.1
    for cup, points in zip(cups, there.local, strict=True):
        assert distances_to(cup.mesh, points).max() < 0.05


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
