"""Distances on a coarse mesh agree with those on the subjects' own."""

import numpy as np
import pytest

from homolog.geodesics import distances_from
from homolog.inspection import locate_particles
from homolog.inspection.located_particles import FAR, REACH


def start_of(located, m):
    """Return the corners of the particles' faces, and their distances from the particles."""
    mesh = located.meshes[m]
    corners = mesh.faces[located.faces[m]]
    return corners, np.linalg.norm(mesh.vertices[corners] - located.local[m][:, None], axis=2)


def bare(known, m):
    """Return the particles of a subject after all on one side were moved to the rim of a cap."""
    pole, matrix = np.array([1.0, 0.0, 0.0]), np.linalg.inv(known.alignments[m])
    inside = np.flatnonzero(known.directions @ pole > np.cos(0.6))
    rim = known.directions[inside] - np.outer(known.directions[inside] @ pole, pole)
    rim /= np.maximum(np.linalg.norm(rim, axis=1, keepdims=True), 1e-9)
    points = known.local[m].copy()
    axes = np.linalg.norm((known.meshes[m].vertices - matrix[:3, 3]) @ known.alignments[m, :3, :3].T, axis=1)
    moved = (np.cos(0.62) * pole + np.sin(0.62) * rim) * axes.max()
    goals = moved @ matrix[:3, :3].T + matrix[:3, 3]
    vertices = known.meshes[m].vertices
    points[inside] = vertices[np.linalg.norm(vertices[None] - goals[:, None], axis=2).argmin(axis=1)]
    return points


def test_distances_between_particles_agree_with_those_on_the_whole_mesh(known, good):
    located, m = good.located, 2
    corners, start = start_of(located, m)
    for particle in (3, 77, 140):
        away = distances_from(located.meshes[m], corners[particle].tolist(), start[particle].tolist())
        exact = (away[corners] + start).min(axis=1) / located.spacing[m]
        stored = located.distances[m][[particle]].tocoo()
        near = np.flatnonzero(exact < 0.97 * REACH)
        assert set(near) <= {particle, *stored.coords[1]}
        np.testing.assert_allclose(stored.data, exact[stored.coords[1]], rtol=0.06, atol=0.06)


def test_a_covered_surface_is_measured_on_the_coarse_mesh_only(known, good):
    located = good.located
    assert {len(reach) for reach in located.reaches} == {0}
    for m, coarse in enumerate(located.coarse_reaches):
        corners, start = start_of(located, m)
        exact = distances_from(located.meshes[m], corners.ravel().tolist(), start.ravel().tolist())
        assert coarse.max() == pytest.approx(exact.max(), abs=0.1 * located.spacing[m])
        assert np.median(coarse) == pytest.approx(np.median(exact), rel=0.05)
        assert exact.max() < FAR * located.spacing[m]


def test_a_surface_that_may_have_a_gap_is_measured_at_all_its_vertices(known):
    located = locate_particles(bare(known, 0)[None], known.meshes[:1], known.alignments[:1], names=["bare"])
    corners, start = start_of(located, 0)
    exact = distances_from(located.meshes[0], corners.ravel().tolist(), start.ravel().tolist())
    np.testing.assert_array_equal(located.reaches[0], exact)
    assert exact.max() > FAR * located.spacing[0]
