import numpy as np
import pytest

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.grooming import groom_cohort
from homolog.grooming.cache import load_groomed, save_groomed
from homolog.grooming.subject import check_source, groom
from homolog.settings import GroomSettings, Openings, Pieces
from homolog.surfaces.closest import distances_to
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, rim_sides

SETTINGS = GroomSettings()


def tube(rings=40, sides=60, hole=None):
    """A tube of radius 10 and height 40 on a floor, open above; `hole`: half the width of another opening."""
    turns = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    heights = np.linspace(0.0, 40.0, rings)
    places = np.stack(
        np.broadcast_arrays(10.0 * np.cos(turns), 10.0 * np.sin(turns), heights[:, None]), axis=-1
    )
    first = np.arange(sides * (rings - 1)).reshape(-1, sides)
    second, above = np.roll(first, -1, axis=1), first + sides
    wall = [np.stack([first, second, above], -1), np.stack([second, np.roll(above, -1, axis=1), above], -1)]
    floor = np.column_stack([np.full(sides, sides * rings), second[0], first[0]])
    faces = np.concatenate([*(item.reshape(-1, 3) for item in wall), floor])
    mesh = TriangleMesh(np.concatenate([places.reshape(-1, 3), np.zeros((1, 3))]), faces)
    if hole is None:
        return mesh
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    return TriangleMesh(mesh.vertices, mesh.faces[np.linalg.norm(middles - [10.0, 0.0, 20.0], axis=1) > hole])


def rims(mesh):
    return mesh.vertices[np.unique(rim_sides(mesh.faces)[0])]


def test_a_cut_end_stays_open_and_the_surface_is_that_of_the_file():
    given = tube()
    groomed = groom("femur", given, SETTINGS)
    assert groomed.field is None
    assert groomed.report.rims == 1
    assert any("stays so: openings 20 mm wide" in note for note in groomed.report.notes)
    for mesh in (groomed.mesh, groomed.coarse_mesh):
        check_mesh(mesh, "femur", may_open=True)
        np.testing.assert_allclose(rims(mesh)[:, 2], 40.0, atol=1e-6)
        assert distances_to(given, mesh.vertices[mesh.faces].mean(axis=1)).max() < 0.2
    assert len(groomed.coarse_mesh.vertices) < len(groomed.mesh.vertices)


def test_a_hole_smaller_than_a_particles_part_of_the_surface_is_closed_beside_a_cut_end():
    groomed = groom("femur", tube(hole=0.8), SETTINGS)
    assert groomed.report.holes_filled == 1
    assert groomed.report.rims == 1
    assert rims(groomed.mesh)[:, 2].min() > 39.9
    assert groom("femur", tube(hole=5.0), SETTINGS).report.rims == 2
    assert (
        groom("femur", tube(hole=0.8), SETTINGS.model_copy(update={"openings": Openings.OPEN})).report.rims
        == 2
    )


def test_a_mesh_with_small_holes_only_is_closed_as_it_is_if_that_is_chosen(tmp_path):
    given = tube()
    rim = np.flatnonzero(given.vertices[:, 2] > 39.9)
    lid = np.column_stack([np.full(len(rim), len(given.vertices)), rim, np.roll(rim, -1)])
    whole = TriangleMesh(
        np.concatenate([given.vertices, [[0.0, 0.0, 40.0]]]), np.concatenate([given.faces, lid])
    )
    pierced = TriangleMesh(whole.vertices, whole.faces[1:])
    groomed = groom("femur", pierced, SETTINGS)
    assert groomed.field is not None
    check_mesh(groomed.mesh, "femur")
    closed = groom("femur", given, SETTINGS.model_copy(update={"openings": Openings.CLOSE}))
    assert closed.report.rims == 0
    check_mesh(closed.mesh, "femur")


def test_a_solid_that_was_cut_is_turned_outward_and_a_sheet_is_left_as_it_is():
    inside_out = TriangleMesh(tube().vertices, tube().faces[:, ::-1])
    groomed = groom("femur", inside_out, SETTINGS).mesh
    outward = np.einsum("nd,nd->n", groomed.vertex_normals[:, :2], groomed.vertices[:, :2])
    assert np.median(outward) > 0.0
    flat = TriangleMesh(inside_out.vertices[:, [0, 1, 2]] * [1.0, 1.0, 0.0], inside_out.faces)
    below = np.flatnonzero((flat.faces == len(flat.vertices) - 1).any(axis=1))
    used, faces = np.unique(flat.faces[below], return_inverse=True)
    disc = TriangleMesh(flat.vertices[used], faces.reshape(-1, 3))
    check_source(disc, SETTINGS, "disc")
    np.testing.assert_allclose(groom("disc", disc, SETTINGS).mesh.vertex_normals[:, 2], 1.0)


def test_a_rim_that_touches_itself_stays_open():
    given = tube()
    at_rim = given.vertices[given.faces][:, :, 2]
    touching = np.flatnonzero((at_rim > 39.9).sum(axis=1) == 1)[7]  # it shares a corner with the rim
    groomed = groom("femur", TriangleMesh(given.vertices, np.delete(given.faces, touching, axis=0)), SETTINGS)
    check_mesh(groomed.mesh, "femur", may_open=True)
    assert groomed.report.rims == 1


def curled(length):
    """A flat sheet, of which a narrower half is rolled up, and down through it if it is long enough."""
    along, across = np.meshgrid(np.linspace(-10.0, length, 61), np.linspace(-1.0, 1.0, 41), indexing="ij")
    angle = np.clip(along / 2.0, 0.0, 1.5 * np.pi)
    down = np.maximum(along - 3.0 * np.pi, 0.0)
    x, z = 2.0 * np.sin(angle) + np.minimum(along, 0.0), 2.0 * (1.0 - np.cos(angle)) - down
    points = np.stack([x, across * np.where(along < 0.0, 10.0, 10.0 - 2.5 * angle / np.pi), z], axis=-1)
    first = np.arange(61 * 41).reshape(61, 41)[:-1, :-1]
    halves = [np.stack([first, first + 41, first + 1], -1), np.stack([first + 41, first + 42, first + 1], -1)]
    return TriangleMesh(points.reshape(-1, 3), np.concatenate([half.reshape(-1, 3) for half in halves]))


def test_a_rim_that_passes_through_its_own_surface_is_noted():
    for length, crosses in ((11.0, False), (14.0, True)):
        notes = groom("sheet", curled(length), SETTINGS).report.notes
        assert any("rim passes through its own surface" in note for note in notes) is crosses


def test_sheets_in_pieces_are_kept_if_all_are_chosen_and_else_refused_with_that_remedy():
    given = tube()
    far = np.concatenate([given.vertices, given.vertices + np.array([50.0, 0.0, 0.0])])
    two = TriangleMesh(far, np.concatenate([given.faces, given.faces + len(given.vertices)]))
    with pytest.raises(InputError, match=r"2 separate pieces.*keep all \(pieces: all\)"):
        check_source(two, SETTINGS, "knee")
    groomed = groom("knee", two, SETTINGS.model_copy(update={"pieces": Pieces.ALL}))
    assert groomed.report.rims == 2
    assert groomed.report.genus == 0


def test_a_mesh_that_is_no_manifold_is_refused_if_it_is_to_stay_open():
    given = tube()
    fin = TriangleMesh(given.vertices, np.concatenate([given.faces, [[0, 1, 1000]]]))
    with pytest.raises(InputError, match="femur: the mesh can't stay open: it is not manifold"):
        groom("femur", fin, SETTINGS.model_copy(update={"openings": Openings.OPEN}))
    assert groom("femur", fin, SETTINGS).field is not None


def test_an_open_subject_is_stored_and_read(tmp_path):
    groomed = groom("femur", tube(), SETTINGS)
    save_groomed(tmp_path, groomed, "key")
    stored = load_groomed(tmp_path, "femur", "key")
    assert stored.field is None
    assert stored.report == groomed.report
    np.testing.assert_array_equal(stored.mesh.faces, groomed.mesh.faces)


def test_a_subject_that_is_closed_where_most_stay_open_gets_a_note(tmp_path):
    fin = TriangleMesh(tube().vertices, np.concatenate([tube().faces, [[0, 1, 1000]]]))
    sources = {"a": tube(), "b": fin, "c": tube(38), "d": tube(36)}
    cohort = Cohort(tuple(Subject(name, tmp_path / name) for name in sources), tmp_path)
    groomed = groom_cohort(cohort, SETTINGS, sources=sources)
    noted = [
        item.name
        for item in groomed
        if any("of most subjects stay open" in note for note in item.report.notes)
    ]
    assert noted == ["b"]
