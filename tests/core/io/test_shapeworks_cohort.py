"""ShapeWorks projects without particles as cohorts."""

import json

import openpyxl
import pytest

from homolog.errors import InputError
from homolog.io.constraints import cuts_of
from homolog.io.shapeworks import is_shapeworks, read_shapeworks_cohort

ROWS = [
    {"name": "anna", "shape_femur": "in/a.ply", "group_diagnosis": "HC", "age": "61"},
    {"name": "bert", "shape_femur": "in/b.ply", "group_diagnosis": "AD", "age": "70"},
]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a", "b", "c"):
        (tmp_path / "in" / f"{name}.ply").touch()
    return tmp_path


@pytest.mark.parametrize("name", ["study.swproj", "study.xlsx"])
def test_shapes_names_groups_and_columns_are_read(folder, name):
    path = folder / name
    if name.endswith(".swproj"):
        path.write_text(json.dumps({"data": ROWS}))
    else:
        book = openpyxl.Workbook()
        book.active.title = "data"
        for row in (list(ROWS[0]), *(list(row.values()) for row in ROWS)):
            book.active.append(row)
        book.save(path)
    assert is_shapeworks(path)
    assert [
        (item.name, item.path, item.group, dict(item.columns))
        for item in read_shapeworks_cohort(path).subjects
    ] == [
        ("anna", folder / "in" / "a.ply", "HC", {"age": "61"}),
        ("bert", folder / "in" / "b.ply", "AD", {"age": "70"}),
    ]


def test_several_domains_are_structures(folder):
    rows = [row | {"shape_tibia": "in/c.ply"} for row in ROWS]
    (folder / "study.swproj").write_text(json.dumps({"data": rows}))
    first, _ = read_shapeworks_cohort(folder / "study.swproj").subjects
    assert dict(first.structures) == {"femur": folder / "in" / "a.ply", "tibia": folder / "in" / "c.ply"}


def test_constraints_are_cuts_of_each_domain(folder):
    plane = {"planes": [{"points": [[0, 0, 5], [1, 0, 5], [0, 1, 5]]}]}
    (folder / "a.json").write_text(json.dumps(plane))
    single = [ROWS[0] | {"constraints_femur": "a.json"}, ROWS[1] | {"constraints_femur": ""}]
    (folder / "study.swproj").write_text(json.dumps({"data": single}))
    first, second = read_shapeworks_cohort(folder / "study.swproj").subjects
    (cut,) = cuts_of(first)
    assert cut.direction.tolist() == [0.0, 0.0, 1.0]
    assert cut.point[2] == pytest.approx(5.0)
    assert cuts_of(second) == ()
    several = [row | {"shape_tibia": "in/c.ply"} for row in single]
    (folder / "study.swproj").write_text(json.dumps({"data": several}))
    first, _ = read_shapeworks_cohort(folder / "study.swproj").subjects
    assert len(cuts_of(first, "femur")) == 1
    assert cuts_of(first, "tibia") == ()
    (folder / "a.json").write_text('{"spheres": []}')
    with pytest.raises(InputError, match=r"a\.json: has spheres"):
        read_shapeworks_cohort(folder / "study.swproj")


def test_a_shape_that_is_not_there_is_named(folder):
    (folder / "study.swproj").write_text(json.dumps({"data": [ROWS[0] | {"shape_femur": "in/x.ply"}]}))
    with pytest.raises(InputError, match=r"in/x\.ply does not exist"):
        read_shapeworks_cohort(folder / "study.swproj")


def test_a_table_of_subjects_is_no_project(tmp_path):
    book = openpyxl.Workbook()
    book.active.append(["name", "path"])
    book.save(tmp_path / "cohort.xlsx")
    assert not is_shapeworks(tmp_path / "cohort.xlsx")
