import numpy as np
import pytest
import trimesh
from scipy import ndimage

from homolog.grooming import levels
from homolog.grooming.fields import distance_field
from homolog.grooming.levels import edges_crossed, level_of_mesh, level_of_voxels
from homolog.io.volumes import Segmentation
from homolog.surfaces.isosurface import marching_cubes
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture
def of_mask():
    def make(mask, spacing=(1.0, 1.0, 1.0)):
        (box,) = ndimage.find_objects(mask.astype(np.uint8))
        return Segmentation(mask[box], np.eye(3), np.array(spacing), np.zeros(3))

    return make


def surface_of(segmentation):
    field = distance_field(level_of_voxels(segmentation, None, 1.0), 1.0).field
    vertices, faces = marching_cubes(field.values)
    return field, TriangleMesh(vertices, faces).placed(field.index_to_world)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.8, 0.8, 1.5)])
def test_a_large_thick_structure_on_a_coarser_grid_has_the_same_surface(grid, of_mask, monkeypatch, spacing):
    shape = ((grid(36.0, spacing) / [34.0, 26.0, 22.0]) ** 2).sum(axis=-1) < 1.0
    finest, expected = surface_of(of_mask(shape, spacing))
    monkeypatch.setattr(levels, "MANY_NODES", 90_000)
    coarse, mesh = surface_of(of_mask(shape, spacing))
    assert finest.spacing == min(spacing)
    assert coarse.spacing > 1.2 * min(spacing)
    assert mesh.volume == pytest.approx(expected.volume, rel=0.005)
    there, back = coarse.sample_values(expected.vertices), finest.sample_values(mesh.vertices)
    assert max(np.abs(there).mean(), np.abs(back).mean()) < 0.1


def test_a_thin_shell_keeps_the_grid_of_its_voxels(grid, of_mask, monkeypatch):
    radius = np.linalg.norm(grid(26.0), axis=-1)
    shell = (radius < 24.0) & (radius > 22.0) & (grid(26.0)[..., 2] < 10.0)
    monkeypatch.setattr(levels, "MANY_NODES", 50_000)
    assert level_of_voxels(of_mask(shell), None, 1.0).step == 1.0


def test_a_structure_with_a_large_surface_gets_a_grid_that_it_crosses_less_often(grid, of_mask, monkeypatch):
    radius = np.linalg.norm(grid(30.0, (1.0, 1.0, 1.0)), axis=-1)
    shells = of_mask((radius < 28.0) & (radius % 4.0 < 2.0))
    monkeypatch.setattr(levels, "MANY_NODES", 30_000)
    monkeypatch.setattr(levels, "MANY_CROSSED", edges_crossed(shells, 1.0) / 2.0)
    assert level_of_voxels(shells, None, 1.0).step == pytest.approx(np.sqrt(2.0))


def test_a_structure_of_few_nodes_is_not_made_coarser(grid, of_mask):
    ball = np.linalg.norm(grid(26.0), axis=-1) < 24.0
    level = level_of_voxels(of_mask(ball), None, 1.0)
    assert (level.step, level.notes) == (1.0, ())


def test_slices_twice_as_far_apart_as_pixels_are_treated_alike_however_files_round(grid, of_mask):
    mask = ((grid(12.0, (0.5, 0.5, 1.0)) / [11.0, 8.0, 6.0]) ** 2).sum(axis=-1) < 1.0
    exact, rounded = (
        level_of_voxels(of_mask(mask, (0.5, 0.5, size)), None, 1.0) for size in (1.0, 1.0 + 1e-6)
    )
    assert exact.notes == rounded.notes == ()
    inside, other = (np.count_nonzero(level.values < 0.0) for level in (exact, rounded))
    assert inside == pytest.approx(other, rel=1e-3)


def test_noise_of_faces_far_below_the_grid_makes_no_thin_walls():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=10.0)
    edge = ball.edges_unique_length.mean()
    noise = np.random.default_rng(0).normal(scale=0.3 * edge, size=ball.vertices.shape)
    rough = TriangleMesh(ball.vertices + noise, ball.faces)
    level = level_of_mesh(rough, 5.0 * edge)
    assert not level.notes
    assert np.count_nonzero(level.values < 0.0) * level.step**3 == pytest.approx(ball.volume, rel=0.01)


def test_a_thin_wall_of_faces_far_below_the_grid_is_thickened():
    hull = trimesh.creation.box((10.0, 10.0, 0.4)).subdivide_to_size(0.15)
    (note,) = level_of_mesh(TriangleMesh(hull.vertices, hull.faces), 0.4).notes
    assert "0.69 mm thick" in note
