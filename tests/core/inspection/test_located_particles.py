"""Distances on a coarse mesh agree with those on the subjects' own."""

from multiprocessing import active_children

import numpy as np
import pytest

from homolog.errors import Cancelled, InputError
from homolog.geodesics import distances_from
from homolog.inspection import locate_particles, located_particles
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


def use_processes(monkeypatch):
    """Let two subjects be enough for a process, and none be located in this one."""

    def fails(*_):
        raise AssertionError("located in this process")

    monkeypatch.setattr(located_particles, "_LEAST", 2)
    monkeypatch.setattr(located_particles, "_CHUNK", 2)
    monkeypatch.setattr(located_particles, "_locate", fails)


def numbers_of(inspection):
    """Return all that is found of each subject, and the suspects."""
    located = inspection.located
    found = [located.normals, located.faces, *located.coarse_reaches, *located.reaches]
    found += [distance.toarray() for distance in located.distances]
    return found, [(item.kind, item.severity, item.place.tolist()) for item in inspection.suspects]


def test_several_processes_find_the_same_as_one(known, monkeypatch):
    local = known.local.copy()
    local[0] = bare(known, 0)
    local[4, [8, 100]] = local[4, [100, 8]]
    found, suspects = numbers_of(known.inspect(local))
    use_processes(monkeypatch)
    found_together, suspects_together = numbers_of(known.inspect(local, workers=3))
    assert len(suspects) >= 2
    assert suspects_together == suspects
    assert all(map(np.array_equal, found_together, found))


def test_few_subjects_are_located_in_this_process(known, good, monkeypatch):
    monkeypatch.setattr(located_particles, "SubjectWorkers", None)
    assert np.array_equal(known.inspect(workers=16).located.normals, good.located.normals)


def test_processes_refuse_particles_of_another_surface_by_name(known, monkeypatch):
    local = known.local.copy()
    local[3] += 40.0
    use_processes(monkeypatch)
    with pytest.raises(InputError, match="subject_3: 160 particles"):
        known.inspect(local, workers=3)


def test_processes_end_when_the_search_is_cancelled(known, monkeypatch):
    before = set(active_children())

    def tick(fraction, message):
        if set(active_children()) - before:
            raise Cancelled("cancelled")

    use_processes(monkeypatch)
    with pytest.raises(Cancelled):
        known.inspect(workers=2, tick=tick)
    assert set(active_children()) == before
