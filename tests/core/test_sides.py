"""Left and right, as a column says them."""

from pathlib import Path

import pytest

from homolog.cohort import Cohort, Subject, sides_of
from homolog.errors import InputError


def of_column(*values, column="side"):
    subjects = [
        Subject(f"s{number}", Path(f"s{number}.ply"), columns={column: value})
        for number, value in enumerate(values)
    ]
    return Cohort(tuple(subjects), Path())


@pytest.mark.parametrize("values", [("left", "right"), ("L", "R"), ("Left", "RIGHT"), ("lh", "RH")])
def test_a_column_says_the_sides(values):
    assert list(sides_of(of_column(*values)).values()) == ["left", "right"]


def test_the_column_may_be_written_in_any_case():
    assert sides_of(of_column("l", "r", column="Side")) == {"s0": "left", "s1": "right"}


def test_a_column_may_leave_a_subject_without_a_side():
    assert sides_of(of_column("left", "", "right")) == {"s0": "left", "s2": "right"}


def test_a_column_with_left_and_something_else_is_refused_by_subject():
    with pytest.raises(InputError, match=r"s1.*medial"):
        sides_of(of_column("left", "medial"))


def test_a_column_about_something_else_says_no_side():
    assert sides_of(of_column("inner", "outer")) == {}


def test_names_of_files_say_no_side():
    names = ("m03_L_femur", "n02_R_femur")
    assert sides_of(Cohort(tuple(Subject(name, Path(f"{name}.ply")) for name in names), Path())) == {}
