"""Numbers far outside their column, and those declared as missing."""

import pytest

from homolog.cohort import outside_notes, read_cohort

AGES = (31, 36, 44, 51, 55, 60, 66)


def cells(*values):
    return {f"s{number}": str(value) for number, value in enumerate(values)}


@pytest.mark.parametrize("code", ["-999", "999", "-9", "0", "-1", "9999"])
def test_a_code_among_ages_is_named_with_its_subject_and_the_option(code):
    (note,) = outside_notes("age", cells(*AGES, code))
    assert note.startswith(f"age: {code} of s7 lies far outside the other values (31 to 66)")
    assert note.endswith(f"declare it (missing: {code})")


def test_several_codes_on_both_sides_are_named():
    (note,) = outside_notes("age", cells(-999, -999, *AGES, *AGES, 999))
    assert "of s0, s1, s16 lie far outside" in note
    assert note.endswith("(missing: -999, 999)")


@pytest.mark.parametrize(
    "values",
    [
        AGES,
        (0, 1, 1, 0, 1, 0, 1),
        (0, 1, 2, 3, 1, 2, 0, 1),
        (1.2, 0.9, 3.4, 12.0, 2.2, 5.1, 1.4),
        (5,),
        ("a", "b"),
    ],
)
def test_ordinary_columns_get_no_note(values):
    assert outside_notes("x", cells(*values)) == []


def test_a_table_with_a_code_is_noted_and_the_declared_value_is_missing(tmp_path):
    lines = [f"s{number},s{number}.ply,{age}" for number, age in enumerate((*AGES, -999))]
    (tmp_path / "cohort.csv").write_text("\n".join(["name,path,age", *lines]))
    assert [note for note in read_cohort(tmp_path).notes if "-999 of s7" in note]
    declared = read_cohort(tmp_path, missing=["-999"])
    assert (declared.subjects[7].columns["age"], declared.notes) == ("", ())
