import numpy as np
import pytest
from scipy.spatial import ConvexHull

from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="package")
def ellipsoid():
    """An ellipsoid of 30 x 20 x 40 mm (diameters), 600 vertices."""
    index = np.arange(600)
    height = 1.0 - (2.0 * index + 1.0) / 600
    turn = np.pi * (1.0 + 5**0.5) * index
    radius = np.sqrt(1.0 - height**2)
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])
    faces = ConvexHull(points).simplices.copy()
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, corners.mean(axis=1)) < 0
    faces[inward] = faces[inward][:, ::-1]
    return TriangleMesh(points * [15.0, 10.0, 20.0], faces)


@pytest.fixture
def bulging(ellipsoid):
    """It grows and shrinks by 3 mm an amount at its upper half, from -2 to 2."""
    from homolog_app.films.motion import Motion

    up = np.clip(ellipsoid.vertices[:, 2:], 0.0, None) / 20.0
    return Motion(
        ellipsoid, 3.0 * up * ellipsoid.vertex_normals, -2.0, 2.0, lambda at: f"Mode 1   {at:+.1f} SD"
    )
