"""Three planes of a scan: geometry, contours, the crosshair, and scans that are lost or of somebody else."""

import numpy as np
import pytest
import SimpleITK

from homolog.geometry import transform_points
from homolog.io.images import Segmentation, read_volume
from homolog_app.scenes.slices import PRESETS, GreyWindow, Grid, mask_contour, planes_of, section_of

pytestmark = pytest.mark.window


@pytest.fixture
def oblique():
    """Return a grid with permuted, partly turned axes: i towards the feet, j to the left, k to the front."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]) * [2.0, 1.0, 0.5]
    return Grid(matrix, (4, 6, 8))


def test_planes_are_turned_as_radiologists_see_them_whatever_the_axes_of_the_file(oblique):
    planes = planes_of(oblique)
    assert [plane.axis for plane in planes] == [0, 2, 1]
    assert [plane.letters for plane in planes] == [
        ("R", "L", "P", "A"),
        ("R", "L", "I", "S"),
        ("A", "P", "I", "S"),
    ]


def test_a_place_in_the_picture_is_the_voxel_that_is_drawn_there(oblique):
    values = np.arange(4 * 6 * 8).reshape(4, 6, 8)
    index = np.array([1.0, 4.0, 2.0])
    for plane in planes_of(oblique):
        picture = plane.picture(np.take(values, int(index[plane.axis]), axis=plane.axis))
        across, down = plane.places(index, oblique.shape).tolist()
        assert picture[int(down), int(across)] == values[1, 4, 2]
        start = np.array(index)
        start[[plane.across, plane.down]] = 0.0
        assert np.allclose(plane.moved(start, (across, down), oblique.shape), index)


def test_a_plane_cuts_a_tetrahedron_in_a_triangle_of_interpolated_colours():
    corners = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    colours = np.array([[200, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]], np.uint8)
    section = section_of(corners, faces, colours, 2, 1.0)
    assert section.segments.shape == (3, 2, 3)
    ends = {tuple(end) for end in section.segments.reshape(-1, 3).tolist()}
    assert ends == {(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0)}
    assert section.colours.tolist() == [[100, 0, 0]] * 3
    assert len(section_of(corners, faces, None, 2, 5.0).segments) == 0


def test_the_contour_of_a_mask_is_the_same_in_its_own_grid_and_in_a_turned_finer_one():
    mask = np.zeros((12, 12, 12), bool)
    mask[3:9, 4:8, 2:10] = True
    voxels = Segmentation(mask, np.eye(3), np.ones(3), np.array([5.0, 6.0, 7.0]))
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5]])
    matrix[:3, 3] = [4.0, 5.0, 6.0]
    for grid, axis, index in ((Grid.of_mask(voxels), 2, 5), (Grid(matrix, (40, 40, 40)), 2, 12)):
        (line,) = mask_contour(voxels, grid, axis, index)
        places = transform_points(grid.matrix, line)
        assert np.allclose(places[:, 2], 12.0)
        assert np.allclose(places[:, :2].min(axis=0), [7.5, 9.5], atol=0.3)
        assert np.allclose(places[:, :2].max(axis=0), [13.5, 13.5], atol=0.3)
    assert mask_contour(voxels, Grid.of_mask(voxels), 2, 11) == []


def test_a_window_maps_its_ends_to_black_and_white_and_survives_odd_values():
    window = PRESETS["CT soft tissue"]
    shades = window.shades(np.array([[-160.0, 40.0, 240.0, 5000.0, np.nan]], np.float32))
    assert shades[0].tolist() == [0, 127, 255, 255, 0]
    assert GreyWindow.between(10.0, 30.0) == GreyWindow(20.0, 20.0)
    assert window.dragged(0.5, 0.0).width > window.width
    assert window.dragged(0.0, 0.5).level > window.level


@pytest.fixture
def scanned(groomed, tmp_path, wait):
    """Return the window with slices of a subject, and the function that gives it a scan."""
    path = groomed.workspace.session.study.members[0].subject.path
    volume = read_volume(path)
    groomed.workspace.session.select(["a"])
    groomed.commands["view.slice"].trigger()
    reader = groomed.views.stage.slices.reader

    def give(shift=0.0, name="scan.nrrd"):
        image = SimpleITK.GetImageFromArray(np.where(volume.layers[0] > 0, 100, -900).astype(np.int16).T)
        matrix = volume.index_to_world
        spacing = np.linalg.norm(matrix[:3, :3], axis=0)
        image.SetDirection((matrix[:3, :3] / spacing).ravel().tolist())
        image.SetSpacing(spacing.tolist())
        image.SetOrigin((matrix[:3, 3] + shift).tolist())
        SimpleITK.WriteImage(image, str(tmp_path / name))
        groomed.views.scans.give("a", tmp_path / name)
        wait(lambda: not reader.is_busy)
        return groomed.views.stage.slices

    give.window = groomed
    return give


def test_a_scan_is_read_and_shown_with_the_window_that_fits_it(scanned):
    slices = scanned()
    assert slices.reader.read.scan.path.name == "scan.nrrd"
    assert slices.window_box.currentData() == "CT soft tissue"
    assert slices.window_box.isVisible()
    assert not slices.problem.isVisible()
    session = scanned.window.workspace.session
    session.undo.undo()
    assert session.study.members[0].subject.image is None
    assert slices.reader.read is None


@pytest.mark.own_window
def test_a_scan_of_another_frame_is_refused_with_numbers_and_the_segmentation_stays(scanned):
    slices = scanned(shift=500.0)
    assert slices.reader.read is None
    assert "mm apart" in slices.problem.text()
    assert slices.canvases[0].drawn is not None
    assert scanned.window.workspace.session.is_groomed


def test_a_lost_scan_is_named_and_stops_nothing(scanned, tmp_path, wait):
    window = scanned.window
    window.views.scans.give("a", tmp_path / "gone.nii.gz")
    slices = window.views.stage.slices
    wait(lambda: not slices.reader.is_busy)
    assert "gone.nii.gz" in slices.problem.text()
    assert window.commands["run.start"].isEnabled()


def test_a_click_in_one_plane_moves_the_others_and_so_does_a_pick_on_the_surface(scanned):
    from homolog_app.window.scene import Pick

    slices = scanned()
    axial, coronal, _ = slices.canvases
    before = [canvas.drawn.text for canvas in slices.canvases]
    axial.pointed.emit(*(np.array(axial.drawn.cross) + 2.0))
    after = [canvas.drawn.text for canvas in slices.canvases]
    assert (after[0], after[1] != before[1], after[2] != before[2]) == (before[0], True, True)
    coronal.stepped.emit(1)
    assert coronal.drawn.text != after[1]
    session = scanned.window.workspace.session
    vertex = session.groomed["a"].subject.mesh.vertices[100]
    world = transform_points(session.groomed["a"].alignment, vertex[None])[0]
    scanned.window.views.stage.scene.picker.picked.emit(Pick("a", world, None))
    assert np.allclose(slices.place, vertex, atol=1e-6)


def test_the_views_can_be_seen_beside_the_slices(scanned):
    slices, window = scanned(), scanned.window
    assert not window.views.stage.scene.isVisible()
    slices.beside.setChecked(True)
    assert window.views.stage.scene.isVisible()
    assert window.commands["view.grid4"].isEnabled()
    slices.beside.setChecked(False)
    assert not window.views.stage.scene.isVisible()


@pytest.mark.own_window
def test_a_plane_can_be_seen_alone(scanned):
    slices = scanned()
    slices.canvases[1].enlarged.emit()
    assert [canvas.isVisible() for canvas in slices.canvases] == [False, True, False]
    slices.canvases[1].enlarged.emit()
    assert all(canvas.isVisible() for canvas in slices.canvases)


def test_a_picture_of_slices_has_the_planes_at_twice_the_size_and_no_controls(scanned):
    slices = scanned()
    picture = slices.picture()
    assert picture.size() == slices.size() * 2
    button = slices.choose.geometry().translated(slices.choose.parentWidget().pos())
    for area, shows_something in ((slices.canvases[0].geometry(), True), (button, False)):
        part = picture.copy(area.left() * 2, area.top() * 2, area.width() * 2, area.height() * 2)
        shades = {part.pixel(x, y) for x in range(0, part.width(), 5) for y in range(0, part.height(), 5)}
        assert (len(shades) > 2) is shows_something


@pytest.mark.own_window
def test_an_image_that_is_dropped_on_a_subject_can_be_its_scan(scanned, tmp_path, wait):
    scanned()
    window = scanned.window
    slices = window.views.stage.slices
    at = slices.mapTo(window, slices.rect().center())
    window.drops.take([tmp_path / "scan.nrrd"], at)
    from PySide6.QtWidgets import QMenu

    menu = window.findChildren(QMenu)[-1]
    assert [action.text() for action in menu.actions()] == ["Scan of a", "Another subject"]
    other = tmp_path / "other.nrrd"
    (tmp_path / "scan.nrrd").rename(other)
    window.drops.take([other], at)
    window.findChildren(QMenu)[-1].actions()[0].trigger()
    assert window.workspace.session.study.members[0].subject.image == other
    window.commands["view.slice"].trigger()
    assert not window.views.shows_slices
    shapes = window.views.stage.scene.plot
    window.drops.take([other], shapes.mapTo(window, shapes.rect().center() / 2))
    window.findChildren(QMenu)[-1].actions()[0].trigger()
    assert window.views.shows_slices
    for menu in window.findChildren(QMenu):
        menu.close()
