import json

import numpy as np
import pytest

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.grooming import check_cohort
from homolog.grooming.subject import groom
from homolog.io.constraints import cuts_of, read_constraints, text_of, write_planes
from homolog.io.meshes import read_mesh, write_mesh
from homolog.run.planes import carried, common_planes, plane_along, plane_through, with_regions
from homolog.settings import GroomSettings
from homolog.surfaces.clipping import Ball, Plane, clipped, kept_heights
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, rim_sides


@pytest.fixture
def egg(unit_sphere):
    vertices, faces = unit_sphere(800)
    return TriangleMesh(vertices * [10.0, 8.0, 30.0] + np.array([0.0, 0.0, 5.0]), faces)


def cut_at(mesh, height, tilt=0.0):
    return Plane.of(np.array([0.0, 0.0, height]), np.array([np.sin(tilt), 0.0, np.cos(tilt)]))


def rim(mesh):
    return mesh.vertices[np.unique(rim_sides(mesh.faces)[0])]


def test_the_part_beyond_a_plane_is_cut_off_at_the_plane(egg):
    plane = cut_at(egg, -4.0, 0.2)
    part = clipped(egg, plane)
    check_mesh(part, "egg", may_open=True)
    np.testing.assert_allclose(
        plane.heights(part.vertices[np.unique(rim_sides(part.faces)[0])]), 0.0, atol=1e-9
    )
    assert plane.heights(part.vertices).min() > -1e-9
    rest = clipped(egg, Plane.of(plane.point, -plane.direction))
    assert part.area + rest.area == pytest.approx(egg.area, rel=1e-3)
    assert clipped(egg, cut_at(egg, -40.0)) is egg
    assert len(clipped(egg, cut_at(egg, 40.0)).faces) == 0


def test_planes_are_written_and_read_as_a_column_of_the_table(egg):
    planes = (cut_at(egg, 3.0), cut_at(egg, -4.0, 0.2))
    again = cuts_of(Subject("a", "a.ply", columns={"Cut": text_of(planes)}))
    for plane, other in zip(planes, again, strict=True):
        np.testing.assert_allclose(other.point, plane.point, atol=1e-4)
        np.testing.assert_allclose(other.direction, plane.direction, atol=1e-4)
    assert cuts_of(Subject("a", "a.ply")) == ()


def test_a_wrong_plane_is_a_line_for_its_subject_and_the_others_are_kept(egg, tmp_path):
    texts = {"a": "0 0 0 0 0 1", "b": "0 0 90 0 0 1", "c": "0 0 -90 0 0 1", "d": "0 0 1", "e": ""}
    subjects = [
        Subject(name, tmp_path / f"{name}.ply", columns={"cut": text}) for name, text in texts.items()
    ]
    problems = check_cohort(
        Cohort(tuple(subjects), tmp_path), GroomSettings(), sources=dict.fromkeys(texts, egg)
    )
    messages = {problem.subject: problem.message for problem in problems}
    assert list(messages) == ["b", "c", "d"]
    assert messages["b"].startswith("b: its cutting plane cuts everything off, 55")
    assert messages["c"].startswith("c: its cutting plane cuts nothing off, 65")
    assert messages["d"].startswith("d: its cut is '0 0 1'; give six numbers")


def test_a_closed_surface_with_a_plane_is_groomed_and_then_open(egg):
    plane = cut_at(egg, 0.0)
    groomed = groom("egg", egg, GroomSettings(mesh_edge=2.0), [plane])
    assert groomed.field is None
    assert groomed.report.rims == 1
    for mesh in (groomed.mesh, groomed.coarse_mesh):
        np.testing.assert_allclose(plane.heights(rim(mesh)), 0.0, atol=1e-3)


def test_a_plane_is_carried_to_a_larger_turned_and_longer_subject(egg):
    turn = np.eye(4)
    turn[:3, :3] = 1.2 * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turn[:3, 3] = [3.0, 50.0, -7.0]
    plane = cut_at(egg, 0.0, 0.1)
    source = clipped(egg, cut_at(egg, -2.0))
    start = turn.copy()
    start[:3, 3] += [2.0, -1.0, 4.0]
    (there,) = carried([plane], source, egg.placed(turn), start)
    wanted = plane.placed(turn)
    assert np.degrees(np.arccos(there.direction @ wanted.direction)) < 2.0
    assert abs(there.heights(wanted.point)) < 1.0  # of 72 mm


def test_common_planes_cut_off_every_rim_at_the_same_place(egg):
    heights = [-12.0, -6.0, 0.0, -9.0]
    meshes = [clipped(egg, cut_at(egg, height, 0.05 * k)) for k, height in enumerate(heights)]
    planes = common_planes(meshes, np.tile(np.eye(4), (4, 1, 1)), list("abcd"))
    for mesh, plane in zip(meshes, planes, strict=True):
        assert plane.heights(rim(mesh)).max() <= 1e-6
        assert plane.heights(np.array([0.0, 0.0, 0.0])) == pytest.approx(
            planes[2].heights(np.array([0.0, 0.0, 0.0])), abs=1.0
        )
    with pytest.raises(InputError, match="b: has no rim"):
        common_planes([meshes[0], egg], np.tile(np.eye(4), (2, 1, 1)), ["a", "b"])


def test_planes_follow_landmarks_and_the_long_axis(egg):
    points = np.array([[10.0, 0.0, -8.0], [0.0, 8.0, -8.0], [-10.0, 0.0, -8.0]])
    plane = plane_through(points, egg)
    np.testing.assert_allclose(plane.direction, [0.0, 0.0, 1.0], atol=1e-9)
    with pytest.raises(InputError, match="on a line"):
        plane_through(points[[0, 0, 2]], egg)
    along = plane_along(egg, 20.0, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(along.direction, [0.0, 0.0, 1.0], atol=0.05)
    assert along.heights(egg.vertices).max() == pytest.approx(20.0, abs=0.01)
    opened = clipped(egg, plane)
    assert plane_along(opened, 20.0).direction[2] > 0.9
    with pytest.raises(InputError, match="is closed"):
        plane_along(egg, 20.0)


def dab(mesh, place, radius):
    return Ball(mesh.vertices[np.linalg.norm(mesh.vertices - place, axis=1).argmin()], radius)


def test_paint_leaves_out_the_near_side_of_a_wall_only_and_can_be_put_back(unit_sphere):
    points, faces = unit_sphere(2000)
    wall = TriangleMesh(
        np.concatenate([20.0 * points, 18.0 * points]), np.concatenate([faces, faces[:, ::-1] + len(points)])
    )
    top = dab(wall, np.array([0.0, 0.0, 20.0]), 5.0)
    heights = kept_heights(wall, [top])
    out = heights < 0.0
    assert out[: len(points)].sum() > 10
    assert not out[len(points) :].any()
    assert not (kept_heights(wall, [top, Ball(top.centre, 6.0, keeps=True)]) < 0.0).any()
    assert cuts_of(Subject("a", "a.ply", columns={"cut": text_of([top])}))[0].radius == pytest.approx(5.0)


def test_a_painted_surface_is_groomed_without_the_painted_part(egg):
    paint = [dab(egg, np.array([0.0, 8.0, 5.0]), 4.0), dab(egg, np.array([0.0, 8.0, 9.0]), 4.0)]
    groomed = groom("egg", egg, GroomSettings(mesh_edge=1.0), paint)
    assert groomed.report.rims == 1
    assert groomed.report.notes[-1].endswith("% of its surface was cut away")
    for ball in paint:
        apart = np.linalg.norm(groomed.mesh.vertices - ball.centre, axis=1)
        assert apart.min() == pytest.approx(4.0, abs=0.3)


def test_wrong_paint_is_a_line_for_its_subject(egg, tmp_path):
    texts = {"a": "90 0 0 5", "b": "0 0 5 0", "c": "10 0 5 3"}
    subjects = [
        Subject(name, tmp_path / f"{name}.ply", columns={"cut": text}) for name, text in texts.items()
    ]
    problems = check_cohort(
        Cohort(tuple(subjects), tmp_path), GroomSettings(), sources=dict.fromkeys(texts, egg)
    )
    messages = [problem.message for problem in problems]
    assert messages[0].startswith("a: what is painted is 75")
    assert messages[1].startswith("b: its cut is '0 0 5 0'; give six numbers for a plane")
    assert len(messages) == 2
    with pytest.raises(InputError, match="egg: its planes and paint leave nothing"):
        groom("egg", egg, GroomSettings(mesh_edge=2.0), [Ball(np.array([0.0, 0.0, 5.0]), 90.0)])


def test_paint_is_carried_with_the_surface_to_a_larger_and_turned_subject(egg):
    turn = np.eye(4)
    turn[:3, :3] = 1.2 * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    ball = dab(egg, np.array([10.0, 0.0, 12.0]), 4.0)
    start = turn.copy()
    start[:3, 3] += [2.0, -1.0, 3.0]
    (there,) = carried([ball], egg, egg.placed(turn), start)
    assert np.linalg.norm(there.centre - ball.placed(turn).centre) < 1.5  # of 72 mm
    assert there.radius == pytest.approx(4.8, rel=0.02)


def test_flags_of_vertices_and_constraints_of_shapeworks_mean_the_same_part(egg, tmp_path):
    write_mesh(tmp_path / "egg.ply", egg)
    vertices = read_mesh(tmp_path / "egg.ply").vertices
    kept = np.linalg.norm(vertices - [0.0, 8.0, 5.0], axis=1) > 5.0
    (tmp_path / "egg.txt").write_text("\n".join("1" if flag else "0" for flag in kept))
    field = {"points": vertices.tolist(), "scalars": kept.astype(int).tolist()}
    planes = [{"points": [[0, 0, -9], [1, 0, -9], [0, 1, -9]]}]
    content = {"planes": planes, "free_form_constraints": {"field": field}}
    (tmp_path / "egg.json").write_text(json.dumps(content))
    cohort = Cohort((Subject("egg", tmp_path / "egg.ply"),), tmp_path)
    (flagged,) = with_regions(cohort, str(tmp_path / "{subject}.txt")).subjects
    (of_shapeworks,) = with_regions(cohort, str(tmp_path / "{subject}.json")).subjects
    plane, *paint = cuts_of(of_shapeworks)
    np.testing.assert_allclose(plane.direction, [0.0, 0.0, 1.0])
    assert text_of(paint) == text_of(cuts_of(flagged))
    assert ((kept_heights(egg, paint) > 0.0) == kept).mean() > 0.99


@pytest.mark.parametrize("of_faces", [False, True])
def test_an_array_of_a_mesh_file_is_a_painted_region(egg, tmp_path, of_faces):
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(egg.vertices, egg.faces)
    out = np.linalg.norm(egg.vertices - [0.0, 8.0, 5.0], axis=1) < 5.0
    (surface.cell_data if of_faces else surface.point_data)["cut"] = (
        out[egg.faces].any(axis=1) if of_faces else out
    ).astype(np.int8)
    surface.save(tmp_path / "egg.vtp")
    cohort = Cohort((Subject("egg", tmp_path / "egg.vtp"),), tmp_path)
    (subject,) = with_regions(cohort, str(tmp_path / "{subject}.vtp")).subjects
    paint = cuts_of(subject)
    assert ((kept_heights(egg, paint) < 0.0) == out).mean() > 0.98
    del (surface.cell_data if of_faces else surface.point_data)["cut"]
    surface.save(tmp_path / "egg.vtp")
    with pytest.raises(InputError, match="no array"):
        with_regions(cohort, str(tmp_path / "{subject}.vtp"))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"spheres": [1]}, "has spheres, which are not supported"),
        ({"planes": [{"points": [[0, 0, 0], [1, 1]]}]}, "its constraints are damaged"),
        ({"planes": [{"points": [[0, 0, 0]] * 3}]}, "a cutting plane needs a point and a direction"),
        ({"free_form_constraints": {"boundaries": []}}, "has boundaries only"),
        ({"free_form_constraints": {"field": {"points": [[0, 0, 0]], "scalars": [0]}}}, "every point"),
        ({"free_form_constraints": {"field": {"points": [[0, 0, 0]], "scalars": []}}}, "damaged"),
    ],
)
def test_constraints_that_mean_something_else_are_refused_by_name(tmp_path, content, reason):
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=reason) as fault:
        read_constraints(tmp_path / "a.json")
    assert str(fault.value).startswith(str(tmp_path / "a.json"))


def test_flags_of_another_mesh_are_refused(egg, tmp_path):
    write_mesh(tmp_path / "egg.ply", egg)
    (tmp_path / "egg.txt").write_text("0 1 1")
    cohort = Cohort((Subject("egg", tmp_path / "egg.ply"),), tmp_path)
    with pytest.raises(InputError, match=r"egg.txt: has 3 values, and egg.ply 800 different vertices"):
        with_regions(cohort, str(tmp_path / "{subject}.txt"))
    with pytest.raises(InputError, match="no such file exists"):
        with_regions(cohort, str(tmp_path / "{subject}.json"))


def test_planes_are_written_for_shapeworks_as_they_are_read(egg, tmp_path):
    planes = [cut_at(egg, 3.0), cut_at(egg, -4.0, 0.2), Plane.of(np.ones(3), -np.ones(3))]
    write_planes(tmp_path / "a.json", planes)
    for plane, other in zip(planes, read_constraints(tmp_path / "a.json"), strict=True):
        np.testing.assert_allclose(other.point, plane.point, atol=1e-9)
        np.testing.assert_allclose(other.direction, plane.direction, atol=1e-9)
