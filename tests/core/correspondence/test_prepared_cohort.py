"""Meshes and tables of the optimizer follow the particles' spacing."""

from dataclasses import replace

import numpy as np
import pytest

from homolog.correspondence.entropy.sampling import LIST_CUTOFF
from homolog.correspondence.prepared_cohort import VERTICES_PER_PARTICLE, prepare_cohort
from homolog.geodesics import measure_accuracy, solve_tables
from homolog.settings import OptimizeSettings
from homolog.surfaces.isosurface import isosurface
from homolog.surfaces.topology import euler_number


@pytest.fixture(scope="module")
def prepared(make_shape):
    """Fine and coarse meshes of 300 particles, and what was asked of the solver."""
    shape = make_shape("a", (20.0, 15.0, 10.0))
    shape = replace(shape, mesh=isosurface(shape.field, edge=0.7))
    asked = []

    def solve(meshes, d_max, **options):
        tables = solve_tables(meshes, d_max, **options)
        asked.append((meshes, d_max, tables))
        return tables

    settings = OptimizeSettings(particles=300)
    prepare_cohort([shape, shape], settings, device="cpu", counts=[300], solve=solve)
    return shape, asked[0]


def test_a_mesh_finer_than_the_particles_need_is_simplified(prepared):
    shape, (meshes, _, _) = prepared
    assert len(shape.mesh.vertices) > VERTICES_PER_PARTICLE * 300
    for mesh in meshes:
        assert len(mesh.vertices) == pytest.approx(VERTICES_PER_PARTICLE * 300, rel=0.01)
        assert euler_number(mesh.faces) == 2
        assert np.abs(shape.field.sample_values(mesh.vertices)).max() < 0.1


def test_a_table_ends_where_neighbours_of_a_particle_do(prepared):
    shape, (meshes, limits, tables) = prepared
    reach = LIST_CUTOFF * np.sqrt(shape.mesh.area / (np.pi * 300))
    for mesh, limit, table in zip(meshes, limits, tables, strict=True):
        assert reach < limit < reach + 2.5 * mesh.mean_edge
        assert table.d_max == limit


def test_distances_on_the_simplified_mesh_are_exact_to_a_fraction_of_a_per_cent(prepared):
    pytest.importorskip("gdist")
    _, (meshes, _, tables) = prepared
    accuracy = measure_accuracy(meshes[0], tables[0], 8)
    assert accuracy.missing == 0
    assert accuracy.mean < 0.002
