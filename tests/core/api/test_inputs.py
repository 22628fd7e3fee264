"""What other libraries hold becomes the same shapes, columns and tables; what is none of them is refused."""

import meshio
import nibabel
import numpy as np
import pandas
import pytest
import pyvista
import SimpleITK
import trimesh

import homolog as hl
from homolog.api.inputs import as_mesh, cohort_of, columns_of
from homolog.settings import GroomSettings

SHAPES = np.random.default_rng(0).normal(size=(8, 20, 3))
GROUPS = 4 * ["a", "b"]


def box():
    """Return a box of 2 x 3 x 4 mm as hexahedra."""
    return pyvista.ImageData(dimensions=(3, 4, 5)).cast_to_unstructured_grid()


@pytest.mark.parametrize(
    "shape",
    [
        box(),
        box().extract_surface(algorithm="dataset_surface"),
        box().triangulate(),  # tetrahedra
        pyvista.to_meshio(box()),
        meshio.Mesh(
            *(lambda mesh: (mesh.vertices, [("triangle", mesh.faces)]))(trimesh.creation.box((2, 3, 4)))
        ),
        trimesh.Scene(trimesh.creation.box((2, 3, 4))),
    ],
    ids=["hexahedra", "polygons", "tetrahedra", "meshio hexahedra", "meshio triangles", "trimesh scene"],
)
def test_a_surface_comes_of_meshes_and_of_volume_cells_of_any_library(shape):
    mesh = as_mesh(shape)
    assert abs(mesh.volume) == pytest.approx(24.0)
    assert mesh.area == pytest.approx(52.0)


def test_vtk_itself_is_read_as_pyvista_is():
    from vtkmodules.vtkFiltersSources import vtkSphereSource

    source = vtkSphereSource()
    source.Update()
    assert as_mesh(source.GetOutput()).area == pytest.approx(pyvista.wrap(source.GetOutput()).area, rel=1e-5)


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        (pyvista.PolyData(), "not a surface with points"),
        (pyvista.ImageData(dimensions=(3, 3, 3)), "ImageData is not a surface"),
        (meshio.Mesh(np.eye(3), [("VTK_LAGRANGE_TRIANGLE", [[0, 1, 2]])]), "VTK_LAGRANGE_TRIANGLE"),
        ([[1.0, 2.0], [3.0], [4.0]], "not a shape; give"),
        ({"a": 1}, "not a shape; give"),
    ],
)
def test_what_is_no_surface_is_refused_with_what_is(shape, reason):
    with pytest.raises(hl.InputError, match=f"first: .*{reason}"):
        cohort_of({"first": shape}, None, GroomSettings())


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("micron", 0.001)])
def test_an_image_of_nibabel_lies_where_that_of_simpleitk_lies(tmp_path, unit, scale):
    labels = np.zeros((7, 8, 9, 1), np.uint8)
    labels[2:5, 2:6, 2:7] = 1
    affine = np.array([[0, -1.5, 0, 4], [1.2, 0, 0, -3], [0, 0, 2, 1], [0, 0, 0, 1]])
    image = nibabel.Nifti1Image(labels, affine)
    image.header.set_xyzt_units(unit)
    nibabel.save(nibabel.Nifti1Image(labels[..., 0], affine), tmp_path / "a.nii")
    shapes = {"a": SimpleITK.ReadImage(tmp_path / "a.nii"), "b": image}
    _, sources = cohort_of(shapes, None, GroomSettings())
    expected, found = sources["a"], sources["b"]
    np.testing.assert_array_equal(found.mask, expected.mask)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-6)
    for name in ("spacing", "origin"):
        np.testing.assert_allclose(getattr(found, name), scale * getattr(expected, name), rtol=1e-6)


def test_groups_and_covariates_are_taken_from_pandas():
    ages = pandas.Series([50, 61, 52, 63, 54, 65, None, 67], dtype="Int64")
    given = {"modes": 2, "permutations": 99, "alignment": "form", "complete_cases": True}
    expected = hl.compare_groups(
        SHAPES, GROUPS, covariates={"age": [50, 61, 52, 63, 54, 65, None, 67]}, **given
    )
    frame = pandas.DataFrame({"age": ages})
    found = hl.compare_groups(SHAPES, pandas.Series(GROUPS, dtype="category"), covariates=frame, **given)
    np.testing.assert_array_equal(found.p_fwe, expected.p_fwe)
    assert found.notes == expected.notes
    found = hl.compare_groups(SHAPES, pandas.Categorical(GROUPS), covariates=frame, **given)
    np.testing.assert_array_equal(found.p_fwe, expected.p_fwe)


def test_rows_that_have_names_are_matched_by_them():
    names = ["s1", "s2", "s3"]
    table = pandas.DataFrame({"age": [3, 1, 2, 9]}, index=["s3", "s1", "s2", "s9"])
    assert columns_of(table, names) == {"age": [1, 2, 3]}
    assert columns_of(table.reset_index(drop=True)) == {"age": [3, 1, 2, 9]}
    with pytest.raises(hl.InputError, match="s4"):
        columns_of(table, [*names, "s4"])


@pytest.mark.parametrize(
    "given",
    [
        {"groups": 5},
        {"groups": "abababab"},
        {"covariates": 5},
        {"covariates": [1, 2]},
        {"covariates": pandas.Series(range(8))},
        {"covariates": {"age": 5}},
        {"between": "ab"},
        {"pairs": 7},
    ],
)
def test_arguments_of_a_wrong_type_are_named(given):
    with pytest.raises(hl.InputError, match=next(iter(given))):
        hl.compare_groups(SHAPES, **({"groups": GROUPS} | given))


def test_a_comparison_is_a_table_a_drawing_and_a_page():
    answer = hl.compare_groups(SHAPES, GROUPS, modes=2, permutations=99, alignment="form")
    table = answer.to_dataframe()
    assert table.index.name == "particle"
    np.testing.assert_array_equal(table[["effect_x", "effect_y", "effect_z"]], answer.pointwise.effect[0])
    np.testing.assert_array_equal(answer.to_pyvista()["p_fwe"], answer.p_fwe)
    assert "Comparison(b - a" in answer._repr_html_()
    terms = hl.compare(SHAPES, "~ group", {"group": GROUPS}, permutations=99).to_dataframe()
    assert "group" in terms["term"].to_list()


def test_a_model_is_a_table_of_its_modes():
    model = hl.ShapeModel(3).fit(SHAPES)
    table = model.to_dataframe()
    np.testing.assert_array_equal(table["explained_variance"], model.explained_variance_)
    assert "<table" in model._repr_html_()
    assert hl.ShapeModel(3)._repr_html_() == "<p>ShapeModel(n_components=3)</p>"


def test_geodesic_distances_take_a_surface_of_any_library_or_a_file_closed_or_open(tmp_path):
    vertices = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    wanted = hl.geodesic_distances(vertices, faces, 10.0, device="cpu").toarray()
    assert wanted[1, 3] == pytest.approx(np.sqrt(5.0), rel=1e-3)
    open_mesh = trimesh.Trimesh(vertices, faces, process=False)
    wrapped = pyvista.wrap(open_mesh)
    open_mesh.export(tmp_path / "sheet.ply")
    vtk = wrapped.copy().cast_to_unstructured_grid()
    forms = [
        (vertices, faces),
        hl.TriangleMesh(vertices, faces),
        open_mesh,
        wrapped,
        vtk,
        pyvista.to_meshio(wrapped),
        tmp_path / "sheet.ply",
        str(tmp_path / "sheet.ply"),
    ]
    for form in forms:
        distances = hl.geodesic_distances(form, d_max=10.0, device="cpu").toarray()
        np.testing.assert_allclose(distances, wanted, atol=1e-3)
    for wrong in (open_mesh, vertices):
        with pytest.raises(hl.InputError, match="as d_max"):
            hl.geodesic_distances(wrong, 10.0)
