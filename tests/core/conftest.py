"""Volumes and surfaces with known answers."""

import numpy as np
import pytest
import SimpleITK


@pytest.fixture
def grid():
    """Return points (I, J, K, 3) [mm] of a grid about the origin with a spacing per axis."""

    def make(half, spacing=(1.0, 1.0, 1.0)):
        axes = [np.arange(-np.ceil(half / step), np.ceil(half / step) + 1) * step for step in spacing]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    return make


@pytest.fixture
def save(tmp_path):
    """Write an array indexed [i, j, k] as a volume and return its path."""

    def write(values, name="a.nrrd", spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0), direction=None):
        values = np.asarray(values)
        image = SimpleITK.GetImageFromArray((values.astype(np.uint8) if values.dtype == bool else values).T)
        image.SetSpacing([float(item) for item in spacing])
        image.SetOrigin([float(item) for item in origin])
        if direction is not None:
            image.SetDirection(np.asarray(direction, float).ravel().tolist())
        SimpleITK.WriteImage(image, str(tmp_path / name))
        return tmp_path / name

    return write


@pytest.fixture
def sphere_volume(grid, save):
    """Write a sphere of 8 mm about (10, 20, 30) mm and return its path."""

    def write(name="a.nrrd", radius=8.0):
        points = grid(12.0)
        return save(np.linalg.norm(points, axis=-1) < radius, name, origin=(-2.0, 8.0, 18.0))

    return write


@pytest.fixture(scope="session")
def egg():
    """Return an ellipsoid of 20 x 14 x 10 mm half axes, 2562 vertices."""
    return _ellipsoid(4)


@pytest.fixture(scope="session")
def coarse_egg():
    """Return the same ellipsoid with 642 vertices, for tests that register it many times."""
    return _ellipsoid(3)


def _ellipsoid(subdivisions):
    import trimesh

    from homolog.surfaces.mesh import TriangleMesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return TriangleMesh(np.asarray(ball.vertices) * [20.0, 14.0, 10.0], np.asarray(ball.faces))
