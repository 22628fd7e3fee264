"""Patterns of file names: read by one, and those that fit a folder."""

import pytest

from homolog.cohort import proposals, read_cohort
from homolog.errors import InputError


def rows(cohort):
    return [(subject.name, subject.group, dict(subject.columns)) for subject in cohort.subjects]


def test_fields_are_subject_group_structures_and_columns(tmp_path, cohort_of):
    names = [
        f"{group}/{name}/seg_{structure}_{side}.nii.gz"
        for group, name, side in (("HC", "a", "L"), ("AD", "b", "R"))
        for structure in ("femur", "tibia")
    ]
    cohort = cohort_of(tmp_path, *names, pattern="{group}/{subject}/seg_{structure}_{side}.nii.gz")
    assert rows(cohort) == [("a", "HC", {"side": "L"}), ("b", "AD", {"side": "R"})]
    assert [list(subject.structures) for subject in cohort.subjects] == [["femur", "tibia"]] * 2


def test_scans_of_one_person_are_subjects_with_the_person_in_a_column(tmp_path, cohort_of):
    cohort = cohort_of(
        tmp_path,
        "a_1.ply",
        "a_2.ply",
        "b_1.ply",
        pattern="{subject}_{time}.ply",
    )
    assert rows(cohort) == [
        ("a_1", None, {"subject": "a", "time": "1"}),
        ("a_2", None, {"subject": "a", "time": "2"}),
        ("b", None, {"subject": "b", "time": "1"}),
    ]


def test_equal_names_in_two_groups_are_two_subjects(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, "HC/1.stl", "AD/1.stl", pattern="{group}/{subject}.stl")
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [("1_AD", "AD"), ("1_HC", "HC")]


def test_a_repeated_field_is_the_same_text_and_a_star_any(tmp_path, cohort_of, files_of):
    names = ["p1/x7/p1_seg.nrrd", "p1/x7/p2_seg.nrrd", "p2/y/p2_seg.nrrd"]
    cohort = cohort_of(tmp_path, *names, pattern="{subject}/*/{subject}_seg.nrrd")
    assert files_of(cohort) == {"p1": names[0], "p2": names[2]}


def test_a_pattern_without_suffix_reads_folders_of_slices_next_to_files(tmp_path, dicom, cohort_of, files_of):
    for name in ("p1", "p2"):
        dicom(tmp_path / name / "SEG" / "1.dcm")
    cohort = cohort_of(tmp_path, "p1/mask.nrrd", pattern="{subject}/SEG")
    assert files_of(cohort) == {"p1": "p1/SEG", "p2": "p2/SEG"}


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("labels/*.nrrd", r"write \{subject\} where"),
        ("{subject}/{a b}.nrrd", "'?can't be a field"),
        ("{subject}/{path}.nrrd", "can't be a field"),
        ("{subject}/{x.nrrd", "is not a pattern"),
        ("{subject}.vtk", r'no file fits .*\n  "\{subject\}/a.nrrd"'),
        ("{subject}/*.nrrd", "p1/a.nrrd and p1/b.nrrd are both of p1; add a field"),
    ],
)
def test_a_pattern_that_can_not_be_meant_is_refused(tmp_path, pattern, message, cohort_of):
    with pytest.raises(InputError, match=message):
        cohort_of(tmp_path, "p1/a.nrrd", "p1/b.nrrd", "p2/a.nrrd", "p2/b.nrrd", pattern=pattern)


def test_a_pattern_is_for_folders(tmp_path):
    (tmp_path / "cohort.csv").write_text("name,path\na,a.ply\n")
    with pytest.raises(InputError, match="is not a folder"):
        read_cohort(tmp_path / "cohort.csv", "{subject}.ply")


def grid(pattern, **values):
    names = [pattern]
    for field, texts in values.items():
        names = [name.replace(f"<{field}>", text) for name in names for text in texts]
    return names


NUMBERS = [f"{number:02}" for number in range(1, 9)]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (grid("myo_iso/acdc<n>_ED_myo.nrrd", n=NUMBERS), {"myo_iso/{subject}_ED_myo.nrrd": "8 subjects"}),
        (
            [*grid("controls/c<n>.stl", n=NUMBERS), *grid("Hip dysplasia/d<n>.stl", n=NUMBERS)],
            {"{group}/{subject}.stl": "16 subjects, 2 groups"},
        ),
        (
            grid("<kind>/p<n>.nii.gz", kind=["images", "labels"], n=NUMBERS),
            {
                "labels/{subject}.nii.gz": "8 subjects",
                "{structure}/{subject}.nii.gz": "8 subjects, 2 structures",
                "{scan}/{subject}.nii.gz": "16 subjects",
            },
        ),
        (
            grid("p<n>/p<n>_<kind>.nii.gz", n=NUMBERS, kind=["t1", "seg"]),
            {
                "{subject}/{subject}_seg.nii.gz": "8 subjects",
                "{subject}/{subject}_{structure}.nii.gz": "8 subjects, 2 structures",
            },
        ),
        (
            grid("p<n>_<side>_femur.ply", n=NUMBERS, side=["L", "R"]),
            {"{subject}_{scan}_femur.ply": "16 subjects", "{subject}_L_femur.ply": "8 subjects"},
        ),
        (
            grid("s<n>/mri/<kind>.mgz", n=NUMBERS, kind=["aseg", "orig"]),
            {"{subject}/mri/aseg.mgz": "8 subjects"},
        ),
        (
            grid("<kind>/<kind>_p<n>.stl", kind=["liver", "spleen"], n=NUMBERS),
            {"{structure}/{structure}_{subject}.stl": "8 subjects, 2 structures"},
        ),
        (
            grid("p<n>/<time>/<kind>.nrrd", n=NUMBERS, time=["t0", "t1"], kind=["femur", "tibia"]),
            {"{subject}/{scan}/{structure}.nrrd": "16 subjects, 2 structures"},
        ),
    ],
)
def test_patterns_that_fit_are_found_from_common_parts_of_names(tmp_path, names, expected, place):
    place(tmp_path, *names)
    found = {proposal.pattern: proposal.text for proposal in proposals(tmp_path)}
    assert {pattern: found.get(pattern) for pattern in expected} == expected


def test_each_pattern_that_is_proposed_reads_what_it_says(tmp_path, place):
    place(tmp_path, *grid("<site>/p<n>_<kind>.nrrd", site=["a", "b"], n=NUMBERS, kind=["x", "y"]))
    for proposal in proposals(tmp_path):
        assert rows(read_cohort(tmp_path, proposal.pattern)) == rows(proposal.cohort)


def test_words_of_any_language_are_proposed_alike(tmp_path, place):
    place(tmp_path, *grid("大腿骨/<n>.stl", n=NUMBERS), *grid("脛骨/<n>.stl", n=NUMBERS))
    assert "{structure}/{subject}.stl" in [proposal.pattern for proposal in proposals(tmp_path)]
