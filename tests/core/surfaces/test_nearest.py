"""Particles of places on thin walls."""

import numpy as np

from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import areas_of_particles, nearest_particles


def test_a_place_belongs_to_a_particle_of_its_own_side_of_a_thin_wall(unit_sphere):
    points, faces = unit_sphere(600)
    plate = TriangleMesh(points * [20.0, 20.0, 1.0], faces)
    above = plate.vertices[:, 2] > 0.0
    upper = np.flatnonzero(above & (np.abs(plate.vertices[:, :2]).max(axis=1) < 12.0))[::4]
    lower = np.flatnonzero(~above)[::12]
    particles = plate.vertices[np.concatenate([upper, lower])]
    nearest = nearest_particles(plate, particles)
    facing = (np.abs(plate.vertex_normals[:, 2]) > 0.8) & (np.abs(plate.vertices[:, :2]).max(axis=1) < 10.0)
    assert ((nearest >= len(upper)) == ~above)[facing].all()
    plain = np.linalg.norm(plate.vertices[:, None] - particles, axis=2).argmin(axis=1)
    assert ((plain >= len(upper)) != ~above)[facing].any()
    areas = areas_of_particles(plate, nearest, len(particles))
    np.testing.assert_allclose(areas.sum(), plate.area)
