"""Meshes as people have them: each is the same ellipsoid, damaged in another way."""

import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
from skimage import measure

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.grooming import groom_cohort, groom_subject
from homolog.grooming.levels import level_of_mesh
from homolog.grooming.subject import read_source
from homolog.grooming.triangles import level_of_triangles
from homolog.io.meshes import write_mesh
from homolog.settings import GroomSettings, Openings, Pieces
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.solid import solid_of
from homolog.surfaces.topology import check_mesh, mesh_fault

SETTINGS = GroomSettings(mesh_edge=2.5, spacing=0.8, openings=Openings.CLOSE)
VOLUME = 4.0 / 3.0 * np.pi * 20.0 * 14.0 * 10.0


def joined(*meshes):
    counts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + count for mesh, count in zip(meshes, counts, strict=False)]
    return TriangleMesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def moved(mesh, by, scale=1.0):
    return TriangleMesh(scale * mesh.vertices + by, mesh.faces)


def turned(mesh, share, rng):
    chosen = rng.random(len(mesh.faces)) < share
    return TriangleMesh(mesh.vertices, np.where(chosen[:, None], mesh.faces[:, ::-1], mesh.faces))


def soup(mesh, noise=0.0, rng=None):
    points = mesh.vertices[mesh.faces].reshape(-1, 3)
    points = points + noise * rng.normal(size=points.shape) if noise else points
    return TriangleMesh(points, np.arange(len(points)).reshape(-1, 3))


def with_corners_that_are_no_numbers(mesh, rng):
    vertices = mesh.vertices.copy()
    vertices[rng.choice(len(vertices))] = np.nan
    return TriangleMesh(np.concatenate([vertices, np.full((3, 3), np.inf)]), mesh.faces)


def without_a_ball(mesh, rng):
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    return TriangleMesh(mesh.vertices, mesh.faces[np.linalg.norm(middles - [0, 0, 10.0], axis=1) > 5.0])


def split_at_sides(mesh, rng):
    chosen = rng.random(len(mesh.faces)) < 0.1
    a, b, c = mesh.faces[chosen].T
    new = len(mesh.vertices) + np.arange(len(a))
    middles = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
    halves = [np.stack([a, new, c], axis=1), np.stack([new, b, c], axis=1)]
    return TriangleMesh(
        np.concatenate([mesh.vertices, middles]), np.concatenate([mesh.faces[~chosen], *halves])
    )


def with_slivers(mesh, rng):
    vertices = mesh.vertices.copy()
    a, b, c = mesh.faces[rng.choice(len(mesh.faces), 30, replace=False)].T
    vertices[a] = 0.5 * (vertices[b] + vertices[c])
    return TriangleMesh(vertices, mesh.faces)


def with_fins(mesh, rng, depth):
    a, b, c = mesh.faces[rng.choice(len(mesh.faces), 60, replace=False)].T
    tips = mesh.vertices[np.stack([a, b, c])].mean(axis=0) * depth
    new = len(mesh.vertices) + np.arange(len(a))
    fins = np.stack([a, b, new], axis=1)
    return TriangleMesh(np.concatenate([mesh.vertices, tips]), np.concatenate([mesh.faces, fins]))


def with_septum(mesh, rng):
    left = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 1.0
    sides = [np.sort(mesh.faces[chosen][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)) for chosen in (left, ~left)]
    border = np.array(sorted(set(map(tuple, sides[0])) & set(map(tuple, sides[1]))))
    centre = len(mesh.vertices)
    wall = np.column_stack([border, np.full(len(border), centre)])
    return TriangleMesh(
        np.concatenate([mesh.vertices, [[1.0, 0.0, 0.0]]]), np.concatenate([mesh.faces, wall])
    )


DAMAGED = {
    "a tenth of the faces turned": lambda mesh, rng: turned(mesh, 0.1, rng),
    "half of the faces turned": lambda mesh, rng: turned(mesh, 0.5, rng),
    "triangles without shared vertices": lambda mesh, rng: soup(mesh),
    "triangles with gaps, some turned": lambda mesh, rng: turned(soup(mesh, 0.01, rng), 0.3, rng),
    "faces listed twice": lambda mesh, rng: TriangleMesh(
        mesh.vertices, np.concatenate([mesh.faces, mesh.faces[::7], mesh.faces[::9, ::-1]])
    ),
    "unused vertices": lambda mesh, rng: TriangleMesh(
        np.concatenate([mesh.vertices, 900.0 * np.eye(3)]), mesh.faces
    ),
    "faces missing here and there": lambda mesh, rng: TriangleMesh(
        mesh.vertices, mesh.faces[rng.random(len(mesh.faces)) > 0.05]
    ),
    "a corner that is no number": with_corners_that_are_no_numbers,
    "a large hole": without_a_ball,
    "vertices in the middle of sides": split_at_sides,
    "slivers": with_slivers,
    "edges with three faces, within": lambda mesh, rng: with_fins(mesh, rng, 0.8),
    "edges with three faces, outside": lambda mesh, rng: with_fins(mesh, rng, 1.05),
    "an inner wall across": with_septum,
    "a second wall within, as skulls have": lambda mesh, rng: joined(
        mesh, TriangleMesh(0.9 * mesh.vertices, mesh.faces[:, ::-1])
    ),
    "a second wall within, turned": lambda mesh, rng: joined(mesh, moved(mesh, 0.0, 0.9)),
    "the same piece twice, a little apart": lambda mesh, rng: joined(mesh, moved(mesh, [0.02, 0.01, 0.0])),
    "a small piece far away": lambda mesh, rng: joined(moved(mesh, [90.0, 0, 0], 0.3), mesh),
}


def level_and_settings(mesh, **settings):
    return level_of_triangles(mesh, GroomSettings(**settings))


def distance_from_egg(points):
    """First-order distance from the ellipsoid [mm]."""
    axes = np.array([20.0, 14.0, 10.0])
    value = np.linalg.norm(points / axes, axis=1)
    return np.abs(value - 1.0) * value / np.linalg.norm(points / axes**2, axis=1)


@pytest.mark.parametrize("damage", DAMAGED.values(), ids=DAMAGED.keys())
def test_a_damaged_mesh_gives_the_surface_of_the_sound_one(egg, tmp_path, damage):
    path = tmp_path / "a.ply"
    write_mesh(path, damage(egg, np.random.default_rng(3)))
    result = groom_subject(Subject("a", path), SETTINGS)
    check_mesh(result.mesh, "fine")
    assert result.report.genus == 0
    assert result.mesh.volume == pytest.approx(VOLUME, rel=0.02)
    off = distance_from_egg(result.mesh.vertices)
    assert off.mean() < 0.12
    assert off.max() < 1.6


def test_a_sound_mesh_is_taken_as_it_is(egg):
    expected = level_of_mesh(egg, None)
    result = level_and_settings(egg)
    assert np.array_equal(result.level.values, expected.values)
    assert result.notes == ()
    assert result.surface is None


def test_a_sound_mesh_that_points_inward_is_turned_and_noted(egg):
    result = level_and_settings(TriangleMesh(egg.vertices, egg.faces[:, ::-1]))
    assert np.array_equal(result.level.values, level_of_mesh(egg, None).values)
    assert any("inward" in note for note in result.notes)


def test_corners_rounded_face_by_face_meet_again(egg):
    result = level_and_settings(soup(egg, 5e-4, np.random.default_rng(0)))
    assert any("coincident vertices" in note for note in result.notes)
    assert not any("openings" in note or "pieces" in note for note in result.notes)


def test_a_shaft_cut_off_is_closed_flat_at_its_rim_and_noted(egg, tmp_path):
    lower = egg.vertices[egg.faces][..., 0].max(axis=1) < 8.0
    faces = egg.faces[lower]
    rim = egg.vertices[:, 0] > 6.0
    vertices = np.where(rim[:, None] & (np.arange(3) == 0), 7.0, egg.vertices)
    path = tmp_path / "shaft.stl"
    write_mesh(path, TriangleMesh(vertices, faces))
    result = groom_subject(Subject("shaft", path), SETTINGS)
    note = next(item for item in result.report.notes if "rims" in item)
    assert "closed flat" in note
    end = result.mesh.vertices[:, 0] > 6.0
    assert end.sum() > 20
    assert result.mesh.vertices[:, 0].max() < 7.5
    inner = end & (np.linalg.norm(result.mesh.vertices[:, 1:] / [13.1, 9.4], axis=1) < 0.7)
    assert np.abs(result.mesh.vertices[inner, 0] - 7.0).max() < 0.3


@pytest.mark.parametrize("wave", [0.0, 3.0])
def test_a_note_says_how_much_of_a_sheet_that_was_closed_is_in_no_file(egg, tmp_path, wave):
    half = egg.faces[(egg.vertices[egg.faces][..., 2] > -0.2).all(axis=1)]
    used, faces = np.unique(half, return_inverse=True)
    vertices = egg.vertices[used].copy()  # a wavy rim is not closed flat
    vertices[:, 2] += wave * np.cos(3.0 * np.arctan2(vertices[:, 1] / 14.0, vertices[:, 0] / 20.0))
    write_mesh(tmp_path / "sheet.ply", TriangleMesh(vertices, faces.reshape(-1, 3)))
    result = groom_subject(Subject("sheet", tmp_path / "sheet.ply"), SETTINGS)
    share = next(note for note in result.report.notes if "no anatomy" in note)
    own = TriangleMesh(vertices, faces.reshape(-1, 3)).area
    assert float(share.split(" %")[0]) == pytest.approx(100.0 * (1.0 - own / result.mesh.area), abs=1.0)
    assert any("rims" in note for note in result.report.notes)
    largest = max(
        float(number) for number in re.findall(r"([\d.]+) mm at most", " ".join(result.report.notes))
    )
    assert largest < 2.0  # what closes an opening is no error


def shaft(heights, sides=16):
    """A cup on a floor at 0; the last of its rings, at these heights, is its rim."""
    turns = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    levels = np.array([np.broadcast_to(height, sides) for height in heights])
    rings = np.stack(np.broadcast_arrays(10.0 * np.cos(turns), 10.0 * np.sin(turns), levels), axis=-1)
    first = np.arange(sides * (len(heights) - 1)).reshape(-1, sides)
    second, above = np.roll(first, -1, axis=1), first + sides
    wall = [np.stack([first, second, above], -1), np.stack([second, np.roll(above, -1, axis=1), above], -1)]
    floor = np.column_stack([np.full(sides, sides * len(heights)), second[0], first[0]])
    faces = np.concatenate([*(item.reshape(-1, 3) for item in wall), floor]).astype(np.int32)
    return TriangleMesh(np.concatenate([rings.reshape(-1, 3), np.zeros((1, 3))]), faces)


ZIGZAG = 6.0 * (np.arange(16) % 2)
WAVE = 6.0 * np.cos(np.pi / 4.0 * np.arange(16))


@pytest.mark.parametrize(("rim", "openings"), [(ZIGZAG, 1), (WAVE, 0)])
def test_a_rim_that_is_jagged_by_less_than_a_face_is_closed_flat(rim, openings):
    cup = shaft([0.0, 10.0, 20.0 + rim])
    assert len(solid_of(cup).rims) == openings


def test_a_hole_that_shares_a_corner_with_a_rim_is_closed_apart_from_it():
    cup = shaft(np.arange(0.0, 21.0, 2.0), 32)
    at_rim = (cup.faces >= 32 * 10) & (cup.faces < 32 * 11)
    hole = np.flatnonzero(at_rim.sum(axis=1) == 1)[5]
    solid = solid_of(TriangleMesh(cup.vertices, np.delete(cup.faces, hole, axis=0)))
    assert solid.is_closed
    assert len(solid.rims) == 2
    assert solid.rims[0] == pytest.approx(20.0, rel=0.02)


@pytest.mark.parametrize("most", [0.0, 6.0])
def test_subjects_whose_open_ends_are_closed_otherwise_than_most_get_a_note(tmp_path, most):
    ripple = np.cos(2.0 * np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False))
    cups = {
        name: shaft([0.0, 10.0, 20.0, 30.0 + wave * ripple], 32)
        for name, wave in {"a": most, "b": most, "c": 6.0 - most, "d": most}.items()
    }
    cohort = Cohort(tuple(Subject(name, tmp_path / name) for name in cups), tmp_path)
    with ThreadPoolExecutor(1) as executor:
        groomed = groom_cohort(cohort, SETTINGS, executor=executor, sources=cups)
    noted = [item.name for item in groomed if any("those of most" in note for note in item.report.notes)]
    assert noted == ["c"]


def test_a_face_that_hangs_by_a_corner_leaves_a_rim_flat_and_does_not_count():
    cup = shaft(np.arange(0.0, 21.0, 2.0), 32)
    count = len(cup.vertices)
    ear = np.array([[10.0, 0.0, 24.0], [9.0, 2.0, 24.0]])
    faces = np.concatenate([cup.faces, [[32 * 10, count, count + 1]]]).astype(np.int32)
    solid = solid_of(TriangleMesh(np.concatenate([cup.vertices, ear]), faces))
    assert solid.rims == pytest.approx([20.0], rel=0.02)
    assert solid.is_closed
    assert not solid.bounds[-1]


def test_a_face_that_meets_two_others_at_an_edge_leaves_the_solid_closed():
    cup = shaft([0.0, 10.0, 20.0])
    fin = np.array([[17, 32, 8]])  # from a side of the wall across the cup
    solid = solid_of(TriangleMesh(cup.vertices, np.concatenate([cup.faces, fin])))
    assert solid.is_closed
    assert np.count_nonzero(solid.bounds) == np.count_nonzero(solid_of(cup).bounds)


def test_a_rim_that_leaves_its_plane_for_half_its_length_is_not_closed_flat():
    solid = solid_of(shaft([0.0, 10.0, 20.0 + 8.0 * (np.arange(32) < 16)], 32))
    assert len(solid.rims) == 0
    assert solid.openings == pytest.approx([np.hypot(20.0, np.hypot(20.0, 8.0))], rel=0.01)


@pytest.mark.parametrize("is_turned", [True, False])
def test_a_shell_cut_open_is_closed_by_a_ring(egg, tmp_path, is_turned):
    lower = egg.vertices[egg.faces][..., 0].max(axis=1) < 8.0
    rim = egg.vertices[:, 0] > 6.0
    cut = TriangleMesh(
        np.where(rim[:, None] & (np.arange(3) == 0), 7.0, egg.vertices),
        egg.faces[lower][:, ::-1] if is_turned else egg.faces[lower],
    )
    path = tmp_path / "skull.stl"
    write_mesh(path, joined(TriangleMesh(cut.vertices, egg.faces[lower]), moved(cut, [2.1, 0.0, 0.0], 0.7)))
    result = groom_subject(Subject("skull", path), SETTINGS)
    x = 7.0 / 20.0
    of_cup = 0.75 * (x - x**3 / 3.0 + 2.0 / 3.0) * VOLUME
    assert result.mesh.volume == pytest.approx((1.0 - 0.7**3) * of_cup, rel=0.03)
    assert result.report.genus == 0
    assert any("flat at their rims (2" in note for note in result.report.notes)


@pytest.mark.parametrize(("scale", "unit"), [(0.001, "metres"), (1000.0, "micrometres")])
def test_a_shape_of_a_size_that_no_organ_has_is_noted(egg, tmp_path, scale, unit):
    write_mesh(tmp_path / "a.stl", moved(egg, [0.0, 0.0, 0.0], scale))
    notes = groom_subject(Subject("a", tmp_path / "a.stl"), GroomSettings()).report.notes
    assert any(f"is in {unit}," in note for note in notes)


def test_overlapping_pieces_are_united(egg, tmp_path):
    both = joined(egg, moved(egg, [18.0, 0.0, 0.0]))
    path = tmp_path / "both.ply"
    write_mesh(path, both)
    for pieces in ("largest", "all"):
        result = groom_subject(Subject("a", path), GroomSettings(mesh_edge=2.5, spacing=0.8, pieces=pieces))
        size = np.ptp(result.mesh.vertices, axis=0)
        assert size[0] == pytest.approx(58.0, abs=1.0)
        assert VOLUME < result.mesh.volume * 1.02 < 2.0 * VOLUME
        assert any("united (2)" in note for note in result.report.notes)


def test_walls_within_large_meshes_are_told_from_groups_of_faces(egg, monkeypatch):
    pieces = joined(egg, moved(egg, [16.0, 3.0, 1.0], 0.6), moved(egg, [0.0, 0.0, 0.0], 0.5))
    expected = solid_of(pieces)
    monkeypatch.setattr("homolog.surfaces.solid.LARGE", 0)
    assert 0.2 < expected.bounds.mean() < 0.8
    assert np.array_equal(solid_of(pieces).bounds, expected.bounds)


def test_of_many_doubtful_faces_some_are_asked_and_no_bounding_one_is_left_out(egg, monkeypatch):
    pieces = joined(egg, moved(egg, [16.0, 3.0, 1.0], 0.6), moved(egg, [0.0, 0.0, 0.0], 0.5))
    expected = solid_of(pieces).bounds
    monkeypatch.setattr("homolog.surfaces.solid.LARGE", 0)
    monkeypatch.setattr("homolog.surfaces.solid.MOST_TESTED_FACES", 2000)
    monkeypatch.setattr(
        "homolog.surfaces.solid.uneven_faces", lambda mesh, *_: np.ones(len(mesh.faces), bool)
    )
    bounds = solid_of(pieces).bounds
    assert bounds[expected].all()
    assert bounds.mean() < expected.mean() + 0.2


def test_pieces_apart_make_one_surface_only_if_the_largest_is_kept(egg, tmp_path):
    path = tmp_path / "two.ply"
    write_mesh(path, joined(egg, moved(egg, [60.0, 0.0, 0.0], 0.5)))
    report = groom_subject(Subject("a", path), SETTINGS).report
    assert report.components_dropped == 1
    assert any("largest of 2" in note and "80 %" in note for note in report.notes)
    with pytest.raises(InputError, match=r"a: .* 2 pieces"):
        groom_subject(Subject("a", path), GroomSettings(pieces="all"))


def test_a_mesh_of_several_structures_is_refused_before_any_work(egg, tmp_path):
    path = tmp_path / "two.ply"
    write_mesh(path, joined(egg, moved(egg, [60.0, 0.0, 0.0])))
    with pytest.raises(InputError, match=r"two\.ply: .* 50 % of the area"):
        read_source(Subject("a", path), SETTINGS)


def test_what_encloses_no_volume_is_refused(egg, tmp_path):
    upper = egg.vertices[egg.faces][..., 2].min(axis=1) > 0.0
    cap = TriangleMesh(egg.vertices * [1.0, 1.0, 0.02], egg.faces[upper])
    flat = TriangleMesh(egg.vertices * [1.0, 1.0, 0.0], egg.faces[upper])
    across, along = np.meshgrid(np.linspace(0.0, 60.0, 121), np.linspace(-15.0, 15.0, 31), indexing="ij")
    wave = np.stack([across, 9.0 * np.sin(across / 60.0 * 6.0 * np.pi), along], axis=-1).reshape(-1, 3)
    corner = (31 * np.arange(120)[:, None] + np.arange(30)).ravel()
    halves = [[corner, corner + 31, corner + 32], [corner, corner + 32, corner + 1]]
    waves = TriangleMesh(wave, np.concatenate([np.stack(half, axis=1) for half in halves]))
    for mesh, text in (
        (cap, "encloses no volume"),
        (waves, "mesh is open .* encloses one volume"),
        (flat, "is flat and encloses no volume"),
    ):
        path = tmp_path / "open.ply"
        write_mesh(path, mesh)
        with pytest.raises(InputError, match=text):
            groom_subject(Subject("a", path), SETTINGS)


def test_notes_say_how_far_the_surface_is_from_the_repaired_one(egg, tmp_path):
    path = tmp_path / "a.ply"
    write_mesh(path, turned(egg, 0.2, np.random.default_rng(0)))
    notes = groom_subject(Subject("a", path), SETTINGS).report.notes
    assert any("opposite orientation" in note for note in notes)
    assert any("on average" in note for note in notes)


def test_all_pieces_of_a_segmentation_are_joined(grid, save):
    points = grid(12.0)
    balls = [(np.array([5.0, 0.0, 0.0]), 4.0), (np.array([-5.0, 0.0, 0.0]), 4.5)]
    two = np.any([np.linalg.norm(points - middle, axis=-1) < radius for middle, radius in balls], axis=0)
    path = save(two)
    assert groom_subject(Subject("a", path), SETTINGS).report.components_dropped == 1
    joined = groom_subject(Subject("a", path), GroomSettings(pieces="all", mesh_edge=1.5))
    assert any("joined by bridges" in note for note in joined.report.notes)
    touching = two | (np.linalg.norm(points[..., 1:], axis=-1) < 2.5) & (np.abs(points[..., 0]) < 5.0)
    result = groom_subject(Subject("a", save(touching)), GroomSettings(pieces="all", mesh_edge=1.5))
    assert result.report.components_dropped == 0


def test_a_piece_in_a_cavity_is_no_piece_apart(egg):
    inner = moved(egg, 0.0, 0.6)
    hollow = joined(egg, TriangleMesh(inner.vertices, inner.faces[:, ::-1]), moved(egg, 0.0, 0.3))
    twice = TriangleMesh(hollow.vertices, np.concatenate([hollow.faces, hollow.faces[:1]]))
    solid = level_of_triangles(twice, SETTINGS)
    assert solid.volume == pytest.approx(VOLUME, rel=0.03)
    beside = joined(moved(egg, [-50.0, 0.0, 0.0], 0.5), twice)
    with pytest.raises(InputError, match="in 2 pieces"):
        level_of_triangles(beside, SETTINGS.model_copy(update={"pieces": Pieces.ALL}))


@pytest.mark.parametrize("height", [14.0, 20.0, 23.0])
def test_a_mesh_cut_along_its_faces_is_closed_at_every_side_of_its_rim(height):
    points = np.stack(np.meshgrid(*[np.arange(-14.0, 14.0)] * 3, indexing="ij"), axis=-1)
    level = -np.linalg.norm(points / [8.0, 6.0, 10.0], axis=-1)
    whole = TriangleMesh(*measure.marching_cubes(level, -1.0, spacing=(1.0, 1.0, 1.5))[:2])
    kept = whole.faces[whole.vertices[whole.faces].mean(axis=1)[:, 2] > height]
    closed = solid_of(TriangleMesh(whole.vertices, kept)).mesh
    sides = np.concatenate([closed.faces[:, [0, 1]], closed.faces[:, [1, 2]], closed.faces[:, [2, 0]]])
    uses = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)[1]
    assert (uses % 2 == 0).all()  # four where an edge of the mesh also divides the cap
    assert 0.3 < closed.volume / abs(whole.volume) < 0.9


def test_jagged_ends_of_thousands_of_corners_are_closed_flat():
    turn = np.linspace(0.0, 2.0 * np.pi, 3000, endpoint=False)
    radius = 20.0 + 2.0 * np.sin(9 * turn) + np.random.default_rng(0).uniform(-0.05, 0.05, len(turn))
    swirl = turn + 0.5 * np.sin(18 * turn) / radius  # rays from the middle cross the rim several times
    ring = np.column_stack([radius * np.cos(swirl), radius * np.sin(swirl)])
    vertices = np.concatenate([np.insert(ring, 2, height, axis=1) for height in (0.0, 30.0)])
    low = np.arange(len(turn))
    high, after = low + len(turn), np.roll(low, -1)
    sides = np.concatenate([np.stack([low, after, high], 1), np.stack([after, after + len(turn), high], 1)])
    solid = solid_of(TriangleMesh(vertices, sides))
    x, y = ring.T
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert len(solid.rims) == 2
    assert solid.is_closed
    assert not mesh_fault(solid.mesh)
    assert solid.mesh.volume == pytest.approx(30.0 * area)


def test_a_seam_between_coarse_and_fine_faces_is_no_open_end():
    box = trimesh.creation.box((20.0, 12.0, 12.0)).subdivide_to_size(4.0)
    fine = box.triangles_center[:, 0] > 0.0
    other = trimesh.Trimesh(box.vertices, box.faces[fine]).subdivide()
    vertices = np.concatenate([box.vertices, other.vertices])
    solid = solid_of(
        TriangleMesh(vertices, np.concatenate([box.faces[~fine], other.faces + len(box.vertices)]))
    )
    assert len(solid.rims) == 0
    assert solid.is_closed
    assert solid.mesh.volume == pytest.approx(box.volume)
