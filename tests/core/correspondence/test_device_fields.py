"""Opening angles and B-splines as a GPU computes them, on the CPU device."""

import numpy as np
import pytest
from scipy import ndimage

from homolog.correspondence.device_fields import angles_and_coefficients, coefficients_on
from homolog.correspondence.entropy.opening_angles import opening_grid, openings_at
from homolog.surfaces.distance_field import DistanceField

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]


def ellipsoid(half, spacing):
    lines = [np.arange(-(n + 5), n + 5, spacing) for n in half]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    values = (np.linalg.norm(grid / half, axis=-1) - 1.0) * min(half)
    frame = np.diag([spacing] * 3 + [1.0])
    frame[:3, 3] = [line[0] for line in lines]
    return DistanceField(values, frame)


FIELDS = [ellipsoid((6.0, 7.0, 9.0), 1.0), ellipsoid((5.0, 9.0, 6.0), 0.7)]


@pytest.mark.parametrize("device", DEVICES)
def test_coefficients_are_those_of_the_host(device):
    for field, made in zip(FIELDS, coefficients_on(device, FIELDS), strict=True):
        expected = ndimage.spline_filter(field.values, order=3, output=np.float32, mode="mirror")
        np.testing.assert_allclose(made.numpy(), expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("size", [1.5, 6.0])  # with nodes as fine as the field's, and coarser ones
def test_opening_angles_are_those_of_the_host(device, size):
    points = [np.array([[6.0, 0.0, 0.0], [0.0, 5.0, 4.0], [90.0, 0.0, 0.0]])] * 2
    made = angles_and_coefficients(device, FIELDS, [size] * 2, points)
    for field, own, (angles, coefficients, affine) in zip(FIELDS, points, made, strict=True):
        values, grid = opening_grid(field, size)
        np.testing.assert_allclose(angles, openings_at(own, values, grid), atol=2e-6)
        expected = ndimage.spline_filter(values, order=3, output=np.float32, mode="mirror")
        np.testing.assert_allclose(coefficients.numpy(), expected, atol=1e-5)
        np.testing.assert_array_equal(affine, grid.index_to_local)
