"""A hundred random anatomies, others in each run; HOMOLOG_ANATOMY_SEED=NUMBER draws those of a run again."""

import os

import numpy as np
import pytest
from trial import attempt

from anatomy import LABEL_MAPS, MESHES, label_map, random_mesh
from homolog.grooming.triangles import level_of_triangles
from homolog.settings import GroomSettings

SEED = int(os.environ["HOMOLOG_ANATOMY_SEED"])  # drawn in tests/conftest.py unless the user gave it
FAMILIES = [*LABEL_MAPS, *LABEL_MAPS, *MESHES]  # most people have label maps, and they take less time
VOXELS, VERTICES = 1500.0, 200.0
NODES = 48  # of the grids of all meshes but one: by default a grid has up to two million nodes in all


@pytest.mark.timeout(300)
@pytest.mark.parametrize("number", range(100))
def test_a_random_anatomy_is_groomed_or_refused_with_a_reason(number, tmp_path, request):
    family = FAMILIES[number % len(FAMILIES)]
    is_mesh = family in MESHES
    default_spacing = number == len(FAMILIES) - 1 - SEED % len(MESHES)
    most, nodes = (VERTICES, None if default_spacing else NODES) if is_mesh else (VOXELS, None)
    trial = attempt(family, SEED + number, tmp_path, most=most, edges=12, nodes=nodes)
    again = f'HOMOLOG_ANATOMY_SEED={SEED} pytest "{request.node.nodeid}"'
    assert trial.outcome in ("groomed", "refused"), f"{trial}\nagain: {again}"
    assert trial.reason or trial.outcome == "groomed", f"{trial}\nagain: {again}"


def test_the_solid_of_an_open_mesh_ends_within_its_grid():
    mesh = random_mesh("all of these", 20152, 20000.0)
    values = level_of_triangles(mesh, GroomSettings(spacing=0.02)).level.values
    assert min(np.moveaxis(values, axis, 0)[[0, -1]].min() for axis in range(3)) > 0.0


@pytest.mark.parametrize("family", LABEL_MAPS)
def test_a_seed_makes_the_same_label_map_of_thirty_voxels_or_more(family):
    first, again = label_map(family, SEED, 2000.0), label_map(family, SEED, 2000.0)
    assert first.mask.sum() >= 30
    assert np.array_equal(first.mask, again.mask)
    assert first.spacing.max() < 8.001 * first.spacing.min()
    assert np.linalg.det(first.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("family", MESHES)
def test_a_seed_makes_the_same_mesh(family):
    first, again = random_mesh(family, SEED, 500.0), random_mesh(family, SEED, 500.0)
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.faces, again.faces)


def test_interpolated_slices_that_reach_beyond_the_grid_give_a_closed_surface(tmp_path):
    trial = attempt("tubes", 600260, tmp_path)
    assert trial.outcome == "groomed", trial.reason


def test_edges_longer_than_a_thin_thread_end_in_a_mesh_or_a_reason(tmp_path):
    trial = attempt("tubes", 88655, tmp_path, most=3000.0, edges=12)
    assert trial.outcome in ("groomed", "refused"), trial.reason
