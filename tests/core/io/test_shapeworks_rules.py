"""What ShapeWorks' own reader demands: its code (``Libs/Project``) refuses to open a project otherwise."""

import json

import numpy as np
import pytest

from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.io.shapeworks import complete_row, escape_column, read_shapeworks_file
from homolog.io.shapeworks_export import write_shapeworks
from homolog.run.import_model import import_model

KINDS = [
    ["segmentation_", "shape_", "mesh_", "contour_"],
    *(
        [item]
        for item in ("groomed_", "landmarks_file_", "constraints_", "local_particles_", "world_particles_")
    ),
    *([item] for item in ("alignment_", "procrustes_")),
]


def domains_as_read(row):
    """Return the anatomies as `ProjectUtils::determine_domain_names` finds them in a row."""
    return [key.removeprefix(item) for key in row for item in KINDS[0] if key.startswith(item)]


def counts_as_read(row, domains):
    """Return how many values of each kind `ProjectUtils::get_values` finds."""
    return [sum(f"{item}{domain}" in row for item in kind for domain in domains) for kind in KINDS]


@pytest.fixture
def two(exported, content):
    """Return a project of two anatomies, of which one lacks what the other has."""
    for number, row in enumerate(content["data"]):
        for key in [item for item in row if item.endswith("_1")]:
            value, start = row.pop(key), key.removesuffix("1")
            if start != "groomed_":
                row[f"{start}left"] = value
            if start not in ("groomed_", "procrustes_"):
                row[f"{start}right"] = value
        if number == 2:
            row["shape_left"] = row.pop("shape_left")  # the other way about
    content["optimize"]["number_of_particles"] = "96 48"
    content["groom"] = {"left": None, "right": {"crop": True}}
    content |= {
        "deepssm": None,
        "analysis": {"groups": 2.0},
        "landmarks": [{"domain": "left", "visible": True}],
    }
    exported.write_text(json.dumps(content), encoding="utf-8")
    return exported


def test_each_kind_of_column_is_there_for_all_anatomies_or_for_none(two, tmp_path):
    project = ProjectFolder(tmp_path / "imported")
    import_model(two, project, domain="right")
    again = json.loads(write_shapeworks(project, tmp_path / "again").read_text())
    for row in again["data"]:
        assert domains_as_read(row) == ["left", "right"]
        assert set(counts_as_read(row, ["left", "right"])) <= {0, 2}
        assert row["groomed_left"] == ""
        assert row["procrustes_right"].split() == [str(item) for item in np.eye(4).ravel()]
        assert (tmp_path / "again" / row["local_particles_left"]).is_file()
    assert again["optimize"]["number_of_particles"] == "96 48"


def test_tables_hold_texts_only_whatever_was_imported(two, tmp_path):
    project = ProjectFolder(tmp_path / "imported")
    import_model(two, project, domain="left")
    again = json.loads(write_shapeworks(project, tmp_path / "again").read_text())
    assert again["groom"] == {"right": {"crop": "true"}}
    assert again["landmarks"] == [{"domain": "left", "visible": "true"}]
    assert (again["deepssm"], again["analysis"]) == ({}, {"groups": "2"})
    assert again["optimize"]["number_of_particles"] == "48 48"


def test_a_subject_that_only_one_anatomy_knows_has_places_for_all():
    row = complete_row({"name": "a", "shape_b": "b.ply", "landmarks_file_b": "b.txt"}, ["a", "b", "c"])
    assert list(row)[:3] == ["shape_a", "shape_b", "shape_c"]
    assert [row[f"landmarks_file_{item}"] for item in "abc"] == ["", "b.txt", ""]
    assert counts_as_read(row, list("abc")) == [3, 0, 3, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    "name", ["shape_volume", "mesh_by", "name2", "fixed", "image_date", "world_particles"]
)
def test_table_data_are_not_taken_for_files_or_flags(name):
    kept = escape_column(name)
    assert kept.endswith(name)
    assert not kept.startswith(("name", *(item for kind in KINDS for item in kind)))
    assert escape_column(kept) == kept
    assert escape_column("age") == "age"
    assert escape_column("group_sex") == "group_sex"


@pytest.mark.parametrize(
    ("path", "name"),
    [("x.y_ED.nrrd", "x.y_ED"), (r"d\s1.nii.gz", "s1"), ("p.1.ply", "p.1"), ("a_local.particles", "a")],
)
def test_a_subject_without_a_name_is_called_by_its_file(exported, content, tmp_path, path, name):
    for number, row in enumerate(content["data"]):
        del row["name"]
        row["shape_1"] = path if number == 0 else f"{number}.{number}.nrrd"
    exported.write_text(json.dumps(content), encoding="utf-8")
    project = ProjectFolder(tmp_path / "imported")
    import_model(exported, project)
    assert read_result(project).names == (name, "1.1", "2.2", "3.3")


def test_the_order_of_anatomies_is_that_of_the_columns(two):
    assert read_shapeworks_file(two).domains == ["left", "right"]


@pytest.mark.parametrize("binary", [False, True])
def test_particles_in_vtk_files_are_read(exported, content, tmp_path, finished_run, binary):
    """ShapeWorks writes either, by a setting."""
    result = read_result(finished_run)
    for row, points in zip(content["data"], result.world, strict=True):
        row["world_particles_1"] = f"{row['name']}.vtk"
        head = (
            f"# vtk DataFile Version 5.1\nvtk output\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n"
        )
        values = (
            points.astype(">f4").tobytes()
            if binary
            else " ".join(f"{point:.6g}" for point in points.ravel()).encode()
        )
        exported.with_name(row["world_particles_1"]).write_bytes(
            f"{head}POINTS {len(points)} float\n".encode() + values + b"\n"
        )
    exported.write_text(json.dumps(content), encoding="utf-8")
    project = ProjectFolder(tmp_path / "imported")
    import_model(exported, project)
    assert np.abs(read_result(project).world - result.world).max() <= 1e-4
