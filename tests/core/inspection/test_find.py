"""Planted faults are found where they were planted; good correspondence has none."""

import numpy as np
import pytest

from homolog.errors import Cancelled, InputError
from homolog.inspection import Kind
from homolog.surfaces.mesh import TriangleMesh


def exchanged(local, subject, pair):
    changed = local.copy()
    changed[subject, pair] = local[subject, pair[::-1]]
    return changed


def test_true_correspondence_has_no_suspects(good):
    assert good.suspects == ()


@pytest.mark.parametrize(("subject", "pair"), [(0, [3, 120]), (2, [40, 41]), (4, [77, 10]), (5, [158, 60])])
def test_two_exchanged_particles_head_the_list(known, good, subject, pair):
    first = known.again(good, exchanged(known.local, subject, pair), subject).suspects[0]
    assert first.kind is Kind.EXCHANGED
    assert first.subject == subject
    assert set(first.particles) == set(pair)
    assert first.severity > 2.0
    assert "are exchanged" in first.description


def test_exchanged_neighbours_are_told_from_others(known, good):
    neighbours = good.consensus.neighbours
    for particle in (5, 90, 150):
        pair = [particle, int(neighbours[particle, 0])]
        first = known.again(good, exchanged(known.local, 1, pair), 1).suspects[0]
        assert (first.kind, first.subject, set(first.particles)) == (Kind.EXCHANGED, 1, set(pair))


def test_two_exchanges_on_two_subjects_are_two_suspects(known):
    local = exchanged(exchanged(known.local, 0, [3, 120]), 3, [50, 99])
    result = known.inspect(local).suspects[:2]
    assert {(item.subject, *sorted(item.particles)) for item in result} == {(0, 3, 120), (3, 50, 99)}


def test_a_particle_that_went_astray_is_found_by_its_neighbours(known, good):
    local = known.local.copy()
    away = np.linalg.norm(known.meshes[2].vertices - local[2, 60], axis=1)
    local[2, 60] = known.meshes[2].vertices[np.abs(away - 3.0 * known.spacing[2]).argmin()]
    result = [suspect for suspect in known.again(good, local, 2).suspects if suspect.kind is Kind.NEIGHBOURS]
    assert [(item.subject, item.particles[0]) for item in result] == [(2, 60)]


def test_a_particle_on_the_other_wall_has_the_wrong_normal(thin):
    local = thin.local.copy()
    top = int(thin.directions[:, 2].argmax())
    opposite = thin.directions[top] * [1, 1, -1]
    world = opposite * [20 + 0.9, 18 - 0.6, 1.15]
    matrix = np.linalg.inv(thin.alignments[3])
    local[3, top] = matrix[:3, :3] @ world + matrix[:3, 3]
    result = [suspect for suspect in thin.inspect(local).suspects if suspect.kind is Kind.NORMALS]
    assert [(item.subject, item.particles[0]) for item in result] == [(3, top)]
    assert "normal 1" in result[0].description  # 150° or more from the mean


def test_a_particle_beyond_its_neighbour_folds_triangles(known, good):
    local = known.local.copy()
    beyond = int(good.consensus.neighbours[33, 0])
    goal = local[1, beyond] + 0.6 * (local[1, beyond] - local[1, 33])
    nearest = np.linalg.norm(known.meshes[1].vertices - goal, axis=1).argmin()
    local[1, 33] = known.meshes[1].vertices[nearest]
    folded = [suspect for suspect in known.again(good, local, 1).suspects if suspect.kind is Kind.FOLDED]
    assert folded
    assert {item.subject for item in folded} == {1}
    assert 33 in folded[0].particles
    assert folded[0].area > 0.0


def test_a_region_without_particles_is_found_with_its_area(known, good):
    local, m = known.local.copy(), 0
    pole = np.array([1.0, 0.0, 0.0])
    inside = np.flatnonzero(known.directions @ pole > np.cos(0.6))
    rim = known.directions[inside] - np.outer(known.directions[inside] @ pole, pole)
    rim /= np.maximum(np.linalg.norm(rim, axis=1, keepdims=True), 1e-9)
    moved = np.cos(0.62) * pole + np.sin(0.62) * rim
    matrix = np.linalg.inv(known.alignments[m])
    local[m, inside] = moved * [20, 16, 12] @ matrix[:3, :3].T + matrix[:3, 3]
    result = [suspect for suspect in known.again(good, local, m).suspects if suspect.kind is Kind.UNCOVERED]
    assert [item.subject for item in result] == [m]
    np.testing.assert_allclose(result[0].place, [20, 0, 0], atol=2.0)
    mesh = known.meshes[m]
    world = (mesh.vertices - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T / [20, 16, 12]
    cap = (world[mesh.faces].mean(axis=1) @ pole) > np.cos(0.6)
    empty = mesh.face_areas[cap].sum()
    assert 0.15 * empty < result[0].area < empty  # of which a ring of one spacing counts as covered


def test_severity_knows_no_millimetres(known):
    local = exchanged(known.local, 2, [8, 100])
    small = known.inspect(local).suspects
    large = type(known)(
        100.0 * local,
        [TriangleMesh(100.0 * mesh.vertices, mesh.faces) for mesh in known.meshes],
        known.alignments @ np.diag([0.01, 0.01, 0.01, 1.0]),
        known.directions,
    ).inspect()
    np.testing.assert_allclose(
        [suspect.severity for suspect in large.suspects], [item.severity for item in small], rtol=0.02
    )


def test_the_order_of_subjects_does_not_matter(known):
    local = exchanged(known.local, 2, [8, 100])
    order = [3, 2, 5, 0, 1, 4]
    turned = type(known)(
        local[order], [known.meshes[m] for m in order], known.alignments[order], known.directions
    )
    first, second = known.inspect(local).suspects[0], turned.inspect().suspects[0]
    assert order[second.subject] == first.subject
    assert second.severity == pytest.approx(first.severity, rel=1e-6)


def test_looking_at_one_subject_again_gives_what_looking_at_all_gives(known, good):
    local = exchanged(known.local, 4, [8, 100])
    again = known.again(good, local, 4)
    anew = known.inspect(local)
    assert [s.description for s in again.suspects] == [s.description for s in anew.suspects]
    np.testing.assert_array_equal(again.located.normals, anew.located.normals)


def test_a_suspect_names_who_may_move(known, good):
    result = known.again(good, exchanged(known.local, 4, [8, 100]), 4)
    near, wide = (result.movable(result.suspects[0], rings) for rings in (0, 2))
    assert np.argwhere(near).tolist() == [[4, 8], [4, 100]]
    assert 20 < wide[4].sum() < 60
    assert wide.sum() == wide[4].sum()


def test_fewer_than_three_subjects_are_refused(known):
    pair = type(known)(known.local[:2], known.meshes[:2], known.alignments[:2], known.directions)
    with pytest.raises(InputError, match="three or more subjects"):
        pair.inspect()


def test_particles_of_another_surface_are_refused_by_name(known):
    local = known.local.copy()
    local[3] += 40.0
    with pytest.raises(InputError, match="subject_3: 160 particles"):
        known.inspect(local)


def test_subjects_that_agree_on_nothing_are_refused(known):
    random = np.random.default_rng(0)
    local = np.stack([item[random.permutation(len(item))] for item in known.local])
    with pytest.raises(InputError, match="hardly agree"):
        known.inspect(local)


def test_the_search_can_be_cancelled(known):
    ticks = []

    def tick(fraction, message):
        ticks.append(fraction)
        if fraction > 0.3:
            raise Cancelled("cancelled")

    with pytest.raises(Cancelled):
        known.inspect(tick=tick)
    assert ticks == sorted(ticks)
