"""Correspondence of shapes in memory: the same as that of a run, whatever the shapes come in."""

import numpy as np
import pytest
import pyvista
import SimpleITK
import trimesh
from scipy.spatial.transform import Rotation

import homolog as hl
from homolog.api.correspond import run_settings
from homolog.api.inputs import as_mesh, cohort_of
from homolog.cohort import MESH_SUFFIXES
from homolog.io.images import read_segmentation
from homolog.io.project import ProjectFolder
from homolog.run import Run
from homolog.settings import GroomSettings
from homolog.surfaces.closest import distances_to

SHORT = {
    "alignment": "center",
    "mesh_edge": 2.0,
    "split_iterations": 5,
    "anneal_iterations": 20,
    "settle_iterations": 20,
}  # the settings of the finished run


@pytest.fixture(scope="module")
def labels(ellipsoids):
    """Return the ellipsoids' label arrays, with the matrices of their images, by name."""
    images = {path.stem: SimpleITK.ReadImage(path) for path in sorted(ellipsoids.glob("*.nrrd"))}
    matrices = {name: np.diag([*image.GetSpacing(), 1.0]) for name, image in images.items()}
    for name, item in images.items():
        matrices[name][:3, 3] = item.GetOrigin()
    return {name: (SimpleITK.GetArrayFromImage(image).T, matrices[name]) for name, image in images.items()}


@pytest.fixture(scope="module")
def result(labels):
    """Return their correspondence; not to be changed."""
    return hl.correspond(labels, 48, device="cpu", **SHORT)


@pytest.fixture
def ball():
    """Return a mesh of trimesh."""
    return trimesh.creation.icosphere(subdivisions=2, radius=10.0)


def test_a_core_set_in_memory_gives_the_particles_of_a_run_in_a_folder(labels, ellipsoids, tmp_path):
    result = hl.correspond(labels, 48, device="cpu", core_set=3, **SHORT)
    settings = run_settings({**SHORT, "core_set": 3}, 48, "cpu", 1)
    Run(ProjectFolder(tmp_path / "project"), hl.read_cohort(ellipsoids), settings).execute()
    project = hl.Project(tmp_path / "project")
    np.testing.assert_array_equal(result.particles, project.particles)
    np.testing.assert_allclose(result.aligned, project.aligned, atol=1e-9)
    again = result.save(tmp_path / "saved")
    np.testing.assert_array_equal(again.particles, result.particles)
    assert [len(mesh.vertices) for mesh in again.meshes] == [len(mesh.vertices) for mesh in project.meshes]


def test_arrays_get_the_particles_of_a_run_of_their_files(result, finished_run):
    project = hl.Project(finished_run.folder)
    assert result.names == project.names == ("a", "b", "c", "d")
    np.testing.assert_array_equal(result.particles, project.particles)
    np.testing.assert_array_equal(result.aligned, project.aligned)
    np.testing.assert_array_equal(result.alignments, project.alignments)
    assert result.converged == project.converged
    assert result.notes == project.notes
    for own, kept in zip(result.meshes, project.meshes, strict=True):
        np.testing.assert_array_equal(own.vertices, kept.vertices)


def test_particles_lie_on_the_surfaces_in_each_subjects_own_frame(result):
    for particles, mesh in zip(result.particles, result.meshes, strict=True):  # of 2 mm edges, 1 mm voxels
        assert distances_to(mesh, particles).max() < 0.5
    moved = np.einsum("mij,mnj->mni", result.alignments[:, :3, :3], result.particles)
    np.testing.assert_allclose(moved + result.alignments[:, None, :3, 3], result.aligned, atol=1e-9)


def test_a_saved_correspondence_is_a_project_that_runs_add_to(result, tmp_path, short_settings):
    project = result.save(tmp_path / "project")
    np.testing.assert_array_equal(project.aligned, result.aligned)
    np.testing.assert_allclose(project.surface().vertices, result.surface().vertices, atol=1e-9)
    more = short_settings.model_copy(
        update={"optimize": project.settings.optimize.model_copy(update={"particles": 96})}
    )
    folder = ProjectFolder(tmp_path / "project")
    Run(folder, folder.cohort(), more, from_result=True).execute()
    assert hl.Project(folder.folder).particles.shape == (4, 96, 3)


def test_a_correspondence_and_its_project_have_the_same_verdict(result, tmp_path):
    saved = result.save(tmp_path / "project").verdict
    assert (saved.word, saved.reproducible, saved.landmark) == (
        result.verdict.word,
        result.verdict.reproducible,
        result.verdict.landmark,
    )
    assert saved.surface == pytest.approx(result.verdict.surface, rel=1e-3)


def test_nothing_is_saved_among_other_files(result, tmp_path):
    (tmp_path / "thesis.txt").write_text("x")
    with pytest.raises(hl.InputError, match="other files"):
        result.save(tmp_path)
    assert len(list(tmp_path.iterdir())) == 1


def test_groups_and_covariates_are_those_of_the_cohorts_table(ellipsoids, tmp_path):
    rows = [
        f"{name},{ellipsoids / name}.nrrd,{group},{age}"
        for name, group, age in (("a", "x", 50), ("b", "y", 61), ("c", "x", ""))
    ]
    (tmp_path / "cohort.csv").write_text("\n".join(["name,path,group,age", *rows]))
    result = hl.correspond(hl.read_cohort(tmp_path / "cohort.csv"), 32, device="cpu", **SHORT)
    assert (result.names, result.groups) == (("a", "b", "c"), ("x", "y", "x"))
    assert result.covariates == {"age": ("50", "61", "")}
    saved = result.save(tmp_path / "project")
    assert (saved.groups, saved.covariates) == (result.groups, result.covariates)
    assert ProjectFolder(saved.folder).cohort().subjects[1].path == (ellipsoids / "b.nrrd").resolve()


def test_progress_grows_to_one_and_an_error_in_the_callback_stops(labels):
    messages = []

    def stop_at_half(fraction, message):
        messages.append((fraction, message))
        if fraction > 0.5:
            raise hl.Cancelled("stopped")

    with pytest.raises(hl.Cancelled, match="stopped"):
        hl.correspond(labels, 48, callback=stop_at_half, **SHORT)
    fractions = [fraction for fraction, _ in messages]
    assert fractions == sorted(fractions)
    assert all(message for _, message in messages)


@pytest.mark.parametrize("kind", ["TriangleMesh", "trimesh", "pyvista", "quads", "pair", "lists"])
def test_meshes_of_any_library_are_taken(ball, kind):
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    shape = {
        "TriangleMesh": lambda: hl.TriangleMesh(vertices, faces),
        "trimesh": lambda: ball,
        "pyvista": lambda: pyvista.PolyData.from_regular_faces(vertices, faces),
        "quads": lambda: pyvista.Cube(),
        "pair": lambda: (vertices, faces),
        "lists": lambda: (vertices.tolist(), faces.tolist()),
    }[kind]()
    mesh = as_mesh(shape)
    expected = 1.0 if kind == "quads" else ball.volume
    assert mesh.volume == pytest.approx(expected, rel=1e-6)


def test_label_arrays_lie_where_their_voxel_size_or_matrix_says():
    array = np.zeros((8, 6, 5), bool)
    array[2:6, 2:5, 1:4] = True
    _, by_size = cohort_of([array], (1.0, 2.0, 3.0), GroomSettings())
    matrix = np.diag([1.0, 2.0, 3.0, 1.0])
    matrix[:3, 3] = 7.0
    _, by_matrix = cohort_of([(array, matrix)], None, GroomSettings())
    assert by_size["shape_1"].volume == by_matrix["shape_1"].volume == 36 * 6.0
    np.testing.assert_allclose(by_matrix["shape_1"].origin - by_size["shape_1"].origin, 7.0)


def test_an_image_of_simpleitk_lies_as_its_file_does(tmp_path):
    image = SimpleITK.GetImageFromArray(np.pad(np.ones((4, 5, 6), np.uint8), 2))
    image.SetSpacing((1.0, 0.5, 2.0))
    image.SetOrigin((3.0, -7.0, 11.0))
    image.SetDirection(Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix().ravel())
    SimpleITK.WriteImage(image, tmp_path / "image.nrrd")
    _, sources = cohort_of([image], None, GroomSettings())
    of_file = read_segmentation(tmp_path / "image.nrrd", None)
    for part in ("mask", "rotation", "spacing", "origin"):
        np.testing.assert_allclose(getattr(sources["shape_1"], part), getattr(of_file, part), atol=1e-6)


def test_one_label_of_several_is_taken():
    array = np.zeros((9, 9, 9), np.int16)
    array[1:4, 1:8, 1:8], array[5:7, 1:8, 1:8] = 2, 5
    _, sources = cohort_of({"x": array}, 1.0, GroomSettings(label=5))
    assert sources["x"].volume == 2 * 49.0


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_files_are_called_by_their_stem(tmp_path, suffix):
    cohort, sources = cohort_of([tmp_path / f"one.two{suffix}"], None, GroomSettings())
    assert (cohort.subjects[0].name, sources) == ("one.two", {})


BOX = np.ones((4, 4, 4))


@pytest.mark.parametrize(
    ("shapes", "fault"),
    [
        ([BOX, BOX], r"shape_1: .*voxel_size"),
        ([(BOX, np.eye(3))], r"shape_1: the matrix .* must be \(4, 4\)"),
        ([None], "shape_1: NoneType is not a shape; give a path, a TriangleMesh"),
        ([(np.zeros((3, 2)), [[0, 1, 2]])], r"shape_1: a mesh needs vertices \(V, 3\)"),
        ([(np.zeros((3, 3)), [[0, 1, 3]])], "shape_1: faces refer to vertices"),
        ([(np.full((3, 3), np.nan), [[0, 1, 2]])], "shape_1: vertices are not finite"),
        ([(np.zeros((3, 3)), [[0.0, 1.0, 2.0]])], "shape_1: faces must be integers"),
        (["x/a.stl", "y/a.stl"], "several shapes are named a"),
        (3, "int is not a cohort"),
    ],
)
def test_what_is_no_shape_is_refused_by_name(shapes, fault):
    with pytest.raises(hl.InputError, match=fault):
        cohort_of(shapes, None, GroomSettings())


def test_all_bad_shapes_are_named_at_once(ball, tmp_path):
    flat = (np.asarray(ball.vertices) * [1.0, 1.0, 0.0], np.asarray(ball.faces))
    with pytest.raises(hl.InputError, match=r"(?s)flat: .*missing\.stl: "):
        hl.correspond({"flat": flat, "sound": ball, "gone": tmp_path / "missing.stl"}, 32)


def test_a_single_shape_has_no_correspondence(ball):
    with pytest.raises(hl.InputError, match=r"two or more shapes, not 1"):
        hl.correspond([ball], 32)


def test_settings_that_can_not_be_are_named(ball):
    with pytest.raises(TypeError, match="unexpected keyword argument 'alignement'"):
        hl.correspond([ball, ball], 32, alignement="icp")
    with pytest.raises(hl.InputError, match=r"(?s)smoothing=-1\.0: .*n_particles=2: "):
        hl.correspond([ball, ball], 2, smoothing=-1.0)


def test_a_result_is_a_table_a_drawing_and_a_page(result):
    table = result.to_dataframe()
    assert table.index.to_list() == list(result.names)
    np.testing.assert_allclose(table["size"], result.sizes)
    drawn = result.to_pyvista()
    assert drawn.keys() == list(result.names)
    np.testing.assert_allclose(
        drawn[0].points, result.meshes[0].placed(result.alignments[0]).vertices, atol=1e-4
    )
    assert all(name in result._repr_html_() for name in result.names[:2])


def test_a_structure_is_chosen_by_value_or_name_and_a_random_state_is_a_seed():
    assert run_settings({"label": "left femur"}, 64, "cpu", 1).groom.segment == "left femur"
    assert run_settings({"label": 3}, 64, "cpu", 1).groom.label == 3
    assert run_settings({"random_state": 7}, 64, "cpu", 1).optimize.seed == 7
    with pytest.raises(hl.InputError, match="random_state="):
        run_settings({"random_state": "seven"}, 64, "cpu", 1)
