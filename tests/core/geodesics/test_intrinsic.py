"""Intrinsic Delaunay triangulations keep the surface and improve its triangles."""

import numpy as np
import pytest

from homolog.geodesics.mesh.intrinsic import triangulate
from homolog.surfaces.mesh import TriangleMesh


def heron(length):
    a, b, c = np.sort(length.reshape(-1, 3), axis=1).T[::-1]
    return 0.25 * np.sqrt((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)))


def facing_angles(length):
    """Angle that faces each side."""
    a = length.reshape(-1, 3)
    b, c = np.roll(a, -1, axis=1), np.roll(a, -2, axis=1)
    return np.arccos(np.clip((b * b + c * c - a * a) / (2 * b * c), -1, 1)).ravel()


@pytest.fixture
def slivers(sphere):
    """Return a sphere squeezed and jittered until half of its triangles are obtuse."""
    mesh = sphere(600)
    points = mesh.vertices + np.random.default_rng(3).normal(scale=0.9, size=mesh.vertices.shape)
    points *= 30 / np.linalg.norm(points, axis=1, keepdims=True)
    return TriangleMesh(points * [1.0, 0.5, 0.3], mesh.faces)


def test_flips_keep_the_area_and_the_angle_around_every_vertex(slivers):
    flipped = triangulate([slivers])
    assert heron(flipped.length).sum() == pytest.approx(slivers.face_areas.sum(), rel=1e-9)
    corners = slivers.vertices[slivers.faces]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cosine = (ahead * behind).sum(axis=2) / np.linalg.norm(ahead, axis=2) / np.linalg.norm(behind, axis=2)
    turn = np.bincount(slivers.faces.ravel(), np.arccos(cosine).ravel())
    at_tails = np.roll(facing_angles(flipped.length).reshape(-1, 3), -1, axis=1)
    assert np.allclose(np.bincount(flipped.sides.tail, at_tails.ravel()), turn, atol=1e-6)


def test_the_angles_that_face_an_edge_sum_to_at_most_180_degrees(slivers):
    flipped = triangulate([slivers])
    facing = facing_angles(flipped.length)
    assert (facing + facing[flipped.sides.twin]).max() <= np.pi + 1e-6
    before = facing_angles(
        np.linalg.norm(np.diff(slivers.vertices[slivers.faces[:, [0, 1, 2, 0]]], axis=1), axis=2)
    )
    assert (before > 0.6 * np.pi).sum() > 2 * (facing > 0.6 * np.pi).sum()


def test_sides_stay_paired_with_their_edge(slivers, sphere):
    both = triangulate([slivers, sphere(300)])
    side = np.arange(len(both.sides.tail))
    head = both.sides.tail[3 * (side // 3) + (side + 1) % 3]
    assert (both.sides.twin[both.sides.twin] == side).all()
    assert (both.sides.twin != side).all()
    assert (both.sides.tail[both.sides.twin] == head).all()
    assert np.allclose(both.length[both.sides.twin], both.length, rtol=1e-12)


def test_a_regular_sphere_is_left_as_it_is(sphere):
    mesh = sphere(642)
    assert np.array_equal(triangulate([mesh]).sides.tail, mesh.faces.ravel())


def test_flipped_edges_of_a_flat_plate_are_straight_lines(plate):
    flat = np.array(plate.vertices)
    inner = (np.abs(flat[:, :2] - 10) < 9.5).all(axis=1)
    flat[inner, :2] += np.random.default_rng(1).uniform(-0.22, 0.22, size=(inner.sum(), 2))
    delaunay = triangulate([TriangleMesh(flat, plate.faces)])
    tail = delaunay.sides.tail
    side = np.arange(len(tail))
    head = tail[3 * (side // 3) + (side + 1) % 3]
    # within the top side, and away from its rim, over which a straight line may pass
    within = (flat[tail, 2] == 0.5) & (flat[head, 2] == 0.5) & inner[tail] & inner[head]
    new = np.isin(tail * 1000 + head, np.r_[plate.faces[:, 0] * 1000 + plate.faces[:, 1]], invert=True)
    assert (within & new).sum() > 50
    straight = np.linalg.norm(flat[tail] - flat[head], axis=1)
    assert np.allclose(delaunay.length[within], straight[within])


def test_ranks_number_the_sides_around_a_vertex_counterclockwise(slotted):
    delaunay = triangulate([slotted])
    for v in (0, 7, 100):
        sides = np.flatnonzero(delaunay.sides.tail == v)
        in_order = sides[np.argsort(delaunay.rank[sides])]
        assert delaunay.rank[in_order].tolist() == list(range(len(sides)))
        before = in_order - in_order % 3 + (in_order + 2) % 3  # the side of the same face that ends at v
        assert delaunay.sides.twin[before].tolist() == np.roll(in_order, -1).tolist()
