import os
import pickle
import sys
import unicodedata

import openpyxl
import pytest

from homolog.cohort import Subject, read_cohort
from homolog.errors import InputError


@pytest.fixture
def folder(tmp_path):
    for name in ("b.nii.gz", "a.nrrd", "C.STL", "notes.txt", ".hidden.nrrd"):
        (tmp_path / name).touch()
    return tmp_path


def table(folder, text, name="cohort.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_folder_gives_its_images_and_meshes_by_name(folder):
    cohort = read_cohort(folder)
    assert [subject.name for subject in cohort.subjects] == ["C", "a", "b"]
    assert [subject.is_mesh for subject in cohort.subjects] == [True, False, False]
    assert all(subject.group is None and subject.path.is_absolute() for subject in cohort.subjects)
    assert cohort.folder == folder


def test_a_table_gives_groups_and_further_columns_in_its_order(folder):
    path = table(folder, "\ufeffname, path,group,age\nz,a.nrrd,HCM,61\ny,sub/b.nii.gz,,\n")
    for source in (path, folder):
        first, second = read_cohort(source).subjects
        assert (first.name, first.path, first.group) == ("z", folder / "a.nrrd", "HCM")
        assert dict(first.columns) == {"age": "61"}
        assert second.group is None
        assert second.path == folder / "sub" / "b.nii.gz"


def test_a_table_may_hold_absolute_paths(folder):
    (first,) = read_cohort(table(folder, f"name,path\nx,{folder / 'a.nrrd'}\n")).subjects
    assert first.path == folder / "a.nrrd"


def test_subjects_can_be_left_out(folder):
    assert [subject.name for subject in read_cohort(folder).without({"a", "C"}).subjects] == ["b"]


def test_subjects_survive_pickling(folder):
    cohort = read_cohort(table(folder, "name,path,age\nz,a.nrrd,61\n"))
    assert pickle.loads(pickle.dumps(cohort.subjects)) == cohort.subjects


def test_two_files_of_one_name_are_refused(folder):
    (folder / "a.nii").touch()
    with pytest.raises(InputError, match=r"a\.nii and a\.nrrd are two files of a;"):
        read_cohort(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,path\na,a.nrrd\na,b.nii.gz\n", "several subjects are named a"),
        ("name,thing\na,b.nrrd\n", "lacks the column path"),
        ("", "lacks the column path"),
        ("name,path\n", "lists no subject"),
        ("name,path\n,a.nrrd\n", "line 2: the name is empty"),
        ("name,path\na,a.nrrd\nb,\n", "line 3: the path is empty"),
        ("name,path\na/b,a.nrrd\n", "line 2: 'a/b'"),
        ("name,path\n..,a.nrrd\n", "not a valid name"),
        ("name,path\na,a.nrrd\nz,a.nrrd\n", "a and z have the same file, a.nrrd"),
        ("name,path,group,group\na,a.nrrd,x,y\n", "several columns named group"),
        (
            "name,path,group\nDoe, Jane,a.nrrd,x\n",
            "line 2: has more values than .* put values that contain ','",
        ),
        ('name,path\na,"a.nrrd\nb,b.nrrd\n', "line 3: unexpected end of data; save the table again"),
    ],
)
def test_a_faulty_table_is_named_with_the_line(folder, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_cohort(table(folder, text))
    assert "cohort.csv" in str(caught.value)


PLAIN = "name,path,group,age\nÄnne,a.nrrd,HCM,61\ny,sub/b.nii.gz,,\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN.encode("utf-8-sig"),
        PLAIN.replace(",", ";").replace("\n", "\r\n").encode("utf-8-sig"),
        PLAIN.replace(",", "\t").encode("utf-16"),
        b"\xfe\xff" + PLAIN.replace(",", "\t").encode("utf-16-be"),
        ("sep=;\r\n" + PLAIN.replace(",", ";")).encode(),
        PLAIN.replace("\n", "\r").encode(),
        PLAIN.replace("name,path,group", "Name,PATH,Group").encode(),
        (PLAIN.replace("\n", ",,\n") + ",,,\n\n , , \n").encode(),
        PLAIN.replace("sub/b", "sub\\b").encode(),
        "\n".join(",".join(f'"{part}"' for part in line.split(",")) for line in PLAIN.splitlines()).encode(),
    ],
)
def test_a_table_may_be_saved_by_any_spreadsheet_program(folder, content):
    (folder / "cohort.csv").write_bytes(content)
    first, second = read_cohort(folder).subjects
    assert (first.name, first.path, first.group, dict(first.columns)) == (
        "Änne",
        folder / "a.nrrd",
        "HCM",
        {"age": "61"},
    )
    assert (second.name, second.path, second.group) == ("y", folder / "sub" / "b.nii.gz", None)


@pytest.mark.parametrize("name", ["cohort.tsv", "cohort.xlsx"])
def test_a_folders_table_may_be_a_sheet_or_separated_by_tabs(folder, name):
    rows = [line.split(",") for line in PLAIN.splitlines()]
    if name == "cohort.tsv":
        table(folder, "\n".join(map("\t".join, rows)), name)
    else:
        book = openpyxl.Workbook()
        for row in rows:
            book.active.append(row)
        book.save(folder / name)
    assert [subject.group for subject in read_cohort(folder).subjects] == ["HCM", None]


def test_a_table_in_windows_own_letters_is_read_with_a_note(folder):
    (folder / "cohort.csv").write_bytes(PLAIN.encode("cp1252"))
    cohort = read_cohort(folder)
    assert cohort.subjects[0].name == "Änne"
    assert [note for note in cohort.notes if "Windows-1252" in note]


@pytest.mark.parametrize("forms", [("NFC", "NFD"), ("NFD", "NFC")])
@pytest.mark.parametrize("columns", ["name,group\nMüller,a\n", "name,path,group\nMüller,Müller.nrrd,a\n"])
def test_accents_may_be_apart_in_file_names_and_not_in_the_table(tmp_path, forms, columns):
    (tmp_path / unicodedata.normalize(forms[0], "Müller.nrrd")).touch()
    table(tmp_path, unicodedata.normalize(forms[1], columns))
    (subject,) = read_cohort(tmp_path).subjects
    assert subject.group == "a"
    assert subject.path.is_file()


def test_a_table_without_names_and_paths_has_those_of_the_column_that_names_files(folder):
    (first, second) = read_cohort(table(folder, "Datei;group\na.nrrd;x\nb.nii.gz;y\n")).subjects
    assert [(item.name, item.group) for item in (first, second)] == [("a", "x"), ("b", "y")]


def test_a_file_without_text_is_no_table(folder):
    (folder / "cohort.csv").write_bytes(b"name,path\n\xff\x00\x81\n")
    with pytest.raises(InputError, match='in Excel: "CSV UTF-8"'):
        read_cohort(folder)


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no segmentation or mesh; .*\.nii\.gz"):
        read_cohort(tmp_path)


def place(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


def test_folders_of_one_file_each_name_the_subjects(tmp_path):
    place(tmp_path, "anna/mask.nii.gz", "anna/scan.txt", "bert/mask.nii.gz", ".trash/x/mask.nii.gz")
    place(tmp_path, "bert/mask.mrk.json")
    assert [
        (subject.name, subject.path, subject.landmarks) for subject in read_cohort(tmp_path).subjects
    ] == [
        ("anna", tmp_path / "anna" / "mask.nii.gz", None),
        ("bert", tmp_path / "bert" / "mask.nii.gz", tmp_path / "bert" / "mask.mrk.json"),
    ]


def test_what_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_cohort(tmp_path / "gone")


def test_a_single_image_is_refused_with_the_remedy(folder):
    with pytest.raises(InputError, match="give the folder"):
        read_cohort(folder / "a.nrrd")


def test_a_mesh_is_known_by_its_suffix(tmp_path):
    assert Subject("a", tmp_path / "a.VTP").is_mesh
    assert not Subject("a", tmp_path / "a.seg.nrrd").is_mesh


@pytest.mark.parametrize("path", ["a" * 300 + ".nrrd", "ä" * 200 + ".nrrd", "a/" * 3000])
def test_a_path_that_no_system_takes_is_refused_with_its_line(tmp_path, path):
    (tmp_path / "cohort.csv").write_text(f"name,path\na,a.nrrd\nb,{path}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"cohort\.csv, line 3: .* too long"):
        read_cohort(tmp_path / "cohort.csv")


@pytest.mark.parametrize("path", ["/", "//", ".", "sub/"])
def test_a_path_that_leads_to_a_folder_is_one_without_landmarks_beside_it(folder, path):
    (subject,) = read_cohort(table(folder, f"name,path\na,{path}\n")).subjects
    assert (subject.path, subject.landmarks) == (folder / path, None)


@pytest.mark.skipif(sys.platform != "linux", reason="only there are names any bytes")
@pytest.mark.parametrize("name", [b"bad\xff.nrrd", b"M\xfcller.ply"])
def test_a_file_name_that_is_no_text_is_refused(folder, name):
    (folder / os.fsdecode(name)).touch()
    with pytest.raises(InputError, match=r"\\x.*: .* UTF-8; rename it") as refused:
        read_cohort(folder)
    assert str(refused.value).encode()


def test_a_scan_beside_a_file_is_its_image_and_no_subject(folder):
    (folder / "a_image.nii.gz").touch()
    (folder / "b_image").mkdir()
    (folder / "lone_image.nrrd").touch()
    images = {subject.name: subject.image for subject in read_cohort(folder).subjects}
    assert images == {
        "a": folder / "a_image.nii.gz",
        "b": folder / "b_image",
        "C": None,
        "lone_image": None,
    }


def test_a_scan_in_each_subjects_folder_is_no_structure(tmp_path):
    for name in ("p1", "p2"):
        (tmp_path / name).mkdir()
        for file in ("seg.nrrd", "seg_image.nrrd"):
            (tmp_path / name / file).touch()
    subjects = read_cohort(tmp_path).subjects
    assert [(subject.name, subject.path.name) for subject in subjects] == [
        ("p1", "seg.nrrd"),
        ("p2", "seg.nrrd"),
    ]
    assert subjects[0].image == tmp_path / "p1" / "seg_image.nrrd"


def test_a_table_names_scans_whether_or_not_they_are_there(folder):
    (folder / "a_image.nrrd").touch()
    subjects = read_cohort(table(folder, "name,path,image\nx,a.nrrd,scans/x.mha\ny,b.nii.gz,\n")).subjects
    assert [subject.image for subject in subjects] == [folder / "scans" / "x.mha", None]
    assert all("image" not in subject.columns for subject in subjects)
    assert pickle.loads(pickle.dumps(subjects)) == subjects
