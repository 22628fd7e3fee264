"""Small cohorts with known surfaces, ready for the optimizer."""

import numpy as np
import pytest

from homolog.correspondence import Shape
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import isosurface
from homolog.surfaces.simplify import simplified


def ellipsoid_field(axes, centre=(0.0, 0.0, 0.0), spacing=1.0):
    """Return a near-distance field whose zero level is exactly the ellipsoid."""
    half = int(np.ceil(max(axes) / spacing)) + 5
    line = np.arange(-half, half + 1) * spacing
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    level = np.linalg.norm(grid / axes, axis=-1)
    steep = np.linalg.norm(grid / np.square(axes), axis=-1)
    values = level * (level - 1.0) / np.maximum(steep, 1e-6)
    values[half, half, half] = -min(axes)
    index_to_world = np.diag([spacing] * 3 + [1.0])
    index_to_world[:3, 3] = np.asarray(centre) - half * spacing
    return DistanceField(values, index_to_world)


def shape_of(name, axes, alignment=None, **options):
    """Return a shape whose local frame is the ellipsoid's own."""
    field = ellipsoid_field(axes, **options)
    mesh = isosurface(field, edge=0.12 * max(axes))
    return Shape(name, field, mesh, simplified(mesh, 500), np.eye(4) if alignment is None else alignment)


@pytest.fixture(scope="session")
def make_shape():
    """Return the function that makes an ellipsoid shape."""
    return shape_of


@pytest.fixture(scope="session")
def ball():
    """Return a sphere of radius 10."""
    return shape_of("ball", (10.0, 10.0, 10.0))


@pytest.fixture(scope="session")
def ellipsoid_shapes():
    """Return five ellipsoids that differ in one axis."""
    return [shape_of(f"e{k}", (12.0, 9.0, 6.0 + 0.5 * k)) for k in range(5)]
