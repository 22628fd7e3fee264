"""What a script may give by mistake is refused as an InputError, a ValueError, and never becomes NaN."""

import numpy as np
import pandas
import pytest

import homolog as hl

SHAPES = np.random.default_rng(0).normal(size=(8, 20, 3))
TRIANGLE = [[0, 1, 2]]


@pytest.fixture(scope="module")
def model():
    return hl.ShapeModel().fit(SHAPES)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ("abc", TRIANGLE),
        ([[1, 2], [1]], TRIANGLE),
        (np.eye(3), [[0, 1, 2.5]]),
        (np.eye(3), [[0, 1, np.nan]]),
        (np.eye(3), [["a", "b", "c"]]),
    ],
)
def test_a_mesh_is_made_of_numbers_and_its_faces_of_whole_numbers(vertices, faces):
    with pytest.raises(hl.InputError):
        hl.TriangleMesh(vertices, faces)


def test_whole_numbers_of_any_type_are_faces():
    assert hl.TriangleMesh(np.eye(3, dtype=np.float32), [[0.0, 1.0, 2.0]]).faces.tolist() == TRIANGLE


@pytest.mark.parametrize("deviations", [[np.nan], [np.inf], "a", [[1.0], [1.0, 2.0]]])
def test_no_shape_comes_of_what_is_no_finite_number(model, deviations):
    with pytest.raises(hl.InputError, match="deviations"):
        model.instance(deviations)


def test_scores_are_of_finite_positions(model):
    with pytest.raises(hl.InputError, match="finite"):
        model.transform(np.where(np.arange(20)[:, None] == 3, np.nan, SHAPES[0]))


@pytest.mark.parametrize("count", [-1, 2.5, "3"])
def test_the_number_of_drawn_shapes_is_a_whole_number(model, count):
    with pytest.raises(hl.InputError, match="count"):
        model.sample(count)


def test_numpy_counts_shapes_too(model):
    assert len(model.sample(np.int64(2), random_state=0)) == 2


def test_names_are_one_for_each_subject():
    with pytest.raises(hl.InputError, match="names: 2 given for 8 subjects"):
        hl.ShapeModel().fit(SHAPES, names=["a", "b"])


def test_groups_that_nobody_is_in_are_told_as_that():
    with pytest.raises(hl.InputError, match="groups"):
        hl.compare_groups(SHAPES, [None] * len(SHAPES))


@pytest.mark.parametrize("values", [np.ones((8, 2)), [[1.0], [1.0, 2.0]], "60", 60.0, np.array(60.0)])
def test_a_regression_takes_one_value_for_each_subject(values):
    with pytest.raises(hl.InputError, match="'age'"):
        hl.regress(SHAPES, values, "age")


@pytest.mark.parametrize("other", [(np.eye(3), TRIANGLE), "a.ply", None])
def test_only_a_mesh_is_written_as_one(tmp_path, other):
    with pytest.raises(hl.InputError, match="TriangleMesh"):
        hl.write_mesh(tmp_path / "mesh.ply", other)
    assert not any(tmp_path.iterdir())


def test_a_reference_is_made_of_a_project():
    with pytest.raises(hl.InputError, match="int"):
        hl.make_reference(3)


@pytest.mark.parametrize(
    "call",
    [
        lambda: hl.read_mesh(None),
        lambda: hl.read_cohort(3),
        lambda: hl.Project(3),
        lambda: hl.ShapeModel.load(3),
        lambda: hl.analyze(3),
        lambda: hl.report(None),
    ],
)
def test_a_path_is_a_path(call):
    with pytest.raises(hl.InputError, match="give the path of a file or folder, not"):
        call()


GROUPS = 4 * ["a", "b"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: hl.compare_groups(SHAPES, GROUPS, 3.0), "between=3.0"),
        (lambda: hl.compare_groups(SHAPES, GROUPS, alignment=3), "alignment=3"),
        (lambda: hl.compare_groups(SHAPES, GROUPS, callback=3), "callback"),
        (lambda: hl.compare_groups(SHAPES, GROUPS, random_state="x"), "random_state x"),
        (
            lambda: hl.compare_groups(SHAPES, GROUPS, covariates={"born": np.arange(8).astype("M8[D]")}),
            "'born': must be numbers or texts",
        ),
        (lambda: hl.regress(SHAPES, pandas.DataFrame({"a": range(8), "b": range(8)})), "not DataFrame"),
        (lambda: hl.ShapeModel().fit(SHAPES, names=5), "names"),
        (lambda: hl.read_cohort(".", pattern=3), "pattern"),
        (lambda: hl.geodesic_distances(np.eye(3), TRIANGLE, d_max="far"), "d_max='far'"),
        (lambda: hl.make_reference(".", group=3), "group=3"),
        (lambda: hl.ShapeModel(random_state="x").fit(SHAPES).sample(), "random_state='x'"),
    ],
)
def test_arguments_of_a_wrong_type_are_named(call, message):
    with pytest.raises(hl.InputError, match=message):
        call()


@pytest.mark.parametrize("name", ["seed", "segment", "particle_count"])
def test_a_setting_has_one_name(name):
    with pytest.raises(TypeError, match=name):
        hl.correspond([np.zeros((4, 4, 4), int)] * 2, 16, **{name: 1})


def test_a_mesh_is_written_with_a_value_for_each_vertex(tmp_path):
    mesh = hl.TriangleMesh(np.eye(3), TRIANGLE)
    with pytest.raises(hl.InputError, match="3 vertices"):
        hl.write_mesh(tmp_path / "mesh.vtp", mesh, {"heat": [1.0, 2.0]})
    hl.write_mesh(tmp_path / "mesh.vtp", mesh, {"heat": [1.0, 2.0, 3.0]})
