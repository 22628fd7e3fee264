"""Folders as other programs write them: subjects, scans and structures."""

import pytest

from homolog.cohort import mask_files, read_cohort, sides_of
from homolog.errors import InputError

ENDS = ("first", "corr", "flirt")
KINDS = (("labels", ".nrrd"), ("meshes", ".ply"))


def test_bids_subjects_are_their_label_maps_in_their_own_space(tmp_path, cohort_of, files_of):
    files = (
        "desc-aseg_dseg",
        "desc-aparcaseg_dseg",
        "desc-preproc_T1w",
        "label-GM_probseg",
        "space-MNI_dseg",
    )
    names = [f"sub-0{i}/anat/sub-0{i}_{item}.nii.gz" for i in (1, 2) for item in files]
    cohort = cohort_of(tmp_path, *names, "sub-01/figures/a.svg", "dataset_description.json")
    assert files_of(cohort) == {f"sub-0{i}": f"sub-0{i}/anat/sub-0{i}_desc-aseg_dseg.nii.gz" for i in (1, 2)}


def test_bids_sessions_are_subjects(tmp_path, cohort_of, files_of):
    names = [f"sub-0{i}/ses-{k}/anat/sub-0{i}_ses-{k}_dseg.nii.gz" for i in (1, 2) for k in "ab"]
    assert files_of(cohort_of(tmp_path, *names)) == {f"sub-0{name[5]}_ses-{name[11]}": name for name in names}


def test_masks_among_bids_derivatives_go_before_the_scans(tmp_path, cohort_of):
    scans = [f"sub-0{i}/anat/sub-0{i}_T1w.nii.gz" for i in (1, 2)]
    masks = [f"derivatives/manual/sub-0{i}/anat/sub-0{i}_label-lesion_mask.nii.gz" for i in (1, 2)]
    cohort = cohort_of(tmp_path, *scans, *masks)
    assert [subject.path for subject in cohort.subjects] == [tmp_path / mask for mask in masks]


def test_a_slicer_segmentation_goes_before_the_volumes_beside_it(tmp_path, cohort_of, files_of):
    cohort = cohort_of(
        tmp_path, *(f"P {i}/{name}.nrrd" for i in (1, 2) for name in ("2 Thorax", "Segmentation.seg"))
    )
    assert files_of(cohort) == {f"P {i}": f"P {i}/Segmentation.seg.nrrd" for i in (1, 2)}


def test_freesurfers_average_is_no_subject(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{name}/mri/aseg.mgz" for name in ("bert", "ernie", "fsaverage")))
    assert [subject.name for subject in cohort.subjects] == ["bert", "ernie"]
    assert "fsaverage" in cohort.notes[0]


def test_first_s_maps_of_all_structures_are_taken(tmp_path, cohort_of, files_of):
    files = ("all_fast_firstseg.nii.gz", "L_Caud_first.nii.gz", "L_Caud_first.vtk", "L_Thal_corr.nii.gz")
    cohort = cohort_of(tmp_path, *(f"con00{i}_{file}" for i in (1, 2, 3) for file in files))
    assert files_of(cohort) == {
        f"con00{i}_all_fast_firstseg": f"con00{i}_all_fast_firstseg.nii.gz" for i in (1, 2, 3)
    }
    assert len(cohort.notes) == 2


def test_first_s_corrected_file_of_one_structure_goes_before_the_other(tmp_path, cohort_of):
    cohort = cohort_of(
        tmp_path, *(f"con{i}-L_Caud_{file}.nii.gz" for i in (1, 2, 3) for file in ("first", "corr"))
    )
    assert [subject.path.name for subject in cohort.subjects] == [
        f"con{i}-L_Caud_corr.nii.gz" for i in (1, 2, 3)
    ]
    assert "con1-L_Caud_first.nii.gz" in cohort.notes[0]
    folders = cohort_of(
        tmp_path / "each", *(f"a{i}/a{i}-L_Caud_{end}.nii.gz" for i in (1, 2) for end in ENDS)
    )
    assert list(mask_files(folders.subjects[0].path)) == ["L_Caud", "L_Caud_flirt"]


def test_parcellations_of_freesurfer_are_read_where_there_is_no_aseg(tmp_path, cohort_of, files_of):
    names = {"a": "aparc+aseg.mgz", "b": "aparc.DKTatlas+aseg.deep.mgz"}
    cohort = cohort_of(tmp_path, *(f"{name}/mri/{file}" for name, file in names.items()))
    assert files_of(cohort) == {name: f"{name}/mri/{file}" for name, file in names.items()}


def test_parts_of_a_data_set_are_taken_together(tmp_path, cohort_of, files_of):
    names = [
        f"{kind}{part}/a{part}_{i}.nii.gz"
        for kind in ("images", "labels")
        for part in ("Tr", "Va")
        for i in (1, 2)
    ]
    cohort = cohort_of(tmp_path, *names, "imagesTs/aTs_9_0000.nii.gz")
    assert files_of(cohort) == {
        f"a{part}_{i}": f"labels{part}/a{part}_{i}.nii.gz" for part in ("Tr", "Va") for i in (1, 2)
    }


@pytest.mark.parametrize(
    ("other", "files"),
    [("predictions", "b"), ("inferTs", "b"), ("nnUNetTrainer__fold_0/validation", "a"), ("old", "a")],
)
def test_predictions_beside_label_maps_are_left_out_with_a_note(tmp_path, other, files, cohort_of):
    names = [f"labelsTr/a_{i}.nii.gz" for i in (1, 2, 3)] + [f"imagesTr/a_{i}_0000.nii.gz" for i in (1, 2, 3)]
    cohort = cohort_of(tmp_path, *names, *(f"{other}/{files}_{i}.nii.gz" for i in (1, 2, 3)))
    assert [subject.path.parent.name for subject in cohort.subjects] == ["labelsTr"] * 3
    assert other.partition("/")[0] in " ".join(cohort.notes)


@pytest.mark.parametrize("words", [("li", "re"), ("sin", "dex")])
def test_folders_of_abbreviated_sides_are_sides(tmp_path, words, cohort_of):
    cohort = cohort_of(tmp_path / "above", *(f"{word}/P{i}.stl" for word in words for i in (1, 2)))
    inside = cohort_of(tmp_path / "inside", *(f"P{i}/{word}/femur.stl" for word in words for i in (1, 2)))
    assert (
        sorted(sides_of(cohort).of.values())
        == sorted(sides_of(inside).of.values())
        == ["left", "left", "right", "right"]
    )


def test_parts_of_a_data_set_without_label_maps_are_left_out(tmp_path, cohort_of):
    names = ["train/img/img1.nii.gz", "train/label/label1.nii.gz", "train/label/label2.nii.gz"]
    cohort = cohort_of(tmp_path, *names, "test/img/img3.nii.gz", "test/img/img4.nii.gz")
    assert [subject.name for subject in cohort.subjects] == ["label1", "label2"]


def test_folders_of_slices_are_a_patients_structures(tmp_path, dicom):
    for patient in ("p1", "p2"):
        for place in ("PATIENT_DICOM", "LABELLED_DICOM", "MASKS_DICOM/liver", "MASKS_DICOM/spleen"):
            dicom(tmp_path / patient / place / "image_0")
    cohort = read_cohort(tmp_path)
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2"]
    assert mask_files(cohort.subjects[1].path) == {
        item: tmp_path / "p2" / "MASKS_DICOM" / item for item in ("liver", "spleen")
    }


def test_the_data_set_s_name_above_a_subject_s_folder_is_no_part_of_structures_names(tmp_path, cohort_of):
    names = [f"ibsr/IBSR_0{i}/IBSR_0{i}_{item}.nii.gz" for i in (1, 2) for item in ("seg", "segTRI")]
    cohort = cohort_of(tmp_path, *names)
    assert [*mask_files(cohort.subjects[0].path)] == ["seg", "segTRI"]


@pytest.mark.parametrize("places", [("", ""), ("study/ct/", "study/seg/")])
def test_a_dicom_seg_beside_the_scan_is_the_subject(tmp_path, places, files_of, dicom):
    for patient in ("p1", "p2"):
        for index in range(3):
            dicom(tmp_path / patient / f"{places[0]}{index}.dcm")
        dicom(tmp_path / patient / f"{places[1]}heart.dcm", b"1.2.840.10008.5.1.4.1.1.66.4")
    assert files_of(read_cohort(tmp_path)) == {
        patient: f"{patient}/{places[1]}heart.dcm" for patient in ("p1", "p2")
    }


def test_surfaces_of_brains_are_subjects_with_sides(tmp_path, cohort_of):
    kinds = ("pial.surf.gii", "thickness.shape.gii", "inflated.surf.gii", "sphere.surf.gii")
    names = [f"sub-0{i}_hemi-{side}_{kind}" for i in (1, 2) for side in "LR" for kind in kinds]
    cohort = cohort_of(tmp_path / "flat", *names)
    assert [subject.path.name for subject in cohort.subjects] == [name for name in names if "pial" in name]
    assert set(sides_of(cohort).of.values()) == {"left", "right"}
    places = [f"s{i}/surf/{name}" for i in (1, 2) for name in ("lh.pial", "lh.curv", "rh.pial", "rh.white")]
    cohort = cohort_of(tmp_path / "freesurfer", *places)
    assert [*mask_files(cohort.subjects[0].path)] == ["lh.pial", "rh.pial", "rh.white"]
    cohort = cohort_of(tmp_path / "freesurfer", "s1/mri/aseg.mgz", "s2/mri/aseg.mgz")
    assert [subject.path.name for subject in cohort.subjects] == ["aseg.mgz"] * 2
    assert "surf/lh.pial" in cohort.notes[0]


@pytest.mark.parametrize("place", ["{}/CT/0.dcm", "{}/0.dcm"])
def test_a_mask_goes_before_the_dicom_slices_beside_it(tmp_path, place, cohort_of, files_of, dicom):
    for patient in ("p1", "p2", "p3"):
        dicom(tmp_path / place.format(patient))
    cohort = cohort_of(tmp_path, "p1/liver.nii.gz", "p2/liver.nii.gz")
    assert files_of(cohort) == {"p1": "p1/liver.nii.gz", "p2": "p2/liver.nii.gz"}
    assert "p3" in " ".join(cohort.notes)


def test_several_label_maps_of_a_freesurfer_subject_are_structures(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"s{n}/mri/{side}h.hippo.mgz" for n in (1, 2) for side in "lr"))
    assert [*mask_files(cohort.subjects[0].path)] == ["lh.hippo", "rh.hippo"]


def test_scans_of_nnunet_beside_label_maps_are_their_scans(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"c_{n}{end}.nii.gz" for n in (1, 2) for end in ("", "_0000", "_0001")))
    assert [(subject.name, subject.image is not None) for subject in cohort.subjects] == [
        ("c_1", True),
        ("c_2", True),
    ]


@pytest.mark.parametrize("kept", ["c_{}_gt.nii.gz", "c_{}/ground_truth.nii.gz"])
@pytest.mark.parametrize("other", ["pred", "prob", "softmax"])
def test_results_of_a_network_beside_label_maps_are_not_subjects(tmp_path, kept, other, cohort_of, files_of):
    place = kept.replace("gt.", f"{other}.").replace("ground_truth.", f"{other}.")
    names = [kept.format(n) for n in (1, 2, 3)]
    cohort = cohort_of(tmp_path, *names, *(place.format(n) for n in (1, 2, 3)))
    assert sorted(files_of(cohort).values()) == names
    assert all(subject.image is None for subject in cohort.subjects)


def test_a_prediction_is_the_label_map_of_a_scan_and_its_probabilities_are_neither(tmp_path, cohort_of):
    names = [f"c_{n}_{kind}.nii.gz" for n in (1, 2) for kind in ("ct", "pred", "prob")]
    cohort = cohort_of(tmp_path, *names)
    assert [subject.path.name for subject in cohort.subjects] == ["c_1_pred.nii.gz", "c_2_pred.nii.gz"]
    assert [subject.image.name for subject in cohort.subjects] == ["c_1_ct.nii.gz", "c_2_ct.nii.gz"]


def test_probabilities_of_bids_are_no_structures(tmp_path, cohort_of):
    kinds = ("label-liver_mask", "label-spleen_mask", "label-GM_probseg")
    names = [f"sub-{n}/anat/sub-{n}_{kind}.nii.gz" for n in (1, 2) for kind in kinds]
    masks = mask_files(cohort_of(tmp_path, *names).subjects[0].path)
    assert [*masks] == ["label-liver_mask", "label-spleen_mask"]


def test_a_patient_with_only_a_scan_is_skipped_with_a_note(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, "a/mask.nii.gz", "b/mask.nii.gz", "c/t1.nii.gz")
    assert files_of(cohort) == {"a": "a/mask.nii.gz", "b": "b/mask.nii.gz"}
    assert cohort.notes[0].endswith(": c")


def test_a_folder_of_results_beside_data_is_no_group(tmp_path, cohort_of, files_of):
    names = [f"{place}/subject_{n}.vtk" for place in ("data", "output") for n in (1, 2)]
    cohort = cohort_of(tmp_path, *names)
    assert files_of(cohort) == {f"subject_{n}": f"subject_{n}.vtk" for n in (1, 2)}
    assert [subject.group for subject in cohort.subjects] == [None, None]
    assert "output" in cohort.notes[0]


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("a.tar.gz", "unpack"),
        ("a.zip", "unpack"),
        ("a.mrb", r"seg\.nrrd"),
        ("a.npy", "voxel size"),
        ("a.am", "export"),
        ("a.mnc", "mnc2nii"),
        ("a.vti", "ParaView"),
        ("a.img", r"\.hdr"),
        ("a.zraw", r"\.mhd"),
        ("a.swproj", "homolog import"),
    ],
)
def test_files_of_other_types_are_refused_with_what_to_do(tmp_path, name, remedy, cohort_of):
    suffix = name.partition(".")[2].replace(".", r"\.")
    with pytest.raises(InputError, match=rf"{suffix} \(1\); .*{remedy}"):
        cohort_of(tmp_path, name)
    with pytest.raises(InputError, match=rf"{suffix}: .*{remedy}"):
        read_cohort(tmp_path / name)


def test_a_shapeworks_project_beside_its_folders_is_pointed_at(tmp_path, cohort_of):
    with pytest.raises(InputError, match=r"homolog import study\.swproj"):
        cohort_of(
            tmp_path,
            "study.swproj",
            *(f"{place}/b{n}.ply" for place in ("meshes", "groomed") for n in (1, 2)),
        )


@pytest.mark.parametrize(
    ("names", "kinds"),
    [
        (["P{}_L1", "P{}_L2"], "L1, L2"),
        (["10{}_1_CT_58_7", "10{}_1_CT_237_7"], "237, 58"),
        (["{}_t1", "{}_t2"], "t1, t2"),
        (["c1s{}", "c2s{}"], "c1, c2"),
        (["P{}_L", "P{}_R"], None),
        (["control_{}", "patient_{}"], None),
        (["a_{}", "b_{}", "c_{}"], None),
        (["P{}_pre", "P{}_post"], None),
        (["P{}_seg"], None),
    ],
)
def test_several_files_of_each_subject_are_noted(tmp_path, names, kinds, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{name.format(n)}.nii.gz" for name in names for n in (1, 2, 3)))
    assert len(cohort.subjects) == 3 * len(names)
    assert any(f"named {kinds}," in note for note in cohort.notes) == bool(kinds)


def test_templates_among_subjects_are_skipped_with_a_note(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path / "some", "p1.vtk", "p2.vtk", "mean_shape.vtk", "template.vtk")
    assert files_of(cohort) == {"p1": "p1.vtk", "p2": "p2.vtk"}
    assert "mean_shape.vtk, template.vtk" in cohort.notes[0]
    assert len(cohort_of(tmp_path / "all", "mean_a.vtk", "mean_b.vtk").subjects) == 2
    assert len(cohort_of(tmp_path / "numbered", "atlas01.vtk", "atlas02.vtk", "atlas03.vtk").subjects) == 3


@pytest.mark.parametrize("places", [("Images", "Contours"), ("image", "annotations")])
def test_folders_of_images_and_contours_in_a_patients_folder_are_no_subjects(
    tmp_path, places, cohort_of, files_of
):
    cohort = cohort_of(tmp_path, *(f"P{n}/{place}/P{n}.nii.gz" for n in (1, 2, 3) for place in places))
    assert files_of(cohort) == {f"P{n}": f"P{n}/{places[1]}/P{n}.nii.gz" for n in (1, 2, 3)}


@pytest.mark.parametrize(("mask", "scan"), [("GT", "P{}"), ("laendo", "lgemri")])
def test_a_scan_with_the_patients_name_or_a_kind_of_mri_is_no_structure(
    tmp_path, mask, scan, cohort_of, files_of
):
    names = [f"P{n}/{name.format(n)}.nii.gz" for n in (1, 2) for name in (mask, scan)]
    assert files_of(cohort_of(tmp_path, *names)) == {f"P{n}": f"P{n}/{mask}.nii.gz" for n in (1, 2)}


@pytest.mark.parametrize("places", [("input", "output"), ("mri", "surf")])
def test_folders_of_a_programs_input_are_not_groups(tmp_path, places, cohort_of):
    with pytest.raises(InputError, match=f"{places[0]} .2., {places[1]} .2."):
        cohort_of(tmp_path, *(f"{place}/{place}s{n}.nii.gz" for place in places for n in (1, 2)))
