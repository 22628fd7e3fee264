import numpy as np
import pytest

from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="package")
def ellipsoid(unit_sphere):
    """An ellipsoid of 30 x 20 x 40 mm (diameters), 600 vertices."""
    points, faces = unit_sphere(600)
    return TriangleMesh(points * [15.0, 10.0, 20.0], faces)


@pytest.fixture
def bulging(ellipsoid):
    """It grows and shrinks by 3 mm an amount at its upper half, from -2 to 2."""
    from homolog_app.exports.motion import Motion

    up = np.clip(ellipsoid.vertices[:, 2:], 0.0, None) / 20.0
    return Motion(
        ellipsoid, 3.0 * up * ellipsoid.vertex_normals, -2.0, 2.0, lambda at: f"Mode 1   {at:+.1f} SD"
    )
