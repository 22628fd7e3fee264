import numpy as np
import pytest
import warp as wp

from homolog.geodesics import solve_tables
from homolog.geodesics.kernels.lookup import (
    MISSING,
    TableData,
    blocks_of,
    corner_codes,
    geodesic,
    surface_point,
)


@wp.kernel
def look_up(
    tables: wp.array(dtype=TableData),
    vertices: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    face: wp.array2d(dtype=wp.int32),
    point: wp.array2d(dtype=wp.vec3),
    distances: wp.array(dtype=wp.vec4),
):
    k = wp.tid()
    x = surface_point(vertices, faces, face[k, 0], point[k, 0])
    y = surface_point(vertices, faces, face[k, 1], point[k, 1])
    pair = geodesic(tables[0], blocks_of(tables[0], x.corners), x, y)
    distances[k] = wp.vec4(pair.at_x[0], pair.at_x[1], pair.at_x[2], pair.distance)


@wp.kernel
def look_up_vertices(
    tables: wp.array(dtype=TableData), pairs: wp.array(dtype=wp.vec2i), distances: wp.array(dtype=float)
):
    k = wp.tid()
    table = tables[k % 2]
    i = pairs[k][0]
    j = pairs[k][1]
    code = corner_codes(table, blocks_of(table, wp.vec3i(i, i, i)), wp.vec3i(j, j, j))[0, 0]
    distances[k] = wp.where(code == MISSING, -1.0, float(code) * table.unit)


def between(mesh, table, faces, points):
    """Derivative at x and distance of pairs of points, (n, 4); faces (n, 2), points (n, 2, 3)."""
    data = table.on_device("cpu")
    distances = wp.zeros(len(faces), dtype=wp.vec4, device="cpu")
    inputs = [
        wp.array([data], dtype=TableData, device="cpu"),
        wp.array(mesh.vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(mesh.faces, dtype=wp.vec3i, device="cpu"),
        wp.array(faces.astype(np.int32), dtype=wp.int32, ndim=2, device="cpu"),
        wp.array(points.astype(np.float32), dtype=wp.vec3, ndim=2, device="cpu"),
    ]
    wp.launch(look_up, len(faces), inputs=inputs, outputs=[distances], device="cpu")
    return distances.numpy()


def random_points(mesh, faces, random):
    weights = random.dirichlet([1, 1, 1], faces.shape)
    return np.einsum("...i,...ij->...j", weights, mesh.vertices[mesh.faces[faces]])


@pytest.fixture(scope="module")
def pairs(sphere):
    """Return a sphere, its table to 15, and random pairs of points with their arcs and directions."""
    mesh = sphere(3000)
    random = np.random.default_rng(1)
    faces = random.integers(len(mesh.faces), size=(6000, 2))
    near = np.argsort(
        np.linalg.norm(
            mesh.vertices[mesh.faces].mean(1)[faces[:100, 0], None] - mesh.vertices[mesh.faces].mean(1),
            axis=2,
        ),
        axis=1,
    )[:, :60]
    faces[:, 0] = np.repeat(faces[:100, 0], 60)
    faces[:, 1] = near.ravel()
    points = random_points(mesh, faces, random)
    a, b = np.moveaxis(points / np.linalg.norm(points, axis=2, keepdims=True), 1, 0)
    arc = 60 * np.arcsin(np.linalg.norm(a - b, axis=1) / 2)
    away = a * np.einsum("ij,ij->i", a, b)[:, None] - b
    return (
        mesh,
        solve_tables([mesh], 15.0)[0],
        faces,
        points,
        arc,
        away / np.linalg.norm(away, axis=1, keepdims=True),
    )


def test_the_distance_is_the_arc_between_any_points(pairs):
    mesh, _, faces, points, arc, _ = pairs
    distances = between(mesh, solve_tables([mesh], 15.0)[0], faces, points)[:, 3]
    known = (distances >= 0) & (arc > mesh.mean_edge / 4)
    assert np.count_nonzero(known) > 5000
    assert np.abs(distances[known] / arc[known] - 1).mean() < 0.0015
    close = arc <= mesh.mean_edge / 4
    assert np.abs(distances - arc)[close].max() < 0.02 * mesh.mean_edge


def test_the_derivative_points_away_from_the_other_point(pairs):
    mesh, table, faces, points, arc, away = pairs
    edge_slope = between(mesh, table, faces, points)[:, :3]
    far = arc > mesh.mean_edge
    assert np.linalg.norm(edge_slope[far], axis=1) == pytest.approx(1.0, abs=0.02)
    assert np.einsum("ij,ij->i", edge_slope, away)[far].min() > np.cos(np.radians(5))


def test_the_derivative_is_that_of_the_distance(pairs):
    mesh, table, faces, points, arc, _ = pairs
    points = 0.9 * points + 0.1 * mesh.vertices[mesh.faces[faces]].mean(axis=2)  # off the edges
    corner = mesh.vertices[mesh.faces[faces[:, 0], 0]]
    step = 0.01 * (corner - points[:, 0])
    moved = points.copy()
    moved[:, 0] += step
    back = points.copy()
    back[:, 0] -= step
    edge_slope = between(mesh, table, faces, points)[:, :3]
    measured = between(mesh, table, faces, moved)[:, 3] - between(mesh, table, faces, back)[:, 3]
    far = arc > mesh.mean_edge
    predicted = np.einsum("ij,ij->i", edge_slope, 2 * step)
    assert np.abs(measured - predicted)[far].max() < 1e-4 * mesh.mean_edge


def test_a_point_has_no_distance_from_itself(pairs):
    mesh, table, faces, points, _, _ = pairs
    same = points.copy()
    same[:, 1] = same[:, 0]
    distances = between(mesh, table, faces[:, [0, 0]], same)
    assert distances[:, 3].max() < 0.01 * mesh.mean_edge


def test_a_pair_with_a_missing_entry_is_out_of_range(pairs):
    mesh, _, faces, points, arc, _ = pairs
    table = solve_tables([mesh], 4.0)[0]
    distances = between(mesh, table, faces, points)
    out = distances[:, 3] < 0
    assert out[arc > 4.0 + 2 * mesh.mean_edge].all()
    assert not out[arc < 4.0 - 4 * mesh.mean_edge].any()
    assert (distances[out, :3] == 0).all()


def test_tables_of_several_shapes_lie_in_one_array_scaled(sphere):
    meshes = [sphere(300), sphere(500)]
    tables = [solve_tables([mesh], 10.0)[0] for mesh in meshes]
    data = [tables[0].on_device("cpu"), tables[1].on_device("cpu", scale=0.1)]
    pairs = np.random.default_rng(0).integers(300, size=(400, 2)).astype(np.int32)
    distances = wp.zeros(400, dtype=float, device="cpu")
    inputs = [wp.array(data, dtype=TableData, device="cpu"), wp.array(pairs, dtype=wp.vec2i, device="cpu")]
    wp.launch(look_up_vertices, 400, inputs=inputs, outputs=[distances], device="cpu")
    for which, scale in ((0, 1.0), (1, 0.1)):
        matrix = tables[which].to_csr().toarray()
        wanted = scale * matrix[pairs[which::2, 0], pairs[which::2, 1]]
        there = (wanted > 0) | (pairs[which::2, 0] == pairs[which::2, 1])
        assert distances.numpy()[which::2][there] == pytest.approx(wanted[there], rel=1e-5)
        assert (distances.numpy()[which::2][~there] < 0).all()


def test_within_one_triangle_the_distance_is_straight(pairs):
    mesh = pairs[0]
    random = np.random.default_rng(3)
    faces = np.repeat(random.integers(len(mesh.faces), size=(200, 1)), 2, axis=1)
    points = random_points(mesh, faces, random)
    points[:20, 1] = points[:20, 0]
    distances = between(mesh, solve_tables([mesh], 15.0)[0], faces, points)
    apart = points[:, 0] - points[:, 1]
    np.testing.assert_allclose(distances[:, 3], np.linalg.norm(apart, axis=1), atol=1e-5)
    assert (distances[:20] == 0).all()
    away = apart[20:] / np.linalg.norm(apart[20:], axis=1, keepdims=True)
    assert np.median(np.einsum("ij,ij->i", distances[20:, :3], away)) > 0.9999
