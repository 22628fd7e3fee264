"""The Measure page: distance, volume and area along a mode and for each subject."""

import csv
import dataclasses

import numpy as np
import pytest
import trimesh

from homolog.io.meshes import write_mesh
from homolog.surfaces.clipping import Plane, clipped
from homolog.surfaces.closest import distances_to
from homolog.surfaces.comparison import surface_distances
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.walls import mean_over_area, wall_thickness
from homolog_app.rendering.colours import common_limit
from homolog_app.scenes.shapes import aligned_surfaces, distance_text
from homolog_app.window.explore.mode_plots import axis_menu

pytestmark = pytest.mark.window


@pytest.fixture
def page(explore, finished, wait):
    page = explore(finished, "measure")
    wait(lambda: page.table.rowCount() == 4 and not page.charts.each[1].is_empty)
    return page


def cells(page):
    model = page.table
    return [
        [model.data(model.index(row, column), 0x0100) for column in range(model.columnCount())]
        for row in range(model.rowCount())
    ]


def test_names_of_subjects_have_room_beside_their_measures(page):
    assert page.view.columnWidth(0) >= page.view.sizeHintForColumn(0)


def test_subjects_have_the_volume_and_area_of_their_own_surfaces(page, window):
    surfaces = window.workspace.session.result.surfaces
    result = window.workspace.session.result.result
    mean = result.mean_surface
    for (name, _, _, volume, area, wall, from_mean), alignment in zip(
        cells(page), result.alignments, strict=True
    ):
        mesh = surfaces[name][0]  # they are convex: the nearest place of the mean surface is the same place
        apart = distances_to(mean, mesh.placed(alignment).vertices)
        assert from_mean == pytest.approx(apart.mean(), rel=0.15)
        assert volume == pytest.approx(mesh.volume / 1000.0)
        assert area == pytest.approx(mesh.area / 100.0)
        assert wall == pytest.approx(mean_over_area(mesh, wall_thickness(mesh)))
    volumes = {row[0]: row[3] for row in cells(page)}
    for name, axes in (("a", (9, 7, 6)), ("b", (10, 7, 5)), ("c", (8, 7.5, 6)), ("d", (9.5, 6, 6.5))):
        assert volumes[name] == pytest.approx(4.0 / 3.0 * np.pi * np.prod(axes) / 1000.0, rel=0.05)


def test_open_surfaces_have_no_volume_in_table_plots_and_files(page, window, wait, tmp_path):
    session = window.workspace.session
    loaded, up = session.result, np.array([0.0, 0.0, 1.0])
    both = {name: loaded.surfaces[name] for name in loaded.result.names}
    opened = {
        name: (clipped(mesh, Plane.of(mesh.vertices.mean(axis=0), up)), coarse)
        for name, (mesh, coarse) in both.items()
    }
    assert page.charts.each[1].isVisibleTo(page.charts)
    session.show_result(dataclasses.replace(loaded, surfaces=opened))
    wait(lambda: len(cells(page)) == 4 and np.isnan(cells(page)[0][3]))
    assert page.view.isColumnHidden(3)
    assert not page.charts.boxes[1].isVisibleTo(page.charts)
    page.write(tmp_path / "measures.csv")
    heads = (tmp_path / "measures.csv").read_text().splitlines()[0].split(",")
    assert "area_cm2" in heads
    assert "volume_ml" not in heads


def test_the_distance_is_that_of_the_chosen_particles(page, window):
    local = window.workspace.session.result.result.local
    for first, second in ((0, 16), (3, 30)):
        page.particles[0].setValue(first)
        page.particles[1].setValue(second)
        expected = np.linalg.norm(local[:, first] - local[:, second], axis=1)
        np.testing.assert_allclose([row[2] for row in cells(page)], expected)


def test_clicks_on_the_shape_set_the_two_particles_in_turn(page):
    from homolog_app.window.scene import Pick

    page.place.setValue(100)
    particles = page.fitted.shape.model.instance(np.array([1.0]))
    for particle in (5, 9, 12):
        page.handle_pick(Pick("x", particles[particle] + 0.1, None))
    assert page.pair == (12, 9)


def test_curves_along_a_mode_are_those_of_the_shapes_that_are_shown(page, window):
    shape, (distance, volume, area, *_) = page.fitted.shape, page.charts.each
    curve = page.charts.each[4]  # twice as far is twice the deviation, whatever the thickness of the wall
    np.testing.assert_allclose(curve.values, np.abs(curve.positions) * curve.values[-1] / 3.0, atol=1e-6)
    page.place.setValue(150)
    (shown,) = window.views.stage.scene.shown
    at = 1.5
    assert np.interp(at, volume.positions, volume.values) == pytest.approx(
        shown.groomed.volume / 1000.0, rel=1e-3
    )
    assert np.interp(at, area.positions, area.values) == pytest.approx(shown.groomed.area / 100.0, rel=1e-3)
    first, second = shape.model.instance(np.array([at]))[list(page.pair)]
    assert np.interp(at, distance.positions, distance.values) == pytest.approx(
        np.linalg.norm(second - first), rel=1e-3
    )
    np.testing.assert_allclose(shown.lines[0], [first, second])


def test_the_exported_table_is_that_of_the_command_line(page, window, finished, tmp_path, monkeypatch):
    from homolog_app.cli import main

    page.particles[0].setValue(0)
    page.particles[1].setValue(7)
    path, other = tmp_path / "window.csv", tmp_path / "line.csv"
    monkeypatch.setattr("PySide6.QtWidgets.QFileDialog.getSaveFileName", lambda *_: (str(path), ""))
    window.commands["explore.table"].trigger()
    assert main(["export", "measures", str(finished), "--particles", "0", "7", "--out", str(other)]) == 0
    assert path.read_bytes() == other.read_bytes()
    with path.open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == ["a", "b", "c", "d"]
    assert float(rows[1]["distance_from_mean_surface_mm"]) == pytest.approx(cells(page)[1][6])
    assert float(rows[0]["volume_ml"]) == pytest.approx(cells(page)[0][3])


def test_a_particle_that_is_not_there_is_refused(finished, tmp_path, capsys):
    from homolog_app.cli import main

    out = tmp_path / "x.csv"
    assert main(["export", "measures", str(finished), "--particles", "0", "99", "--out", str(out)]) != 0
    assert "no particle 99" in capsys.readouterr().err
    assert not out.exists()


def test_a_row_selects_its_subject(page, window):
    page.view.selectRow(2)
    assert window.workspace.session.selection == ("c",)


def test_a_map_shows_the_thickness_of_a_subject_and_its_distance_from_the_mean(page, window):
    scene = window.views.stage.scene
    page.who.setCurrentText("b")
    for kind, unit in (("thickness", "mm"), ("distance", "mm")):
        page.map.setCurrentIndex(page.map.findData(kind))
        page.map.activated.emit(0)
        content, scale = scene.shown[0], scene.bar.scale
        assert content.name == "b"
        assert scale.unit == unit
        assert content.colours.shape == content.groomed.vertices.shape
        assert len(np.unique(content.colours, axis=0)) > 20
        assert window.commands["view.range"].isEnabled()
    middle = wall_thickness(window.workspace.session.result.surfaces["b"][0])
    assert np.nanmedian(middle) == pytest.approx(10.0, rel=0.25)  # from side to side of an ellipsoid
    page.map.setCurrentIndex(0)
    page.map.activated.emit(0)
    assert scene.bar.scale is None


def test_measures_are_compared_by_group(plots, page, window):
    session = window.workspace.session
    volume = page.charts.boxes[1]
    assert volume.is_empty
    assert "Assign groups" in volume.hint.text()
    page.charts.clear_measures()  # as while subjects are measured
    assert "Assign groups" not in volume.hint.text()
    for names, group in ((["a", "b"], "large"), (["c", "d"], "small")):
        session.select(names)
        session.set_group(group)
    page.kind.setCurrentIndex(1)
    page.kind.activated.emit(1)
    assert volume.isVisible()
    volumes = {row[0]: row[3] for row in cells(page)}
    assert volume.measure.groups == ("large", "small")
    assert volume.measure.means[0] == pytest.approx((volumes["a"] + volumes["b"]) / 2.0)
    assert "n = 2" in volume.toolTip()
    assert page.charts.legend.isVisible()
    assert "large" in page.charts.legend.text()
    window.grab()


def test_the_two_volumes_of_a_subject_are_named(page, window):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QLabel

    from homolog_app.window.cohort_model import VOLUME

    model = window.inspector.cohort.rows
    tip = model.headerData(VOLUME, Qt.Orientation.Horizontal, Qt.ItemDataRole.ToolTipRole)
    assert "input file" in tip
    assert any(text.text().startswith("Groomed surfaces") for text in page.findChildren(QLabel))


def test_the_boxes_of_another_study_are_not_shown(page, monkeypatch):
    volume = page.charts.boxes[1]
    values, groups = np.array([1.0, 2.0, 4.0, 5.0]), ["large", "large", "small", "small"]
    page.charts.show_measures([values] * 5, groups, list("abcd"))
    assert not volume.is_empty
    assert not page.charts.pairs.is_empty
    monkeypatch.setattr(type(page.fitted), "shape", None)
    page.fitted.changed.emit()
    assert volume.is_empty
    assert page.charts.pairs.is_empty
    assert not volume.toolTip()
    assert not page.charts.legend.text()


def test_two_shapes_are_seen_side_by_side_on_one_scale(page, window):
    for chooser, text in ((page.who, "a"), (page.beside, "b"), (page.map, "Wall thickness")):
        chooser.setCurrentText(text)
    page.shown_changed.emit()
    scene = window.views.stage.scene
    assert [content.name for content in scene.shown] == ["a", "b"]
    assert scene.grid.columns == 2
    shown = page.shown(window.views.subjects)
    assert shown.scale is not None
    assert all(content.colours is not None for content in shown.contents)
    page.beside.setCurrentIndex(0)
    assert len(page.shown(window.views.subjects).contents) == 1


def test_one_measure_is_plotted_against_another(page, window):
    page.kind.setCurrentText("Scatter plot")
    page.kind.activated.emit(page.kind.currentIndex())
    pairs = page.charts.pairs
    for axis, text in enumerate(("Wall", "Area")):
        (entry,) = [action for action in axis_menu(pairs, axis).actions() if action.text() == text]
        entry.trigger()
    assert page.charts.currentWidget() is pairs
    np.testing.assert_allclose(pairs.points, [[row[5], row[4]] for row in cells(page)])
    pairs.subject_chosen.emit("c")
    assert window.workspace.session.selection == ("c",)


def choose(chooser, name):
    chooser.setCurrentIndex(chooser.findData(name))
    chooser.activated.emit(chooser.currentIndex())


def test_the_distance_between_two_subjects_is_a_map_and_a_measure(page, window):
    choose(page.who, "a")
    choose(page.map, "distance")
    choose(page.origin, "b")
    scene = window.views.stage.scene
    (content,), scale = scene.shown, scene.bar.scale
    own = aligned_surfaces(window.workspace.session.result)
    apart = surface_distances(own["a"], own["b"])
    np.testing.assert_array_equal(content.colours, scale.colours(apart.signed))
    assert distance_text(apart) in content.note
    assert scale.title.endswith("b")
    assert (scale.unit, scale.low, scale.high) == ("mm", -scale.high, common_limit([apart.signed]))


def test_the_means_of_two_groups_can_be_compared(page, window):
    session = window.workspace.session
    for names, group in ((["a", "b"], "large"), (["c", "d"], "small")):
        session.select(names)
        session.set_group(group)
    choose(page.who, "mean of large")
    assert window.views.stage.scene.shown[0].note.startswith("distance ")  # of the two particles
    choose(page.map, "distance")
    choose(page.origin, "mean of small")
    (content,) = window.views.stage.scene.shown
    shape = page.fitted.shape
    means = [shape.model.scores_[rows].mean(axis=0) for rows in ([0, 1], [2, 3])]
    large, small = (
        TriangleMesh(
            shape.mean.vertices + shape.moved(mean / shape.model.standard_deviations_), shape.mean.faces
        )
        for mean in means
    )
    np.testing.assert_allclose(content.groomed.vertices, large.vertices)
    assert distance_text(surface_distances(large, small)) in content.note
    choose(page.origin, "mean")
    scale, most = window.views.stage.scene.bar.scale, surface_distances(large, shape.mean).maximum
    assert scale.high < 2.5 * most  # not that of the modes, which may be many times as much


def test_two_mesh_files_can_be_compared(page, window, tmp_path, monkeypatch):
    files = [tmp_path / "one.vtp", tmp_path / "other.vtp"]
    for path, radius in zip(files, (10.0, 12.0), strict=True):
        sphere = trimesh.creation.icosphere(subdivisions=3, radius=radius)
        write_mesh(path, TriangleMesh(np.array(sphere.vertices), np.array(sphere.faces)))
    for path, chooser in zip(files, (page.who, page.origin), strict=True):
        monkeypatch.setattr(
            "PySide6.QtWidgets.QFileDialog.getOpenFileName", lambda *_, path=path: (str(path), "")
        )
        choose(chooser, chooser.itemData(chooser.count() - 1))
        assert chooser.currentText() == path.name
    choose(page.map, "distance")
    (content,) = window.views.stage.scene.shown
    assert content.name == "one.vtp"
    assert "mean 1.99, " in content.note  # between the middles of faces


def test_what_is_no_mesh_file_is_refused_and_the_choice_stays(page, window, tmp_path, monkeypatch):
    heard, bad = [], tmp_path / "bad.vtp"
    bad.write_text("nothing")
    window.workspace.session.failed.disconnect()
    window.workspace.session.failed.connect(lambda *error: heard.append(error))
    monkeypatch.setattr("PySide6.QtWidgets.QFileDialog.getOpenFileName", lambda *_: (str(bad), ""))
    choose(page.origin, page.origin.itemData(page.origin.count() - 1))
    assert page.origin.currentData() == "mean"
    assert len(heard) == 1


def test_exported_distances_are_those_of_the_command_line(
    page, window, finished, tmp_path, monkeypatch, capsys
):
    from homolog_app.cli import main

    choose(page.who, "a")
    choose(page.map, "distance")
    choose(page.origin, "b")
    path, other = tmp_path / "window.vtp", tmp_path / "line.vtp"
    monkeypatch.setattr("PySide6.QtWidgets.QFileDialog.getSaveFileName", lambda *_: (str(path), ""))
    window.commands["explore.distances"].trigger()
    line = ["export", "distances", str(finished), "--surface", "a", "--from", "b", "--out", str(other)]
    assert main(line) == 0
    assert path.read_bytes() == other.read_bytes()
    assert "Hausdorff distance" in capsys.readouterr().out
    assert main([*line[:3], "--surface", "nobody", "--from", "b", "--out", str(other)]) == 2
    assert "nobody" in capsys.readouterr().err
