import numpy as np
import pytest

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.grooming import check_cohort
from homolog.grooming.cuts import planes_of, text_of
from homolog.grooming.subject import groom
from homolog.run.planes import carried, common_planes, plane_along, plane_through
from homolog.settings import GroomSettings
from homolog.surfaces.clipping import Plane, clipped
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_surface, rim_sides


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
    check_surface(part, "egg")
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
    again = planes_of(Subject("a", "a.ply", columns={"Cut": text_of(planes)}))
    for plane, other in zip(planes, again, strict=True):
        np.testing.assert_allclose(other.point, plane.point, atol=1e-4)
        np.testing.assert_allclose(other.direction, plane.direction, atol=1e-4)
    assert planes_of(Subject("a", "a.ply")) == ()


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
    assert messages["d"].startswith("d: its cutting plane is '0 0 1'; give six numbers")


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
    there = carried(plane, source, egg.placed(turn), start)
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
