"""The study as a value, and what can be dropped on the window."""

import pytest

from homolog.cohort import Subject
from homolog.errors import InputError
from homolog_app.window.study import Study, read_subjects, with_table
from homolog_app.window.study_files import suggested_folder


@pytest.fixture
def study(tmp_path):
    return Study().adding(Subject(name, tmp_path / f"{name}.nrrd") for name in ("p01_ED", "p02_ED", "p10_ED"))


def test_a_file_is_listed_once_and_two_files_never_share_a_name(study, tmp_path):
    same = Subject("p01_ED", tmp_path / "p01_ED.nrrd")
    other = Subject("p01_ED", tmp_path / "elsewhere" / "p01_ED.nrrd")
    names = [member.name for member in study.adding([same, other]).members]
    assert names == ["p01_ED", "p02_ED", "p10_ED", "p01_ED (2)"]


def test_a_folder_and_single_files_can_be_dropped_together(ellipsoids, tmp_path):
    extra = tmp_path / "extra.NII.GZ"
    extra.touch()
    assert [subject.name for subject in read_subjects([ellipsoids, extra]).subjects] == [
        "a",
        "b",
        "c",
        "d",
        "extra",
    ]


def test_a_file_of_another_kind_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"notes\.txt"):
        read_subjects([tmp_path / "notes.txt"])


def test_a_table_gives_groups_and_covariates_to_the_subjects_that_it_names(study, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("id,group,age\np01,DCM,61\np02_ED,NOR,48\nstranger,NOR,50\np1,NOR,1\n", encoding="utf-8")
    changed, changes = with_table(study, table)
    assert changes.matched == ("p01_ED", "p02_ED")
    assert changes.unknown == ("stranger", "p1")
    assert [member.subject.group for member in changed.members] == ["DCM", "NOR", None]
    assert changed.members[0].subject.columns == {"age": "61"}


def test_a_table_that_names_nobody_is_refused(study, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("name,group\nx,A\n", encoding="utf-8")
    with pytest.raises(InputError, match="names none"):
        with_table(study, table)


def test_scans_that_are_gone_are_looked_for_beside_the_files_that_are(tmp_path):
    from homolog.cohort import Subject
    from homolog_app.window.study import Study

    for name in ("a.nrrd", "a_image.nrrd"):
        (tmp_path / name).touch()
    gone = tmp_path / "gone"
    study = Study().adding([Subject("a", gone / "a.nrrd", image=gone / "a_image.nrrd")])
    (member,) = study.relocated(tmp_path).members
    assert member.subject.path == tmp_path / "a.nrrd"
    assert member.subject.image == tmp_path / "a_image.nrrd"


def test_a_project_is_saved_next_to_its_files_unless_they_are_a_sample(study, tmp_path):
    home = tmp_path / "home"
    assert suggested_folder(study, None, home) == tmp_path.with_name(f"{tmp_path.name}-study")
    assert suggested_folder(study, tmp_path / "first", home) == tmp_path / "first-study"
    assert suggested_folder(study, None, tmp_path).parts == ("Study",)
