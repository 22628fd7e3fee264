"""Names of structures: how they are matched, and the tables that give them."""

import json
from pathlib import Path

import pytest

from homolog.errors import InputError
from homolog.io.label_names import known_list, label_table, matching, near, read_label_table, same_name

TABLES = {
    "FreeSurferColorLUT.txt": "#$Id: FreeSurferColorLUT.txt\n#No. Label Name:  R   G   B   A\n\n"
    "0   Unknown          0   0   0   0\n17  Left-Hippocampus 220 216 20  0\n"
    "53  Right-Hippocampus 220 216 20 0\n",
    "slicer.ctbl": "# Color table file table.ctbl\n# 3 values\n0 Background 0 0 0 0\n"
    "17 left_hippocampus 1 2 3 255\n53 right_hippocampus 1 2 3 255\n",
    "snap.txt": "################\n# ITK-SnAP Label Description File\n# IDX -R- -G- -B- -A-- VIS MSH LABEL\n"
    '    0     0    0    0        0  0  0    "Clear Label"\n'
    '   17   255    0    0        1  1  1    "Left Hippocampus"\n'
    '   53     0  255    0      0.5  1  1    "Right Hippocampus"\n',
    "class_map.json": json.dumps({"17": "hippocampus_left", "53": "hippocampus_right"}),
    "classes.json": json.dumps({"total": {"17": "hippocampus_left", "53": "hippocampus_right"}}),
    "dataset.json": json.dumps(
        {"labels": {"background": 0, "hippocampus left": 17, "hippocampus right": 53}, "numTraining": 4}
    ),
    "names.json": json.dumps(
        [{"id": 17, "name": "Hippocampus, left"}, {"id": 53, "name": "Hippocampus, right"}]
    ),
    "study_dseg.tsv": "index\tname\tcolor\n17\tHippocampus_L\t#ff0000\n53\tHippocampus_R\t#00ff00\n",
    "Labels list.txt": "17: Hippocampus left\n53: Hippocampus right\n",
    "columns.csv": "Label;Name\n17;Hippocampus left\n53;Hippocampus right\n",
    "quoted.ctbl": '17 "Hippocampus left" 1 2 3 255\n53 "Hippocampus right" 1 2 3 255\n',
    "slicer.csv": "LabelValue,Name,Color_R\n17,hippocampus left,255\n53,hippocampus right,0\n",
}
NO_TABLES = {
    "notes.txt": "scanned in 2019\n17 subjects 1 2\n",
    "subjects.txt": "1 Anna\n2 Bert\n",
    "label remarks.txt": "1: scanned twice\n1: turned\n",
    "label line.txt": "17 subjects\n",
    "sidecar.json": json.dumps({"EchoTime": 0.03, "Manufacturer": "x"}),
    "broken.json": "{",
    "list.json": "[1, 2]",
    "participants.tsv": "participant_id\tage\nsub-01\t33\n",
    "cohort.csv": "name,path\na,a.nrrd\n",
    "empty.ctbl": "# nothing\n",
}


@pytest.mark.parametrize(
    "name",
    [
        "Left-Hippocampus",
        "hippocampus_left",
        "LEFT  hippocampus",
        "HippocampusLeft",
        "Hippocampus_L",
        "lh-hippocampus",
    ],
)
def test_case_dashes_and_order_of_words_do_not_matter(name):
    assert same_name("left-hippocampus", name)


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("Left-Hippocampus", "Right-Hippocampus"),
        ("vertebrae_L1", "vertebrae_L2"),
        ("hippocampus", "Left-Hippocampus"),
        ("rib_left_1", "rib_left_11"),
        ("-", "_"),
    ],
)
def test_different_structures_stay_different(name, other):
    assert not same_name(name, other)


def test_one_that_is_called_exactly_so_goes_first():
    names = ["kidney left", "Kidney-Left"]
    assert matching([(name, name) for name in names], "kidney left") == ["kidney left"]
    assert matching([(name, name) for name in names], "left kidney") == names


def test_near_names_are_those_that_share_words_or_letters():
    names = ["Left-Hippocampus", "Right-Hippocampus", "Left-Amygdala", "Brain-Stem"]
    assert near(names, "hippocampus") == ["Left-Hippocampus", "Right-Hippocampus"]
    assert near(names, "left hipocampus")[0] == "Left-Hippocampus"
    assert near(names, "liver") == []


@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_each_kind_beside_the_file_gives_the_names(tmp_path, name):
    (tmp_path / name).write_text(TABLES[name], encoding="utf-8")
    table = label_table(tmp_path / "a.nii.gz", {17, 53})
    assert set(table.names) == {17, 53}
    assert same_name(table.names[17], "Left-Hippocampus")
    assert not table.is_known_list


@pytest.mark.parametrize("name", NO_TABLES)
def test_other_texts_beside_the_files_are_passed_over(tmp_path, name):
    (tmp_path / name).write_text(NO_TABLES[name], encoding="utf-8")
    assert read_label_table(tmp_path / name) is None
    assert label_table(tmp_path / "a.nii.gz", {1, 2}) is None


def test_a_files_own_table_goes_before_the_folders_and_that_before_the_one_above(tmp_path):
    folder = tmp_path / "labels"
    folder.mkdir()
    for place, text in (
        (tmp_path / "above.json", "above"),
        (folder / "all.json", "all"),
        (folder / "b.json", "own"),
    ):
        place.write_text(json.dumps({"1": text}))
    for name in ("a", "b"):
        (folder / f"{name}.nii.gz").touch()
    assert label_table(folder / "b.nii.gz", {1}).names[1] == "own"
    assert label_table(folder / "a.nii.gz", {1}).names[1] == "all"
    (folder / "all.json").unlink()
    assert label_table(folder / "a.nii.gz", {1}).names[1] == "above"


def test_tables_that_contradict_each_other_are_refused_with_both_names(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps({"1": "liver"}))
    (tmp_path / "b.ctbl").write_text("1 spleen 1 2 3 255\n")
    with pytest.raises(InputError, match=r"b\.ctbl: .*1 'spleen', .*a\.json .*'liver'"):
        label_table(tmp_path / "x.nrrd", {1})


def test_freesurfers_numbers_are_known_where_the_values_speak_for_them():
    brain = frozenset({2, 3, 4, 10, 11, 17, 18, 41, 42, 53, 251, 1035, 2035})
    result = known_list(Path("study/anna.nii.gz"), brain)
    assert result.source == "FreeSurfer"
    assert [result.names[item] for item in (17, 16, 1035)] == [
        "Left-Hippocampus",
        "Brain-Stem",
        "ctx-lh-insula",
    ]
    assert known_list(Path("anna/mri/aseg.mgz"), frozenset({17})).source == "FreeSurfer"


def test_totalsegmentators_numbers_are_known_where_the_values_speak_for_them():
    body = frozenset(range(1, 118))
    result = known_list(Path("study/anna.nii.gz"), body)
    assert result.source == "TotalSegmentator"
    numbers = (1, 5, 22, 51, 91, 92, 104, 117)
    assert [result.names[number] for number in numbers] == [
        "spleen",
        "liver",
        "prostate",
        "heart",
        "skull",
        "rib_left_1",
        "rib_right_1",
        "costal_cartilages",
    ]
    assert known_list(Path("totalsegmentator/anna.nii.gz"), frozenset({5, 51})).source == "TotalSegmentator"


@pytest.mark.parametrize("values", [{1, 2, 3}, {1, 2, 4}, set(range(1, 16)), {5}, set(range(8, 25)), set()])
def test_small_numbers_that_any_list_has_are_not_named(values):
    assert known_list(Path("study/anna.nii.gz"), frozenset(values)) is None
