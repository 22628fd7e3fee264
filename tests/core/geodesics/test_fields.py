import numpy as np
import pytest

from homolog.geodesics import distances_from


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
