"""Groups and covariates from tables, for subjects that are known."""

from pathlib import Path

import openpyxl
import pytest

from homolog.cohort import Subject, with_table
from homolog.errors import InputError

SUBJECTS = (
    Subject("p01_ED", Path("scans/p01_ED.nii.gz"), "DCM", {"age": "61"}),
    Subject("p02_ED", Path("scans/p02_ED.nii.gz")),
    Subject("p10_ED", Path("scans/heart10.nii.gz"), "NOR"),
)


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a table of some text for the subjects."""

    def changes(text, name="table.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return with_table(SUBJECTS, path)

    return changes


def test_new_columns_and_groups_are_added_and_replaced(read):
    cohort = read("name,group,age,sex\np01_ED,HCM,62,F\np02_ED,NOR,48,M\n")
    assert [subject.group for subject in cohort.subjects] == ["HCM", "NOR", "NOR"]
    assert cohort.subjects[0].columns == {"age": "62", "sex": "F"}
    assert cohort.added == {"group": 1, "age": 1, "sex": 2}
    assert [(item.column, item.before, item.after) for item in cohort.replaced] == [
        ("group", "DCM", "HCM"),
        ("age", "61", "62"),
    ]


def test_any_column_may_name_the_subjects_or_their_files(read):
    result = read("Alter;Kennung;group\n62,5;p01_ED;krank\n")
    assert (result.subjects[0].group, result.subjects[0].columns) == ("krank", {"age": "61", "Alter": "62,5"})
    result = read("Kennung;Datei;group\nProband 1;heart10.nii.gz;krank\n")
    assert (result.matched, result.subjects[2].group) == (("p10_ED",), "krank")


def test_a_row_of_types_declares_categories_and_checks_numbers(read):
    cohort = read("name,age,site\ntype,number,category\np01_ED,62,1\np02_ED,NA,2\n")
    assert cohort.subjects[0].columns == {"age": "62", "site:c": "1"}
    assert cohort.unknown == ()
    for text in ("name,age\ntype,number\np01_ED,62 y\n", "name,age,site\ntype,number,place\np01_ED,62,1\n"):
        with pytest.raises(InputError, match=r"line 3.*'62 y'.*age|line 2.*'place'.*site"):
            read(text)


def test_a_column_that_is_there_is_declared_without_becoming_two(read, tmp_path):
    (tmp_path / "again.csv").write_text("name,age\np02_ED,56\n", encoding="utf-8")
    cohort = read("name,age\ntype,category\np02_ED,55\n")
    assert [subject.columns for subject in cohort.subjects] == [{"age:c": "61"}, {"age:c": "55"}, {}]
    assert cohort.added == {"age:c": 2}
    again = with_table(cohort.subjects, tmp_path / "again.csv")
    assert again.subjects[1].columns == {"age:c": "56"}


def test_a_subject_may_be_called_type(tmp_path):
    (tmp_path / "table.csv").write_text("name,sex\ntype,F\n", encoding="utf-8")
    cohort = with_table([Subject("type", Path("type.nrrd"))], tmp_path / "table.csv")
    assert cohort.subjects[0].columns == {"sex": "F"}


def test_rows_and_subjects_without_the_other_are_told(read):
    cohort = read("name,sex\np01_ED,F\nstranger,M\n")
    assert (cohort.matched, cohort.without_row, cohort.unknown) == (
        ("p01_ED",),
        ("p02_ED", "p10_ED"),
        ("stranger",),
    )
    assert any("stranger" in line for line in cohort.lines)


@pytest.mark.parametrize(
    "said", ["p10_ED", "P10_ed", "p10", "p10_ED.nii.gz", "heart10", "heart10.nii.gz", "/data/heart10.nii.gz"]
)
def test_a_row_names_its_subject_in_many_ways(read, said):
    assert read(f"id,sex\n{said},F\n").matched == ("p10_ED",)


def test_a_beginning_that_two_subjects_share_names_neither(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("name,sex\np1,F\nq,M\n", encoding="utf-8")
    pair = [Subject(name, Path(f"{name}.ply")) for name in ("p1_a", "p1_b", "q")]
    assert with_table(pair, table).unknown == ("p1",)


def test_a_row_of_a_person_is_of_all_scans_that_have_none_of_their_own(tmp_path):
    table = tmp_path / "table.csv"
    names = ("anna_ED", "anna_ES")
    scans = [Subject(name, Path(f"{name}.ply"), columns={"subject": "anna"}) for name in names]
    subjects = [*scans, Subject("anna9_ED", Path("anna9.ply"))]
    table.write_text("name,age,note\nanna,61,\n", encoding="utf-8")
    assert with_table(subjects, table).matched == names
    table.write_text("name,age\nanna,61\nanna_ES,62\n", encoding="utf-8")
    result = with_table(subjects, table).subjects
    assert [subject.columns.get("age") for subject in result] == ["61", "62", None]


def test_a_value_declared_as_missing_leaves_the_cell_empty_also_where_it_was_read_before(read, tmp_path):
    (tmp_path / "table.csv").write_text("name,age,dose\np01_ED,-999,1\np02_ED,48,-999.0\n", encoding="utf-8")
    before = with_table(SUBJECTS, tmp_path / "table.csv").subjects
    changes = with_table(before, tmp_path / "table.csv", ["-999"])
    assert [subject.columns.get("age") for subject in changes.subjects] == ["", "48", None]
    assert changes.subjects[1].columns["dose"] == ""
    assert ("p01_ED", "-999", "missing") in [
        (item.subject, item.before, item.after) for item in changes.replaced
    ]


def test_the_column_that_fits_most_subjects_names_them(read):
    cohort = read("name,id,sex\nJane,p01,F\nJohn,p02,M\n")
    assert (cohort.key, len(cohort.matched)) == ("id", 2)
    assert cohort.subjects[0].columns["name"] == "Jane"


def test_paths_are_left_alone_and_may_name_the_subjects(read):
    cohort = read("path,sex\nelsewhere/heart10.nii.gz,F\n")
    assert cohort.subjects[2].path == SUBJECTS[2].path
    assert cohort.subjects[2].columns == {"sex": "F"}


def test_an_empty_cell_leaves_what_is_there(read):
    cohort = read("name,group,age\np01_ED,,\n")
    assert (cohort.subjects[0].group, cohort.subjects[0].columns["age"]) == ("DCM", "61")
    assert cohort.is_empty


def test_columns_that_differ_in_case_only_are_one(read):
    cohort = read("Subject,Group,Age\np01_ED,HCM,62\n")
    assert cohort.subjects[0].group == "HCM"
    assert cohort.subjects[0].columns == {"age": "62"}


@pytest.mark.parametrize("separator", [";", "\t", ","])
def test_any_separator_will_do(read, separator):
    text = "name,sex\np01_ED,F\n".replace(",", separator)
    assert read(text, "table.tsv").added == {"sex": 1}


def test_a_workbook_is_read_with_its_numbers(tmp_path):
    book = openpyxl.Workbook()
    for row in (["ID", "age", "dose"], ["p01", 62, 0.5], [None, None, None], ["p02", 48.0, 1]):
        book.active.append(row)
    book.save(tmp_path / "table.xlsx")
    cohort = with_table(SUBJECTS, tmp_path / "table.xlsx")
    assert [subject.columns.get("age") for subject in cohort.subjects] == ["62", "48", None]
    assert cohort.subjects[0].columns["dose"] == "0.5"


def test_a_file_that_is_no_workbook_is_refused_by_name(tmp_path):
    (tmp_path / "table.xlsx").write_text("name,sex\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"table\.xlsx"):
        with_table(SUBJECTS, tmp_path / "table.xlsx")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,sex\nx,F\n", "names none"),
        ("name,sex\np01,F\np01_ED,M\n", "several rows of p01_ED"),
        ("name,sex\n", "no rows"),
    ],
)
def test_tables_that_can_not_be_used_say_why(read, text, message):
    with pytest.raises(InputError, match=message):
        read(text)


def test_numbers_without_leading_zeros_name_subjects_if_all_are_the_same(read):
    changes = read("ID;group\n10;a\n1;b\n2;a\n")
    assert [subject.group for subject in changes.subjects] == ["b", "a", "a"]
    assert any("matched by number: 10 is p10_ED" in note for note in changes.notes)


@pytest.mark.parametrize("ids", [(1, 2, 3), (1, 2, 10, 11), (1, 1, 2, 10)])
def test_numbers_that_differ_from_those_in_the_names_name_nobody(read, ids):
    with pytest.raises(InputError, match="names none of the subjects"):
        read("\n".join(["id,group", *(f"{number},a" for number in ids)]))


def test_a_first_column_that_only_counts_rows_names_nobody(read):
    with pytest.raises(InputError, match="names none of the subjects"):
        read("Nr,group\n1,a\n2,b\n10,c\n")


def test_a_side_that_is_added_later_is_said_to_apply_from_the_next_run_on(read):
    assert any("next run" in line for line in read("name,side\np01_ED,left\np02_ED,right\n").lines)
    assert not any("next run" in line for line in read("name,age\np01_ED,62\n").lines)
