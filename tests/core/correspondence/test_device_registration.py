"""Distances of shapes as a GPU computes them, on the CPU device."""

import numpy as np
import pytest

from homolog.correspondence.initialization.device_registration import mean_distances
from homolog.correspondence.initialization.registration import (
    N_SAMPLES,
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
