"""Marching cubes, simplification and remeshing of one torus and one ellipsoid."""

import numpy as np
import pytest
from scipy import ndimage

from homolog.errors import InputError, NumericalError
from homolog.surfaces.closest import distances_to
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.half_edges import ascending
from homolog.surfaces.isosurface import coarse_isosurface, isosurface, marching_cubes, zero_level
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.remesh import remeshed
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import check_mesh, euler_number, rim_sides

LARGE, SMALL = 12.0, 4.0


@pytest.fixture(scope="module")
def torus():
    points = np.stack(np.meshgrid(*[np.arange(-22.0, 23.0)] * 3, indexing="ij"), axis=-1)
    ring = np.hypot(points[..., 0], points[..., 1]) - LARGE
    affine = np.eye(4)
    affine[:3, 3] = -22.0
    return DistanceField(np.hypot(ring, points[..., 2]) - SMALL, affine)


@pytest.fixture(scope="module")
def mesh(torus):
    return isosurface(torus, 0.9)


def shape_of(mesh):
    corners = mesh.vertices[mesh.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return sides, 4.0 * np.sqrt(3.0) * mesh.face_areas / (sides**2).sum(axis=1)


def test_a_torus_is_met_with_its_genus_and_outward(mesh):
    check_mesh(mesh, "torus")
    assert euler_number(mesh.faces) == 0
    assert mesh.volume == pytest.approx(2.0 * np.pi**2 * LARGE * SMALL**2, rel=0.02)
    assert mesh.area == pytest.approx(4.0 * np.pi**2 * LARGE * SMALL, rel=0.02)
    off = np.hypot(np.hypot(*mesh.vertices[:, :2].T) - LARGE, mesh.vertices[:, 2]) - SMALL
    assert np.abs(off).max() < 0.06


def test_a_known_zero_level_gives_the_same_mesh(torus, mesh):
    again = isosurface(torus, 0.9, level=zero_level(torus))
    assert np.array_equal(again.vertices, mesh.vertices)
    assert np.array_equal(again.faces, mesh.faces)


def test_numbers_are_sorted_with_equal_ones_in_their_order():
    values = np.random.default_rng(3).integers(-5, 6, size=1000) / 4.0
    values[::50] = -0.0
    assert np.array_equal(ascending(values), np.argsort(values, kind="stable"))


def test_triangles_are_even(mesh):
    sides, quality = shape_of(mesh)
    assert sides.mean() == pytest.approx(0.9, rel=0.05)
    assert sides.max() < 1.7 * sides.mean()
    assert sides.min() > 0.4 * sides.mean()
    assert quality.min() > 0.5
    assert quality.mean() > 0.95


def test_the_usual_number_of_vertices_is_six_thousand(torus):
    assert len(isosurface(torus).vertices) == pytest.approx(6000, rel=0.05)


def test_a_coarse_mesh_keeps_the_handle(torus, mesh):
    coarse = coarse_isosurface(torus, mesh, 300)
    check_mesh(coarse, "coarse")
    assert euler_number(coarse.faces) == 0
    assert len(coarse.vertices) == pytest.approx(300, rel=0.15)
    assert shape_of(coarse)[1].min() > 0.3


def test_simplifying_keeps_the_topology_and_meets_the_number(mesh):
    fewer = simplified(mesh, 500)
    check_mesh(fewer, "fewer")
    assert euler_number(fewer.faces) == 0
    assert len(fewer.vertices) == pytest.approx(500, abs=5)


def test_a_mesh_with_few_vertices_is_not_simplified(mesh):
    assert simplified(mesh, len(mesh.vertices)) is mesh


def sponge(seed):
    """Return the smooth field of a random solid with many handles: a thresholded Gaussian random field."""
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(26, 26, 26)), 2.2)
    rim = np.pad(np.zeros((22, 22, 22)), 2, constant_values=1.0)
    level = np.maximum(-noise / noise.std(), 4.0 * rim - 0.1)
    labels, _ = ndimage.label(level < 0.0)
    largest = labels == 1 + np.argmax(np.bincount(labels.ravel())[1:])
    solid = ndimage.binary_fill_holes(np.pad(largest, 3))
    inside, outside = (ndimage.distance_transform_edt(item) for item in (solid, ~solid))
    return DistanceField(ndimage.gaussian_filter(outside - inside, 0.8), np.eye(4))


@pytest.mark.parametrize("seed", [2, 3])
def test_meshes_of_a_solid_with_many_handles_are_manifold_and_of_one_genus(seed):
    field = sponge(seed)
    fine = isosurface(field)
    coarse = coarse_isosurface(field, fine, 1500)
    for mesh in (fine, coarse, simplified(fine, 700)):
        check_mesh(mesh, "sponge")
        assert euler_number(mesh.faces) == euler_number(fine.faces)
    assert euler_number(fine.faces) < 0


def test_simplifying_keeps_every_handle_however_few_vertices_are_wanted():
    fine = isosurface(sponge(3))
    few = simplified(fine, 10)
    check_mesh(few, "sponge")
    assert euler_number(few.faces) == euler_number(fine.faces)
    assert len(few.vertices) < 0.1 * len(fine.vertices)


def test_simplifying_does_not_depend_on_the_unit(mesh):
    metres = simplified(TriangleMesh(mesh.vertices / 1024.0, mesh.faces), 800)
    assert np.array_equal(metres.faces, simplified(mesh, 800).faces)


def test_a_mesh_that_is_open_keeps_its_rims_when_it_is_simplified(mesh):
    below = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 3.0
    used, faces = np.unique(mesh.faces[below], return_inverse=True)
    opened = TriangleMesh(mesh.vertices[used], faces.reshape(-1, 3))
    fewer = simplified(opened, 500)
    check_mesh(fewer, "fewer", may_open=True)
    assert len(fewer.vertices) == 500
    assert euler_number(fewer.faces) == euler_number(opened.faces)
    rim, far = rim_sides(fewer.faces)[0], 0.05 * opened.mean_edge
    assert len(rim) < len(rim_sides(opened.faces)[0])
    assert distances_to(opened, fewer.vertices[rim].mean(axis=1)).max() < 2.0 * opened.mean_edge
    assert np.median(distances_to(opened, fewer.vertices[rim[:, 0]])) < far
    assert fewer.area == pytest.approx(opened.area, rel=0.01)


def test_a_mesh_with_an_edge_of_three_faces_is_not_simplified(mesh):
    pinched = TriangleMesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:1]]))
    assert simplified(pinched, 500) is pinched


def test_a_coarse_mesh_reaches_the_tip_of_a_thin_process():
    points = np.stack(np.meshgrid(*[np.arange(-16.0, 17.0)] * 3, indexing="ij"), axis=-1)
    body = np.linalg.norm(points - np.array([-8.0, 0.0, 0.0]), axis=-1) - 6.0
    along = np.clip(points[..., 0], 0.0, 11.0)
    process = np.linalg.norm(points - along[..., None] * [1.0, 0.0, 0.0], axis=-1) - 1.2
    field = DistanceField(np.minimum(body, process), np.diag([1.0, 1.0, 1.0, 1.0]))
    fine = isosurface(field, 0.6)
    coarse = coarse_isosurface(field, fine, 300)
    check_mesh(coarse, "process")
    assert coarse.vertices[:, 0].max() > fine.vertices[:, 0].max() - 0.5
    assert len(coarse.vertices) < 900


def test_simplifying_far_from_the_origin_loses_nothing(mesh):
    shift = np.array([1e4, -2e4, 3e4])
    far = simplified(TriangleMesh(mesh.vertices + shift, mesh.faces), 800)
    assert np.allclose(far.vertices - shift, simplified(mesh, 800).vertices, atol=1e-2)


def test_remeshing_a_coarse_mesh_finer_keeps_it_on_the_surface(torus, mesh):
    fine = remeshed(simplified(mesh, 400), torus, 0.9)
    check_mesh(fine, "fine")
    assert euler_number(fine.faces) == 0
    assert np.abs(torus.sample_values(fine.vertices)).max() < 0.02
    assert shape_of(fine)[1].mean() > 0.95


def test_values_at_zero_make_no_needles():
    """Nodes exactly on the surface are where marching cubes makes triangles without area."""
    x, y, z = np.meshgrid(*[np.arange(-6.0, 7.0)] * 3, indexing="ij")
    vertices, faces = marching_cubes(np.abs(x) + np.abs(y) + np.abs(z) - 3.0)
    check_mesh(TriangleMesh(vertices, faces), "octahedron")


def test_values_far_from_a_surface_leave_it_where_it_is():
    radius = np.linalg.norm(np.stack(np.meshgrid(*[np.arange(-6.0, 7.0)] * 3)), axis=0)
    thread = np.pad(radius - 3.02, 60, mode="linear_ramp", end_values=60.0)
    near, far = (TriangleMesh(*marching_cubes(values)) for values in (radius - 3.02, thread))
    assert far.volume == pytest.approx(near.volume, rel=1e-6)


def test_the_largest_of_two_surfaces_is_returned():
    x, y, z = np.meshgrid(*[np.arange(-10.0, 11.0)] * 3, indexing="ij")
    two = np.minimum(np.hypot(np.hypot(x + 3, y), z) - 5.0, np.hypot(np.hypot(x - 7, y), z) - 2.0)
    vertices, _ = marching_cubes(two)
    assert (vertices[:, 0] - 10.0).max() < 2.5


def test_a_field_without_a_surface_is_an_error():
    with pytest.raises(NumericalError, match="vanishes"):
        isosurface(DistanceField(np.ones((8, 8, 8)), np.eye(4)))


def test_edges_that_ask_for_millions_of_vertices_are_refused(torus):
    with pytest.raises(InputError, match=r"choose .* mm or more"):
        isosurface(torus, 0.01)


def test_a_surface_that_crosses_too_many_edges_of_the_grid_is_refused_with_a_spacing(torus, monkeypatch):
    crossed = len(marching_cubes(torus.values)[0])
    monkeypatch.setattr("homolog.surfaces.isosurface.MAX_CROSSED_EDGES", crossed // 4)
    with pytest.raises(InputError, match="set the grid spacing to 2 mm or more"):
        isosurface(torus)


def test_a_mesh_that_is_not_closed_is_an_error(torus, mesh):
    with pytest.raises(NumericalError, match="open or pinched"):
        remeshed(TriangleMesh(mesh.vertices, mesh.faces[1:]), torus, 1.0)


def test_the_zero_level_of_a_read_only_field_is_found_and_the_field_stays_as_it_is():
    points = np.stack(np.meshgrid(*[np.arange(9.0)] * 3, indexing="ij"), axis=-1)
    values = np.linalg.norm(points - 4.1, axis=-1) - 2.5  # no node is close to the level
    before = values.copy()
    values.setflags(write=False)
    vertices, _ = marching_cubes(values)
    np.testing.assert_allclose(np.linalg.norm(vertices - 4.1, axis=1), 2.5, atol=0.2)
    np.testing.assert_array_equal(values, before)
