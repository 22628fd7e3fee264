import numpy as np
import pytest
from scipy.spatial import ConvexHull

from homolog.geodesics import distances_from, solve_tables
from homolog.surfaces.mesh import TriangleMesh


def arc(mesh, point):
    chord = np.linalg.norm(mesh.vertices - point, axis=1)
    return 60 * np.arcsin(np.minimum(chord / 60, 1.0))


def test_a_field_is_the_distance_from_its_source(sphere):
    mesh = sphere(1500)
    field = distances_from(mesh, [7])
    assert field[7] == 0
    assert np.abs(field - arc(mesh, mesh.vertices[7])).max() < 0.02 * 30 * np.pi


def test_a_field_of_two_sources_is_the_distance_from_the_nearer(sphere):
    mesh = sphere(1500)
    field = distances_from(mesh, [7, 1200])
    nearer = np.minimum(arc(mesh, mesh.vertices[7]), arc(mesh, mesh.vertices[1200]))
    assert np.abs(field - nearer).max() < 0.02 * 30 * np.pi


def test_a_field_starts_from_a_point_within_a_face(sphere):
    mesh = sphere(1500)
    corners = mesh.faces[10]
    point = mesh.vertices[corners].mean(axis=0)
    field = distances_from(mesh, corners, np.linalg.norm(mesh.vertices[corners] - point, axis=1))
    assert field.min() > 0
    near = (arc(mesh, point) > 3) & (arc(mesh, point) < 20)
    assert field[near] == pytest.approx(arc(mesh, point)[near], rel=0.02)


@pytest.fixture
def globe():
    """Return a sphere of meridians and parallels: 80 triangles at each pole."""
    height, turn = np.meshgrid(
        np.linspace(0, np.pi, 42)[1:-1], np.linspace(0, 2 * np.pi, 81)[:-1], indexing="ij"
    )
    rings = np.stack([np.sin(height) * np.cos(turn), np.sin(height) * np.sin(turn), np.cos(height)], axis=-1)
    points = np.concatenate([rings.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    return TriangleMesh(30 * points, np.where(inward[:, None], faces[:, ::-1], faces))


def test_a_vertex_of_eighty_triangles_is_no_obstacle_from_any_side(globe):
    pole = len(globe.vertices) - 2
    table = solve_tables([globe], 20.0)[0].to_csr()
    for source in range(6 * 80, 7 * 80, 4):
        across = 30 * np.arccos(np.clip(globe.vertices @ globe.vertices[source] / 900, -1, 1))
        for row, reach in ((distances_from(globe, [source]), 40), (table[[source]].toarray()[0], 19)):
            near = (across > 4) & (across < reach)
            assert near[pole]
            assert row[near] == pytest.approx(across[near], rel=5e-3)


def test_a_field_is_a_row_of_the_table(slotted):
    table = solve_tables([slotted], 6.5)[0].to_csr()
    field = distances_from(slotted, [42])
    row = table[[42]].toarray()[0]
    near = row > 0
    assert np.abs(field[near] - row[near]).mean() < 2.5e-3  # the table is the mean of both directions
