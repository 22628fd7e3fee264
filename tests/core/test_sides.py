"""Left and right, as tables and names say them."""

from pathlib import Path

import pytest

from homolog.cohort import Cohort, Subject, sides_of
from homolog.errors import InputError


def of_files(*names):
    return Cohort(tuple(Subject(name.partition(".")[0], Path(name)) for name in names), Path())


def of_column(*values, column="side"):
    subjects = [
        Subject(f"s{number}", Path(f"s{number}.ply"), columns={column: value})
        for number, value in enumerate(values)
    ]
    return Cohort(tuple(subjects), Path())


@pytest.mark.parametrize("values", [("left", "right"), ("L", "R"), ("Left", "RIGHT"), ("links", "rechts")])
def test_a_column_says_the_sides(values):
    assert list(sides_of(of_column(*values)).of.values()) == ["left", "right"]


def test_the_column_may_be_written_in_any_case():
    assert sides_of(of_column("l", "r", column="Side")).of == {"s0": "left", "s1": "right"}


def test_a_column_may_leave_a_subject_without_a_side():
    assert sides_of(of_column("left", "", "right")).of == {"s0": "left", "s2": "right"}


def test_a_column_with_left_and_something_else_is_refused_by_subject():
    with pytest.raises(InputError, match=r"s1.*medial"):
        sides_of(of_column("left", "medial"))


def test_a_column_about_something_else_says_no_side():
    assert sides_of(of_column("inner", "outer")).of == {}


@pytest.mark.parametrize(
    "names",
    [
        ("m03_L_femur.ply", "n02_R_femur.ply"),
        ("femur-left.nii.gz", "femur-right.nii.gz"),
        ("leftFemur.stl", "rightFemur.stl"),
        ("12L.vtk", "12R.vtk"),
        ("hippocampus_lh.nrrd", "hippocampus_rh.nrrd"),
        ("femur_01_li.nii.gz", "femur_01_re.nii.gz"),
        ("Li_Femur.stl", "Re_Femur.stl"),
        ("sin_01.stl", "dex_01.stl"),
        ("a_sx.stl", "a_dx.stl"),
        ("re01_L.stl", "re01_R.stl"),
        ("sin_L.stl", "dx_R.stl"),
    ],
)
def test_names_of_files_say_the_sides(names):
    assert list(sides_of(of_files(*names)).of.values()) == ["left", "right"]


@pytest.mark.parametrize(
    "names",
    [
        ("a_L.ply", "b.ply", "c_R.ply"),
        ("a_L.ply", "b_L.ply"),
        ("left_right.ply", "a_L.ply", "b_R.ply"),
        ("lara.ply", "rolf.ply"),
        ("li_1.ply", "li_2.ply"),
        ("re_a.ply", "dx_b.ply"),
    ],
)
def test_names_count_only_where_every_one_gives_one_side_and_both_occur(names):
    assert sides_of(of_files(*names)).of == {}


def test_a_column_counts_for_more_than_names():
    subjects = [
        Subject("a_L", Path("a_L.ply"), columns={"side": "right"}),
        Subject("b_R", Path("b_R.ply"), columns={"side": "left"}),
    ]
    assert sides_of(Cohort(tuple(subjects), Path())).of == {"a_L": "right", "b_R": "left"}
