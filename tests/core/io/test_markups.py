import json

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.markups import read_markups, write_markups


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.mrk.json"


def file_of(path, **changed):
    point = {"label": "apex", "position": [1.0, 2.0, 3.0]}
    markup = {"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": [point]} | changed
    path.write_text(json.dumps({"markups": [markup]}), encoding="utf-8")
    return path


def test_what_is_written_is_read_again_to_the_last_digit(path):
    points = np.random.default_rng(0).normal(scale=300.0, size=(20, 3))
    write_markups(path, points, [f"point {number}" for number in range(20)])
    again = read_markups(path)
    assert np.array_equal(again.points, points)
    assert again.names[7] == "point 7"


def test_particles_are_called_by_their_numbers_and_marked_lps(path):
    write_markups(path, np.eye(3))
    markup = json.loads(path.read_text())["markups"][0]
    assert markup["coordinateSystem"] == "LPS"
    assert [item["label"] for item in markup["controlPoints"]] == ["0", "1", "2"]


@pytest.mark.parametrize("space", ["RAS", "ras", "0"])
def test_ras_points_are_turned(path, space):
    assert read_markups(file_of(path, coordinateSystem=space)).points.tolist() == [[-1.0, -2.0, 3.0]]


def test_points_that_were_never_placed_are_left_out(path):
    placed = {"label": "a", "position": [1, 2, 3], "positionStatus": "defined"}
    waiting = {"label": "b", "position": [0, 0, 0], "positionStatus": "undefined"}
    assert read_markups(file_of(path, controlPoints=[placed, waiting])).names == ("a",)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"controlPoints": []}, "contains no"),
        ({"controlPoints": [{"label": "a", "position": [1, 2]}]}, "point a has no position"),
        ({"controlPoints": [{"label": "a", "position": [1, 2, "x"]}]}, "point a has no position"),
        ({"controlPoints": [{"label": "a", "position": [1, 2, 1e999]}]}, "point a has no position"),
        ({"controlPoints": [3]}, "no position"),
        ({"controlPoints": [{"label": "a", "position": [1, 2, 3]}] * 2}, "several points are named a"),
        ({"coordinateSystem": "IJK"}, "neither LPS nor RAS"),
        ({"coordinateUnits": "um"}, "unit is not mm"),
    ],
)
def test_a_faulty_file_is_named_with_the_fault(path, changed, message):
    with pytest.raises(InputError, match=message) as caught:
        read_markups(file_of(path, **changed))
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '{"markups": 3}', '{"markups": [1, 2]}', "[" * 100000]
)
def test_what_is_no_markups_file_is_refused(path, text):
    path.write_text(text)
    with pytest.raises(InputError, match=r"a\.mrk\.json"):
        read_markups(path)


OLD = """# Markups fiducial file version = 4.11
# CoordinateSystem = {axes}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
vtkMRMLMarkupsFiducialNode_0,1.5,-2,3,0,0,0,1,1,1,0,apex,,
vtkMRMLMarkupsFiducialNode_1,4,5,6,0,0,0,1,1,1,0,"base, left",,
"""


@pytest.mark.parametrize(
    ("axes", "first"), [("LPS", [1.5, -2, 3]), ("RAS", [-1.5, 2, 3]), ("0", [-1.5, 2, 3])]
)
def test_a_list_of_an_older_slicer_is_read(tmp_path, axes, first):
    (tmp_path / "a.fcsv").write_text(OLD.format(axes=axes))
    markups = read_markups(tmp_path / "a.fcsv")
    assert markups.names == ("apex", "base, left")
    assert markups.points[0].tolist() == first


def test_a_list_that_does_not_say_its_axes_is_in_those_of_its_time(tmp_path):
    (tmp_path / "a.fcsv").write_text("# columns = label,x,y,z,sel,vis\napex,1,2,3,1,1\n")
    assert read_markups(tmp_path / "a.fcsv").points.tolist() == [[-1.0, -2.0, 3.0]]


@pytest.mark.parametrize(
    "text",
    ["", OLD.format(axes="XYZ"), "# columns = label,x,y\na,1,2\n", "a,b,c,d\n", f"a,{'1' * 200_000}\n"],
)
def test_a_faulty_list_of_an_older_slicer_is_refused(tmp_path, text):
    (tmp_path / "a.fcsv").write_text(text)
    with pytest.raises(InputError, match=r"a\.fcsv"):
        read_markups(tmp_path / "a.fcsv")
