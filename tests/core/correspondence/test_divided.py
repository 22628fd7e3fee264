"""Shapes divided among several devices; here each of them is the CPU."""

import numpy as np
import pytest

from homolog.correspondence import InitialParticles, optimize
from homolog.correspondence.divided import make_engine, prepare_on
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.schedule import plan_stages
from homolog.device import choose_device, describe_device, device_faults
from homolog.errors import Cancelled, InputError
from homolog.settings import OptimizeSettings, RunSettings

QUICK = OptimizeSettings(
    particles=40, split_iterations=20, anneal_iterations=80, settle_iterations=60, regularization_end=0.01
)  # a larger regularization than usual, so that rounding is amplified less
ROUNDING = 0.1
"""[mm] after 160 iterations, of a spacing of 5: neighbours are summed in another order."""


@pytest.fixture(scope="module")
def result(ellipsoid_shapes):
    return optimize(ellipsoid_shapes, QUICK, device="cpu")


@pytest.mark.parametrize("devices", ["cpu,cpu", "cpu,cpu,cpu", ",".join(8 * ["cpu"])])
def test_several_devices_place_particles_as_one_does(result, ellipsoid_shapes, devices):
    divided = optimize(ellipsoid_shapes, QUICK, device=devices)
    assert divided.iterations == result.iterations
    np.testing.assert_allclose(divided.energies, result.energies, atol=2e-4)
    assert np.abs(divided.world - result.world).max() < ROUNDING


def test_the_first_iterations_on_several_devices_are_those_on_one(result, ellipsoid_shapes):
    engines, weights = [], plan_stages(QUICK)[1].weights(0)
    for devices in (["cpu"], 3 * ["cpu"]):
        cohort = prepare_on(devices, ellipsoid_shapes, QUICK, counts=[40])
        pairs = zip(cohort.to_optimizer, result.local, strict=True)
        points = np.stack([similarity.apply(local) for similarity, local in pairs])
        launcher = Launcher("cpu", 1)
        engine = make_engine(cohort, points, launcher, np.tile(np.eye(4), (5, 1, 1)), None)
        engine.start_stage([weights, weights])
        engine.iterate(2)
        engines.append(engine)
    first, three = engines
    assert np.abs(three.host_positions() - first.host_positions()).max() < 1e-4  # of a spacing of 16
    np.testing.assert_allclose(three.energy(), first.energy(), atol=1e-6)
    np.testing.assert_allclose(three.surface_distances(), first.surface_distances(), atol=1e-4)


def test_a_run_of_several_devices_goes_on_on_one(result, ellipsoid_shapes):
    kept = []
    divided = optimize(ellipsoid_shapes, QUICK, device="cpu,cpu", checkpoint=kept.append)
    again = optimize(ellipsoid_shapes, QUICK, device="cpu,cpu", resume=kept[-1])
    np.testing.assert_array_equal(again.world, divided.world)
    alone = optimize(ellipsoid_shapes, QUICK, device="cpu", resume=kept[-1])
    assert np.abs(alone.world - result.world).max() < ROUNDING


def test_a_cancelled_run_of_several_devices_can_be_gone_on_with(result, ellipsoid_shapes):
    kept = []

    def tick(fraction, message):
        if fraction > 0.9 and message.startswith("optimizing"):
            raise Cancelled

    with pytest.raises(Cancelled):
        optimize(ellipsoid_shapes, QUICK, device="cpu,cpu", checkpoint=kept.append, tick=tick)
    rest = optimize(ellipsoid_shapes, QUICK, device="cpu,cpu", resume=kept[-1])
    assert np.abs(rest.world - result.world).max() < ROUNDING


def test_fixed_particles_stay_on_every_device(result, ellipsoid_shapes):
    free = np.zeros((5, 40), np.bool_)
    free[4] = True
    start = InitialParticles(result.local, free)
    divided = optimize(ellipsoid_shapes, QUICK, device="cpu,cpu", initial=start)
    np.testing.assert_array_equal(divided.local[:4], result.local[:4])
    assert np.abs(divided.local[4] - result.local[4]).max() < 2.0


def test_a_device_that_is_lost_is_told_with_how_to_go_on():
    with (
        pytest.raises(InputError, match=r"cuda:0,cuda:1: failed .*those of the devices that work"),
        device_faults("cuda:0,cuda:1"),
    ):
        raise RuntimeError("Warp CUDA error 719: unspecified launch failure")


def test_devices_are_checked_and_described():
    assert choose_device("cpu,cpu") == "cpu,cpu"
    assert describe_device("cpu,cpu").count("CPU") == 2
    with pytest.raises(InputError, match="'cuda:99' is not on this machine"):
        choose_device("cpu,cuda:99")
    with pytest.raises(ValueError, match="device"):
        RunSettings(device="cuda:0,")
    assert RunSettings(device="cuda:0,cuda:1").device == "cuda:0,cuda:1"
