"""Layouts of folders that need no pattern."""

import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError


def structures(cohort):
    return {
        subject.name: {
            name: path.relative_to(cohort.folder).as_posix() for name, path in subject.structures.items()
        }
        for subject in cohort.subjects
    }


def test_a_flat_folder_has_a_subject_for_each_file(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, "b.nrrd", "a_1.nii.gz", "c.stl", "notes.txt", ".x.nrrd")
    assert files_of(cohort) == {"a_1": "a_1.nii.gz", "b": "b.nrrd", "c": "c.stl"}


def test_files_below_a_flat_folder_are_not_used_and_counted(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, "a.nrrd", "b.nrrd", "old/a.nrrd")
    assert list(files_of(cohort)) == ["a", "b"]
    assert cohort.notes == ("not used: 1 file in subfolders",)


def test_results_of_homolog_below_a_folder_are_no_shapes(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, "a.nrrd", "b.nrrd", "study/project.json", "study/model/mean.vtp")
    assert (list(files_of(cohort)), cohort.notes) == (["a", "b"], ())


@pytest.mark.parametrize(
    "names",
    [
        ["case1.nii.gz", "case1_seg.nii.gz", "case2.nii.gz", "case2_seg.nii.gz"],
        ["case1.nii.gz", "case1_0000.nii.gz", "case2.nii.gz", "case2_0000.nii.gz"],
        ["p1_liver.nrrd", "p1_spleen.nrrd", "p2_liver.nrrd", "p2_spleen.nrrd"],
        ["ct_1.nrrd", "mask_1.nrrd", "ct_2.nrrd", "mask_2.nrrd", "mask_3.nrrd"],
    ],
)
def test_a_flat_folder_with_several_files_of_each_subject_needs_a_pattern(tmp_path, names, cohort_of):
    with pytest.raises(InputError, match=r'  ".*\{subject\}.*"  [23] subjects'):
        cohort_of(tmp_path, *names)


@pytest.mark.parametrize("file", ["{}/liver.nii.gz", "{}/{}_liver.nii.gz", "{}/liver-{}.stl"])
def test_a_folder_for_each_subject_has_a_file_for_each_structure(tmp_path, file, cohort_of):
    names = [file.format(name, name) for name in ("p1", "p2", "p3")]
    cohort = cohort_of(tmp_path, *names, *(name.replace("liver", "spleen") for name in names[:2]))
    assert structures(cohort) == {
        "p1": {"liver": names[0], "spleen": names[0].replace("liver", "spleen")},
        "p2": {"liver": names[1], "spleen": names[1].replace("liver", "spleen")},
        "p3": {"liver": names[2]},
    }


def test_a_folder_for_each_subject_may_have_one_file_at_any_depth(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, "anna/mask.nii.gz", "bert/2020/heart.nii.gz")
    assert files_of(cohort) == {"anna": "anna/mask.nii.gz", "bert": "bert/2020/heart.nii.gz"}


def test_landmarks_and_scan_lie_next_to_a_file(tmp_path, place, cohort_of):
    place(tmp_path, "p1/seg.mrk.json", "p1/seg_image.nrrd")
    first, second = cohort_of(tmp_path, "p1/seg.nrrd", "p2/seg.nrrd").subjects
    assert (first.landmarks, first.image) == (tmp_path / "p1/seg.mrk.json", tmp_path / "p1/seg_image.nrrd")
    assert (second.landmarks, second.image) == (None, None)


def test_folders_of_different_kinds_of_files_are_no_subjects(tmp_path, cohort_of):
    names = [
        f"{kind}/p{number}.{suffix}"
        for kind, suffix in (("labels", "nrrd"), ("meshes", "ply"))
        for number in (1, 2)
    ]
    with pytest.raises(
        InputError, match=r'"labels/\{subject\}.nrrd" +2 subjects\n.*"meshes/\{subject\}.ply" +2 sub'
    ):
        cohort_of(tmp_path, *names)


def test_totalsegmentators_structures_have_the_scan_beside_them(tmp_path, cohort_of):
    names = [
        f"s{number}/{name}.nii.gz"
        for number in (1, 2)
        for name in ("ct", "segmentations/liver", "segmentations/aorta")
    ]
    cohort = cohort_of(tmp_path, *names)
    assert structures(cohort) == {
        name: {item: f"{name}/segmentations/{item}.nii.gz" for item in ("aorta", "liver")}
        for name in ("s1", "s2")
    }
    assert [subject.image for subject in cohort.subjects] == [
        tmp_path / name / "ct.nii.gz" for name in ("s1", "s2")
    ]


def test_nnunets_cases_are_its_training_labels_with_their_first_channel(tmp_path, cohort_of, files_of):
    cohort = cohort_of(
        tmp_path,
        "labelsTr/a.nii.gz",
        "labelsTr/b.nii.gz",
        "imagesTr/a_0000.nii.gz",
        "imagesTr/a_0001.nii.gz",
        "imagesTs/c_0000.nii.gz",
        "dataset.json",
    )
    assert files_of(cohort) == {"a": "labelsTr/a.nii.gz", "b": "labelsTr/b.nii.gz"}
    assert [subject.image for subject in cohort.subjects] == [tmp_path / "imagesTr/a_0000.nii.gz", None]


def test_bids_derivatives_have_sessions_sides_and_labels(tmp_path, cohort_of):
    names = [
        f"derivatives/seg/sub-{subject}/ses-{session}/anat/sub-{subject}_ses-{session}_hemi-{side}_label-HIP_mask.nii.gz"
        for subject in ("01", "02")
        for session in ("a", "b")
        for side in "LR"
    ]
    cohort = cohort_of(tmp_path, *names, "sub-01/ses-a/anat/sub-01_ses-a_T1w.nii.gz")
    first = cohort.subjects[0]
    assert (first.name, dict(first.columns)) == (
        "sub-01_ses-a_L",
        {"subject": "sub-01", "session": "ses-a", "side": "L"},
    )
    assert list(first.structures) == ["HIP"]
    assert len(cohort.subjects) == 8


def test_participants_of_a_bids_data_set_give_groups_and_columns(tmp_path, cohort_of, files_of):
    names = [f"derivatives/seg/sub-{subject}/anat/sub-{subject}_dseg.nii.gz" for subject in ("01", "02")]
    (tmp_path / "participants.tsv").write_text("participant_id\tgroup\tage\nsub-01\tHC\t61\nsub-02\tAD\t70\n")
    cohort = cohort_of(tmp_path, *names)
    assert list(files_of(cohort).values()) == names
    assert [(subject.group, subject.columns["age"]) for subject in cohort.subjects] == [
        ("HC", "61"),
        ("AD", "70"),
    ]
    assert [subject.group for subject in read_cohort(tmp_path / "derivatives").subjects] == ["HC", "AD"]


def test_several_kinds_of_bids_files_need_a_pattern(tmp_path, cohort_of):
    names = [
        f"sub-{subject}/anat/sub-{subject}{kind}_dseg.nii.gz"
        for subject in ("01", "02")
        for kind in ("", "_desc-aseg")
    ]
    with pytest.raises(
        InputError, match=r'"\{subject\}/anat/\{subject\}_desc-aseg_dseg\.nii\.gz" +2 subjects'
    ):
        cohort_of(tmp_path, *names)


def test_a_dicom_seg_beside_its_scan_is_the_subject(tmp_path, dicom):
    for name in ("p1", "p2"):
        dicom(tmp_path / name / "seg.dcm", b"1.2.840.10008.5.1.4.1.1.66.4")
        dicom(tmp_path / name / "1.dcm")
    first, _ = read_cohort(tmp_path).subjects
    assert (first.name, first.path.name, first.image) == ("p1", "seg.dcm", tmp_path / "p1")


def test_slices_next_to_a_mask_are_no_shape(tmp_path, dicom, cohort_of, files_of):
    for name in ("p1", "p2"):
        dicom(tmp_path / name / "ct" / "1.dcm")
    cohort = cohort_of(tmp_path, "p1/mask.nrrd", "p2/mask.nrrd")
    assert files_of(cohort) == {"p1": "p1/mask.nrrd", "p2": "p2/mask.nrrd"}


def test_folders_of_slices_are_a_patients_structures(tmp_path, dicom):
    for name in ("p1", "p2"):
        for structure in ("bone", "liver"):
            dicom(tmp_path / name / structure / "1.dcm")
    assert structures(read_cohort(tmp_path))["p1"] == {"bone": "p1/bone", "liver": "p1/liver"}


@pytest.mark.parametrize(
    ("name", "remedy"), [("a.zip", "unpack"), ("a.npy", "NIfTI"), ("a.step", "STL"), ("a.swproj", "run")]
)
def test_files_of_other_types_are_refused_with_what_to_do(tmp_path, name, remedy, cohort_of):
    with pytest.raises(InputError, match=rf"no segmentation or mesh; it contains .*{remedy}"):
        cohort_of(tmp_path, name)


def test_what_cannot_be_read_is_skipped_with_a_note(tmp_path, cohort_of):
    (tmp_path / "c.nrrd").symlink_to(tmp_path / "nowhere")
    cohort = cohort_of(tmp_path, "a.nrrd", "b.nrrd")
    assert cohort.notes == ("skipped, links that lead nowhere: c.nrrd",)


def test_a_table_that_lies_there_is_offered(tmp_path, cohort_of, place):
    (tmp_path / "subjects.csv").write_text("id,group\na,x\nb,y\n")
    cohort = cohort_of(tmp_path / "labels", "a.nrrd", "b.nrrd")
    assert any(f"(table: {tmp_path / 'subjects.csv'})" in note for note in cohort.notes)
    used = read_cohort(tmp_path / "labels", table=tmp_path / "subjects.csv")
    assert ([subject.group for subject in used.subjects], used.notes) == (["x", "y"], ())
    (tmp_path / "files.csv").write_text("id,file\na,labels/a.nrrd\nb,labels/b.nrrd\n")
    with pytest.raises(InputError, match=r"give a table that lies there: .*files\.csv"):
        read_cohort(tmp_path)
