import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.beans.generate import WIDE, Bean, voxelize
from homolog.beans.surface import closest_on_bean
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.grooming import groom_subject
from homolog.io.meshes import write_mesh
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh

SETTINGS = GroomSettings()


def groomed(path, **settings):
    """Groom a file; large triangles do where the mesh is not the point."""
    return groom_subject(Subject("one", path), GroomSettings(**{"mesh_edge": 1.5, **settings}))


@pytest.fixture(scope="module")
def bean_and_groomed(tmp_path_factory):
    import SimpleITK

    bean = Bean(WIDE, 3.2, 7.7)
    mask, affine = voxelize(bean)
    image = SimpleITK.GetImageFromArray(mask.astype(np.uint8).T)
    image.SetOrigin(affine[:3, 3].tolist())
    path = tmp_path_factory.mktemp("bean") / "bean.nrrd"
    SimpleITK.WriteImage(image, str(path))
    return bean, groom_subject(Subject("bean", path), SETTINGS)


def test_a_bean_is_met_within_a_twelfth_of_a_voxel(bean_and_groomed):
    bean, result = bean_and_groomed
    error = np.abs(closest_on_bean(result.mesh.vertices, bean).distance)
    assert error.mean() < 0.08
    assert np.percentile(error, 95) < 0.22
    assert error.max() < 1.0


def test_the_gradient_has_length_one_and_is_the_normal_away_from_the_rim(bean_and_groomed):
    bean, result = bean_and_groomed
    contact = closest_on_bean(result.mesh.vertices, bean)
    smooth = np.abs(contact.distance) < 0.2
    slopes = result.field.gradients(result.mesh.vertices)[smooth]
    length = np.linalg.norm(slopes, axis=1)
    assert abs(length.mean() - 1.0) < 0.01
    cosine = (slopes * contact.normals[smooth]).sum(axis=1) / length
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean() < 3.0


def test_the_second_derivatives_are_those_of_the_ellipsoid(bean_and_groomed):
    """The mean curvature at the underside, far from the slot, where it is known in closed form."""
    _, result = bean_and_groomed
    below = result.mesh.vertices[result.mesh.vertices[:, 2] < -12.0]
    trace = sum(
        (result.field.gradients(below + axis) - result.field.gradients(below - axis)) @ axis / 2.0
        for axis in np.eye(3)
    )
    axes = np.array(WIDE.body)
    slope, bend = 2.0 * below / axes**2, 2.0 / axes**2
    length = np.linalg.norm(slope, axis=1)
    expected = bend.sum() / length - (slope**2 * bend).sum(axis=1) / length**3
    assert np.sqrt(np.mean((trace - expected) ** 2)) < 0.03
    assert abs(np.mean(trace - expected)) < 0.005


def test_meshes_are_closed_even_and_of_the_wished_size(bean_and_groomed):
    _, result = bean_and_groomed
    check_mesh(result.mesh, "fine")
    check_mesh(result.coarse_mesh, "coarse")
    assert 5500 < len(result.mesh.vertices) < 6500
    assert 1300 < len(result.coarse_mesh.vertices) < 1700
    assert result.mesh.volume > 0.0
    corners = result.mesh.vertices[result.mesh.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert sides.std() / sides.mean() < 0.2
    quality = 4.0 * np.sqrt(3.0) * result.mesh.face_areas / (sides**2).sum(axis=1)
    assert quality.min() > 0.4


def test_the_field_reaches_six_nodes_beyond_the_surface(bean_and_groomed):
    _, result = bean_and_groomed
    values = result.field.values
    border = np.concatenate(
        [values[[0, -1]].ravel(), values[:, [0, -1]].ravel(), values[..., [0, -1]].ravel()]
    )
    assert border.min() > 5.0 * result.field.spacing


def test_the_same_file_gives_the_same_bits_and_survives_pickling(sphere_volume):
    path = sphere_volume()
    first, second = groomed(path), pickle.loads(pickle.dumps(groomed(path)))
    assert np.array_equal(first.field.values, second.field.values)
    assert np.array_equal(first.mesh.vertices, second.mesh.vertices)
    assert np.array_equal(first.coarse_mesh.faces, second.coarse_mesh.faces)
    assert first.report == second.report
    assert not second.mesh.vertices.flags.writeable


def test_the_grids_direction_does_not_matter(grid, save):
    """The same voxels, listed along other axes or under a turned frame, give the same shape."""
    points = grid(12.0)
    mask = ((points / [9.0, 6.0, 4.0]) ** 2).sum(axis=-1) < 1.0
    plain = groomed(save(mask, "plain.nrrd", origin=points[0, 0, 0]))
    flipped = groomed(
        save(
            mask[::-1, :, ::-1],
            "flipped.nrrd",
            origin=points[-1, 0, -1],
            direction=np.diag([-1.0, 1.0, -1.0]),
        )
    )
    permuted = groomed(
        save(
            mask.transpose(2, 0, 1),
            "permuted.nii.gz",
            origin=points[0, 0, 0],
            direction=np.eye(3)[:, [2, 0, 1]],
        )
    )
    turn = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    turned = groomed(save(mask, "turned.nrrd", origin=turn @ points[0, 0, 0], direction=turn))
    sample = plain.mesh.vertices
    for other, moved in ((flipped, sample), (permuted, sample), (turned, sample @ turn.T)):
        assert np.abs(other.field.sample_values(moved)).max() < 0.01
        assert other.mesh.volume == pytest.approx(plain.mesh.volume, rel=1e-3)


@pytest.mark.parametrize("spacing", [(0.5, 0.5, 0.5), (1.0, 1.0, 1.6), (0.8, 1.2, 1.0), (0.6, 4.0, 0.7)])
def test_spacing_does_not_matter(grid, save, spacing):
    axes = np.array([13.0, 11.0, 9.0])
    points = grid(16.0, spacing)
    mask = ((points / axes) ** 2).sum(axis=-1) < 1.0
    result = groomed(save(mask, spacing=spacing, origin=points[0, 0, 0]))
    assert result.field.spacing == pytest.approx(min(spacing))
    assert result.mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * axes.prod(), rel=0.03)
    assert result.report.genus == 0
    off = np.abs(np.sqrt(((result.mesh.vertices / axes) ** 2).sum(axis=1)) - 1.0) * axes.min()
    assert off.mean() < 0.12 * max(spacing)


def test_a_given_spacing_is_used_finer_and_coarser(sphere_volume):
    path = sphere_volume()
    for spacing in (0.7, 2.0):
        result = groomed(path, spacing=spacing, mesh_edge=0.8)
        assert result.field.spacing == pytest.approx(spacing)
        assert result.mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 8.0**3, rel=0.06)


def test_a_spacing_that_would_fill_the_memory_is_refused(sphere_volume):
    with pytest.raises(InputError, match=r"one: .* grid spacing to 0\.0\d+ mm"):
        groomed(sphere_volume(), spacing=0.01)


def test_a_spacing_larger_than_the_structure_is_refused(sphere_volume):
    with pytest.raises(InputError, match="grid spacing of 60 mm"):
        groomed(sphere_volume(), spacing=60.0)


@pytest.mark.parametrize("spacing", [1.0, 0.05, 5.0])
def test_a_single_voxel_is_no_shape(save, spacing):
    values = np.zeros((9, 8, 7), np.uint8)
    values[4, 4, 3] = 1
    path = save(values, spacing=(spacing,) * 3)
    with pytest.raises(InputError, match=r"a\.nrrd: has only 1 voxel"):
        groom_subject(Subject("s", path), GroomSettings())


@pytest.mark.parametrize("smoothing", [1.0, 3.0])
def test_a_thread_of_voxels_is_refused(save, smoothing):
    values = np.zeros((24, 8, 7), np.uint8)
    values[4:20, 4, 3] = 1
    with pytest.raises(InputError, match="s: is too thin"):
        groom_subject(Subject("s", save(values)), GroomSettings(smoothing=smoothing))


def test_mesh_edges_that_would_fill_the_memory_are_refused(sphere_volume):
    with pytest.raises(InputError, match=r"mesh edges of 0\.001 mm"):
        groomed(sphere_volume(), mesh_edge=0.001)


def test_the_wished_edge_length_is_met(sphere_volume):
    assert groomed(sphere_volume(), mesh_edge=1.2).mesh.mean_edge == pytest.approx(1.2, rel=0.1)


def test_an_adaptive_mesh_is_finer_where_the_surface_bends(grid, save):
    points = grid(20.0)
    mask = ((points / [18.0, 6.0, 6.0]) ** 2).sum(axis=-1) < 1.0
    mesh = groomed(save(mask, origin=points[0, 0, 0]), mesh_edge=1.0, adaptive_mesh=True).mesh
    check_mesh(mesh, "adaptive")
    corners = mesh.vertices[mesh.faces]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    tip = np.abs(corners[..., 0].mean(axis=1)) > 15.0
    assert edge[tip].mean() < 0.8 * edge[~tip].mean()


def test_pieces_cavities_and_the_border_are_reported(grid, save):
    radius = np.linalg.norm(grid(12.0) - [0.1, 0.3, 0.4], axis=-1)
    mask = (radius < 9.0) & (radius > 2.0)
    mask[0, 0, 0] = True
    report = groomed(save(mask[3:])).report
    assert (report.components_dropped, report.holes_filled, report.padded) == (0, 1, False)
    report = groomed(save(mask[5:])).report
    assert (report.components_dropped, report.holes_filled, report.padded) == (0, 1, True)
    report = groomed(save(mask), mesh_edge=0.8).report
    assert (report.components_dropped, report.padded, report.genus) == (1, False, 0)
    assert any("largest of 2" in note for note in report.notes)
    assert report.volume_before == pytest.approx(mask.sum() / 1000.0)
    assert report.volume_after == pytest.approx(4.0 / 3.0 * np.pi * 0.9**3, rel=0.02)


def test_the_share_of_the_volume_that_was_kept_is_noted(grid, save):
    large, small = (np.linalg.norm(grid(16.0) - [x, 0.0, 0.0], axis=-1) for x in (8.0, -8.0))
    (note,) = groomed(save((large < 7.0) | (small < 5.0))).report.notes
    assert float(note.split()[0]) == pytest.approx(100.0 * 7.0**3 / (7.0**3 + 5.0**3), abs=3.0)


def test_a_thread_that_falls_to_pieces_is_refused_on_a_large_grid_too(save):
    steps = np.arange(140)
    mask = np.zeros((140, 140, 140), bool)
    mask[steps, steps, steps] = mask[:3, :3, :3] = True
    with pytest.raises(InputError, match="volume is connected"):
        groomed(save(mask))


def test_a_torus_keeps_its_hole(grid, save):
    points = grid(14.0)
    ring = np.hypot(np.hypot(points[..., 0], points[..., 1]) - 9.0, points[..., 2]) < 3.0
    assert groomed(save(ring)).report.genus == 1


def test_a_mesh_gives_the_same_field_as_the_shape_it_is_of(sphere_volume, tmp_path):
    volume = groomed(sphere_volume(), mesh_edge=0.8)
    write_mesh(tmp_path / "sphere.ply", volume.mesh)
    result = groomed(tmp_path / "sphere.ply", spacing=1.0, mesh_edge=0.8)
    inside_out = TriangleMesh(volume.mesh.vertices, volume.mesh.faces[:, ::-1])
    write_mesh(tmp_path / "inside_out.stl", inside_out)
    turned = groomed(tmp_path / "inside_out.stl", spacing=1.0, mesh_edge=0.8)
    for item in (result, turned):
        assert item.mesh.volume == pytest.approx(volume.mesh.volume, rel=0.025)
        assert np.abs(np.linalg.norm(item.mesh.vertices - [10.0, 20.0, 30.0], axis=1) - 8.0).mean() < 0.2


def test_a_blade_thinner_than_its_triangles_keeps_its_two_walls_whole(tmp_path):
    """A plate of 40 x 30 x 1 mm with edges of 2 mm."""
    import trimesh

    box = trimesh.creation.box((40.0, 30.0, 1.0)).subdivide_to_size(2.0)
    write_mesh(tmp_path / "blade.ply", TriangleMesh(box.vertices, box.faces))
    result = groom_subject(Subject("blade", tmp_path / "blade.ply"), SETTINGS)
    assert result.report.genus == 0
    assert result.report.volume_after == pytest.approx(1.2, rel=0.1)
    for mesh in (result.mesh, result.coarse_mesh):
        assert mesh.volume == pytest.approx(1200.0, rel=0.1)


def test_a_shape_is_not_torn_in_smoothing(grid, save):
    """Two balls joined by a single row of voxels stay in one piece."""
    points = grid(18.0)
    balls = np.minimum(
        np.linalg.norm(points - np.array([9.0, 0.0, 0.0]), axis=-1),
        np.linalg.norm(points + np.array([9.0, 0.0, 0.0]), axis=-1),
    )
    bar = (np.abs(points[..., 1:]).max(axis=-1) < 0.6) & (np.abs(points[..., 0]) < 9.0)
    result = groomed(save((balls < 5.0) | bar), spacing=1.0)
    check_mesh(result.mesh, "dumbbell")
    assert np.ptp(result.mesh.vertices[:, 0]) > 25.0


def test_crumbs_of_a_mesh_are_dropped(sphere_volume, tmp_path):
    mesh = groomed(sphere_volume(), mesh_edge=2.0).mesh
    crumb = TriangleMesh(0.1 * mesh.vertices, mesh.faces)
    both = TriangleMesh(
        np.concatenate([crumb.vertices, mesh.vertices]),
        np.concatenate(
            [crumb.faces, mesh.faces[1:] + len(crumb.vertices), mesh.faces[:1] + len(crumb.vertices)]
        ),
    )
    write_mesh(tmp_path / "both.vtp", both)
    report = groomed(tmp_path / "both.vtp").report
    assert report.components_dropped == 1


@pytest.mark.parametrize("name", ["a.ply", "a.nrrd"])
def test_a_file_that_the_system_does_not_hand_out_is_named(tmp_path, monkeypatch, name):
    (tmp_path / name).write_bytes(b"content")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(InputError, match=rf"{name}: .*Permission denied"):
        groom_subject(Subject("a", tmp_path / name), SETTINGS)


@pytest.mark.parametrize("name", ["a.nii.gz", "a.stl"])
@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "is empty; copy it again"), (b"version https://git-lfs.github.com/spec/v1\noid", "git lfs pull")],
)
def test_what_stands_in_the_place_of_a_file_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: .*{message}"):
        groomed(tmp_path / name)


def test_a_labelled_background_is_refused(save):
    mask = np.ones((12, 12, 12), np.uint8)
    mask[4:8, 4:8, 4:8] = 0
    with pytest.raises(InputError, match=r"background\.nrrd: .* background were labelled"):
        groomed(save(mask, "background.nrrd"))
    mask[:4] = 0
    assert groomed(save(mask, "half.nrrd"), spacing=1.0).report.padded


@pytest.fixture
def write_ball(tmp_path):
    """Write an ellipsoid of few voxels; returns its file and its volume [mm³]."""
    import SimpleITK

    def write(radii, spacing):
        places = np.stack(np.meshgrid(*[np.arange(-9, 10)] * 3, indexing="ij"), axis=-1) * spacing
        mask = np.square(places / radii).sum(axis=-1) < 1.0
        image = SimpleITK.GetImageFromArray(mask.astype(np.uint8).T)
        image.SetSpacing([spacing] * 3)
        SimpleITK.WriteImage(image, str(tmp_path / "ball.nrrd"))
        return tmp_path / "ball.nrrd", float(mask.sum() * spacing**3)

    return write


@pytest.mark.parametrize("radii", [(12.0, 12.0, 40.0), (11.0, 25.0, 45.0), (20.0, 20.0, 20.0)])
def test_a_structure_of_few_voxels_keeps_its_volume(write_ball, radii):
    path, volume = write_ball(radii, 6.0)
    result = groomed(path)
    assert result.mesh.volume == pytest.approx(volume, rel=0.07)
    check_mesh(result.mesh, "ball")


def test_a_surface_that_encloses_much_less_than_the_voxels_gets_a_note(write_ball):
    path, volume = write_ball((30.0, 30.0, 10.0), 6.0)
    result = groomed(path, smoothing=3.0)
    assert result.mesh.volume < 0.9 * volume
    assert "of the structure's volume" in " ".join(result.report.notes)
