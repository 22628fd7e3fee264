import numpy as np
import pytest

from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import isosurface
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import REACH, mesh_level


@pytest.fixture(scope="module")
def cube():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * 6.0 + 1000.0
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    return TriangleMesh(corners, np.array(faces))


def test_distances_to_a_cube_are_exact_within_reach(cube):
    step = 0.5
    level = mesh_level(cube, np.full(3, 998.0), step, (21, 21, 21))
    points = np.stack(np.meshgrid(*[np.arange(21) * step + 998.0] * 3, indexing="ij"), axis=-1)
    outside = np.maximum(np.abs(points - 1003.0) - 3.0, 0.0)
    inside = 3.0 - np.abs(points - 1003.0).max(axis=-1)
    exact = np.where(inside > 0.0, -inside, np.linalg.norm(outside, axis=-1)) / step
    surface = np.abs(exact) > 1e-6  # on the surface itself the sign is a matter of rounding
    assert np.allclose(level[surface], np.clip(exact, -REACH, REACH)[surface], atol=1e-3)


def test_the_surface_made_from_it_is_the_mesh_it_was_made_of():
    points = np.stack(np.meshgrid(*[np.arange(-16.0, 17.0)] * 3, indexing="ij"), axis=-1)
    affine = np.eye(4)
    affine[:3, 3] = -16.0
    mesh = isosurface(DistanceField(np.linalg.norm(points, axis=-1) - 11.0, affine))
    level = mesh_level(mesh, np.full(3, -16.0), 1.0, (33, 33, 33))
    assert np.abs(DistanceField(level, affine).sample_values(mesh.vertices)).max() < 0.05
