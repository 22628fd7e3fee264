"""Second order: arrival directions and corrections."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial import ConvexHull

from homolog.geodesics import distances_from, measure_accuracy, solve_table
from homolog.geodesics.kernels.second_order import angle_from_edge, edge_slope
from homolog.geodesics.mesh.intrinsic import triangulate
from homolog.surfaces.mesh import TriangleMesh


@wp.kernel
def evaluate(
    directions: wp.array(dtype=wp.float32),
    arrivals: wp.array(dtype=wp.float32),
    cone_angle: float,
    slopes: wp.array(dtype=wp.float32),
    angles: wp.array(dtype=wp.float32),
):
    k = wp.tid()
    slopes[k] = edge_slope(directions[k], arrivals[k], cone_angle)
    angles[k] = angle_from_edge(wp.abs(wp.sin(arrivals[k])), wp.cos(arrivals[k]))


@pytest.mark.parametrize("cone_angle", [5.0, 2 * np.pi, 8.0])
def test_a_slope_is_the_cosine_of_the_angle_on_the_nearer_side(cone_angle):
    directions, arrivals = np.random.default_rng(0).uniform(0, cone_angle, (2, 500)).astype(np.float32)
    slopes, angles = np.empty((2, 500), np.float32)
    wp.launch(evaluate, 500, inputs=[directions, arrivals, cone_angle, slopes, angles], device="cpu")
    apart = np.abs(directions - arrivals)
    nearer = np.minimum(np.minimum(apart, cone_angle - apart), np.pi)
    assert np.allclose(slopes, np.cos(nearer), atol=1e-5)
    assert np.allclose(angles, np.arccos(np.cos(arrivals)), atol=1e-3)


def test_directions_at_a_vertex_go_round_it_once(slotted):
    delaunay = triangulate([slotted])
    for v in (0, 7, 100):
        sides = np.flatnonzero(delaunay.tail == v)
        in_order = sides[np.argsort(delaunay.rank[sides])]
        assert delaunay.rank[in_order].tolist() == list(range(len(sides)))
        assert delaunay.angle[in_order[0]] == 0
        assert (np.diff(delaunay.angle[in_order]) > 0).all()
        assert delaunay.angle[in_order[-1]] < delaunay.angle_sum[v]


def test_second_order_is_several_times_as_exact_as_first(slotted):
    second = measure_accuracy(slotted, solve_table(slotted, 6.5), 24)
    first = measure_accuracy(slotted, solve_table(slotted, 6.5, element="circular"), 24)
    assert second.mean < first.mean / 2
    assert second.p99 < first.p99 / 2


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
    table = solve_table(globe, 20.0).to_csr()
    for source in range(6 * 80, 7 * 80, 4):
        across = 30 * np.arccos(np.clip(globe.vertices @ globe.vertices[source] / 900, -1, 1))
        for row, reach in ((distances_from(globe, [source]), 40), (table[[source]].toarray()[0], 19)):
            near = (across > 4) & (across < reach)
            assert near[pole]
            assert row[near] == pytest.approx(across[near], rel=3e-3)


def test_a_field_is_corrected_as_a_table_is(slotted):
    table = solve_table(slotted, 6.5).to_csr()
    field = distances_from(slotted, [42])
    row = table[[42]].toarray()[0]
    near = row > 0
    assert np.abs(field[near] - row[near]).mean() < 1e-3 * 1.5  # the table is the mean of both directions
