"""Registration as a GPU computes it, on the CPU device."""

import numpy as np
import pytest

from homolog.correspondence.initialization.device_registration import DeviceRegistration, mean_distances
from homolog.correspondence.initialization.registration import (
    MATCH_WIDTH,
    N_SAMPLES,
    NORMAL_LENGTH,
    SMOOTHINGS,
    Registration,
    shape_distances,
)
from homolog.surfaces.mesh import TriangleMesh

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]


@pytest.fixture(scope="module")
def meshes(ellipsoid_shapes):
    coarse = [shape.coarse_mesh for shape in ellipsoid_shapes[:3]]
    return [TriangleMesh(mesh.vertices / 0.12, mesh.faces) for mesh in coarse]


@pytest.mark.parametrize("device", DEVICES)
def test_distances_of_shapes_are_those_of_the_host(meshes, device):
    candidates, expected = shape_distances(meshes)
    made = mean_distances(meshes, candidates, N_SAMPLES, device)
    np.testing.assert_allclose(made, expected, rtol=1e-12)


@pytest.mark.parametrize("device", DEVICES)
def test_a_source_is_deformed_as_on_the_host(meshes, device):
    registration = Registration.of(meshes[0])
    there = DeviceRegistration(
        registration, match_width=MATCH_WIDTH, normal_length=NORMAL_LENGTH, device=device
    )
    guesses = [meshes[0].vertices, 1.02 * meshes[0].vertices]
    expected = registration.deform(meshes[1:], guesses)
    for made, own in zip(there.deform(meshes[1:], guesses, SMOOTHINGS), expected, strict=True):
        np.testing.assert_allclose(made.vertices, own.vertices, atol=1e-7)
