"""Folders as other programs and people fill them."""

import pytest

from homolog.cohort import mask_files, read_cohort, sides_of
from homolog.errors import InputError
from homolog.grooming.structures import structures_of_files

ENDS = ("first", "corr", "flirt")
KINDS = (("labels", ".nrrd"), ("meshes", ".ply"))


def cohort_of(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")
    return read_cohort(folder)


def files_of(cohort):
    return {subject.name: subject.path.relative_to(cohort.folder).as_posix() for subject in cohort.subjects}


def dicom(path, kind=b"1.2.840.10008.5.1.4.1.1.2"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(128) + b"DICM" + kind)


def test_bids_subjects_are_their_label_maps_in_their_own_space(tmp_path):
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


def test_bids_sessions_are_subjects(tmp_path):
    names = [f"sub-0{i}/ses-{k}/anat/sub-0{i}_ses-{k}_dseg.nii.gz" for i in (1, 2) for k in "ab"]
    assert files_of(cohort_of(tmp_path, *names)) == {f"sub-0{name[5]}_ses-{name[11]}": name for name in names}


def test_masks_among_bids_derivatives_go_before_the_scans(tmp_path):
    scans = [f"sub-0{i}/anat/sub-0{i}_T1w.nii.gz" for i in (1, 2)]
    masks = [f"derivatives/manual/sub-0{i}/anat/sub-0{i}_label-lesion_mask.nii.gz" for i in (1, 2)]
    cohort = cohort_of(tmp_path, *scans, *masks)
    assert [subject.path for subject in cohort.subjects] == [tmp_path / mask for mask in masks]


@pytest.mark.parametrize(
    ("scan", "mask", "name"),
    [
        ("case{}.nii.gz", "case{}_seg.nii.gz", "case{}"),
        ("L1_{}_ct.nii.gz", "L1_{}.nii.gz", "L1_{}"),
        ("ct_{}.nrrd", "mask_{}.nrrd", "mask_{}"),
        ("p{}_CT.nii.gz", "p{} Segmentation.seg.nrrd", "p{} Segmentation"),
    ],
)
def test_scans_beside_label_maps_are_their_scans_and_no_subjects(tmp_path, scan, mask, name):
    cohort = cohort_of(tmp_path, *(text.format(i) for i in (1, 2) for text in (scan, mask)))
    assert [(subject.name, subject.path.name, subject.image.name) for subject in cohort.subjects] == [
        (name.format(i), mask.format(i), scan.format(i)) for i in (1, 2)
    ]
    assert scan.format(1) in cohort.notes[0]


def test_points_in_time_of_one_patient_are_subjects(tmp_path):
    names = [f"p{i}/p{i}_frame{k}{kind}.nii.gz" for i in (1, 2) for k in ("01", "12") for kind in ("", "_gt")]
    cohort = cohort_of(tmp_path, *names, "p1/p1_4d.nii.gz", "p1/Info.cfg")
    assert files_of(cohort) == {
        f"p{i}_frame{k}_gt": f"p{i}/p{i}_frame{k}_gt.nii.gz" for i in (1, 2) for k in ("01", "12")
    }


def test_a_slicer_segmentation_goes_before_the_volumes_beside_it(tmp_path):
    cohort = cohort_of(
        tmp_path, *(f"P {i}/{name}.nrrd" for i in (1, 2) for name in ("2 Thorax", "Segmentation.seg"))
    )
    assert files_of(cohort) == {f"P {i}": f"P {i}/Segmentation.seg.nrrd" for i in (1, 2)}


def test_freesurfers_average_is_no_subject(tmp_path):
    cohort = cohort_of(tmp_path, *(f"{name}/mri/aseg.mgz" for name in ("bert", "ernie", "fsaverage")))
    assert [subject.name for subject in cohort.subjects] == ["bert", "ernie"]
    assert "fsaverage" in cohort.notes[0]


def test_first_s_maps_of_all_structures_are_taken(tmp_path):
    files = ("all_fast_firstseg.nii.gz", "L_Caud_first.nii.gz", "L_Caud_first.vtk", "L_Thal_corr.nii.gz")
    cohort = cohort_of(tmp_path, *(f"con00{i}_{file}" for i in (1, 2, 3) for file in files))
    assert files_of(cohort) == {
        f"con00{i}_all_fast_firstseg": f"con00{i}_all_fast_firstseg.nii.gz" for i in (1, 2, 3)
    }
    assert len(cohort.notes) == 2


def test_first_s_corrected_file_of_one_structure_goes_before_the_other(tmp_path):
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


def test_parcellations_of_freesurfer_and_fastsurfer_are_read_where_there_is_no_aseg(tmp_path):
    names = {"a": "aparc+aseg.mgz", "b": "aparc.DKTatlas+aseg.deep.mgz"}
    cohort = cohort_of(tmp_path, *(f"{name}/mri/{file}" for name, file in names.items()))
    assert files_of(cohort) == {name: f"{name}/mri/{file}" for name, file in names.items()}


def test_files_one_folder_deeper_are_their_patients(tmp_path):
    cohort = cohort_of(tmp_path, *(f"p{i}/2020-0{i}/heart.nii.gz" for i in (1, 2)))
    assert files_of(cohort) == {f"p{i}": f"p{i}/2020-0{i}/heart.nii.gz" for i in (1, 2)}
    (tmp_path / "p3" / "empty").mkdir(parents=True)
    assert read_cohort(tmp_path).notes == ("skipped, without a segmentation or mesh: p3",)
    with pytest.raises(InputError, match=r"several .*: x, y"):
        cohort_of(
            tmp_path / "p3",
            *(f"{place}/p{i}/{j}/{k}.stl" for place in "xy" for i in "12" for j in "12" for k in "ab"),
        )


def test_a_folder_for_each_group_gives_the_groups(tmp_path):
    cohort = cohort_of(tmp_path, "controls/c1.stl", "controls/c2.stl", "patients/p1.stl", "patients/p2.stl")
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [
        ("c1", "controls"), ("c2", "controls"), ("p1", "patients"), ("p2", "patients"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "place",
    ["{0}/p{1}.nii.gz", "{0}/{0}_p{1}.nii.gz", "{0}/p{1}_{0}.stl", "{0}/p{1}/mask.nii.gz", "x/{0}/p{1}.ply"],
)
def test_a_folder_for_each_structure_of_the_same_subjects_gives_their_structures(tmp_path, place):
    names = [place.format(item, i) for item in ("liver", "spleen") for i in (1, 2, 3)]
    cohort = cohort_of(tmp_path, *names[:-1], "CT/p1.txt")
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2", "p3"]
    counts = {item.name: len(item.by_subject) for item in structures_of_files(cohort)}
    assert counts == {"liver": 3, "spleen": 2}
    assert mask_files(cohort.subjects[0].path)["spleen"] == tmp_path / names[3]


def test_folders_of_groups_may_have_files_of_the_same_names(tmp_path):
    cohort = cohort_of(tmp_path, *(f"{group}/s{i}.stl" for group in ("controls", "patients") for i in (1, 2)))
    assert {subject.name: subject.group for subject in cohort.subjects} == {
        f"s{i}_{group}": group for group in ("controls", "patients") for i in (1, 2)
    }


def test_parts_of_a_data_set_are_taken_together(tmp_path):
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


def test_parts_of_a_data_set_without_label_maps_are_left_out(tmp_path):
    names = ["train/img/img1.nii.gz", "train/label/label1.nii.gz", "train/label/label2.nii.gz"]
    cohort = cohort_of(tmp_path, *names, "test/img/img3.nii.gz", "test/img/img4.nii.gz")
    assert [subject.name for subject in cohort.subjects] == ["label1", "label2"]


@pytest.mark.parametrize("above", ["T1/T1_first/", "T1_first/", "a/b/c/", "structure_label/", ""])
def test_a_subjects_files_may_lie_several_folders_deeper(tmp_path, above):
    names = [f"{i}/{above}T1_{kind}" for i in (11, 12) for kind in ("all_firstseg.nii.gz", "first.com")]
    cohort = cohort_of(tmp_path / "study" / "part", *names)
    assert [subject.name for subject in read_cohort(tmp_path).subjects] == ["11", "12"]
    assert [*files_of(cohort).values()] == names[::2]


def test_a_map_of_all_structures_in_a_folder_below_goes_before_a_mask(tmp_path):
    names = [
        f"{i}/T1/{item}.nii.gz"
        for i in (1, 2)
        for item in ("T1", "T1_brain_mask", "T1_first/T1_all_firstseg")
    ]
    assert [subject.path.name for subject in cohort_of(tmp_path, *names).subjects] == [
        "T1_all_firstseg.nii.gz"
    ] * 2


def test_folders_of_slices_are_a_patients_structures(tmp_path):
    for patient in ("p1", "p2"):
        for place in ("PATIENT_DICOM", "LABELLED_DICOM", "MASKS_DICOM/liver", "MASKS_DICOM/spleen"):
            dicom(tmp_path / patient / place / "image_0")
    cohort = read_cohort(tmp_path)
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2"]
    assert mask_files(cohort.subjects[1].path) == {
        item: tmp_path / "p2" / "MASKS_DICOM" / item for item in ("liver", "spleen")
    }


def test_a_surface_in_two_formats_is_one_subject(tmp_path):
    cohort = cohort_of(tmp_path, *(f"s{i}.{kind}" for i in (1, 2) for kind in ("stl", "ply")))
    assert files_of(cohort) == {"s1": "s1.ply", "s2": "s2.ply"}
    assert "s1.stl, s2.stl" in cohort.notes[0]


def test_the_data_set_s_name_above_a_subject_s_folder_is_no_part_of_structures_names(tmp_path):
    names = [f"ibsr/IBSR_0{i}/IBSR_0{i}_{item}.nii.gz" for i in (1, 2) for item in ("seg", "segTRI")]
    cohort = cohort_of(tmp_path, *names)
    assert [*mask_files(cohort.subjects[0].path)] == ["seg", "segTRI"]


def test_what_is_no_segmentation_is_named_in_the_refusal(tmp_path):
    with pytest.raises(InputError, match=r"\.jpg \(2\), \.zip \(1\)"):
        cohort_of(tmp_path, "a/1.jpg", "a/2.jpg", "b.zip")


def test_folders_with_files_of_the_same_subjects_are_no_groups(tmp_path):
    ends = {"labels_native": "", "myo_iso": "_myo"}
    with pytest.raises(InputError, match=r"labels_native \(2\), myo_iso \(2\); give one of them"):
        cohort_of(tmp_path, *(f"{item}/p0{i}_ED{end}.nrrd" for item, end in ends.items() for i in (1, 2)))


def test_several_structures_of_each_subject_in_one_folder_are_told_apart_by_their_names(tmp_path):
    files = [f"p{i}_{item}.nii.gz" for item in ("liver", "spleen", "ct") for i in (1, 2, 10)]
    cohort = cohort_of(tmp_path, *files, "p1_kidney_left.nii.gz")
    assert [(subject.name, subject.image.name) for subject in cohort.subjects] == [
        (f"p{i}", f"p{i}_ct.nii.gz") for i in (1, 10, 2)
    ]
    masks = [mask_files(subject.path) for subject in cohort.subjects]
    assert [*map(list, masks)] == [
        ["kidney_left", "liver", "spleen"],
        ["liver", "spleen"],
        ["liver", "spleen"],
    ]
    assert masks[1]["spleen"] == tmp_path / "p10_spleen.nii.gz"
    assert len(cohort.notes) == 1
    counts = {item.name: len(item.by_subject) for item in structures_of_files(cohort)}
    assert counts == {"liver": 3, "spleen": 3, "kidney_left": 1}


def test_a_scan_beside_the_only_structure_in_one_folder_is_no_subject(tmp_path):
    cohort = cohort_of(tmp_path, *(f"p{i}_{item}.nii.gz" for item in ("liver", "ct") for i in (1, 2, 3)))
    assert [(subject.name, subject.image.name) for subject in cohort.subjects] == [
        (f"p{i}_liver", f"p{i}_ct.nii.gz") for i in (1, 2, 3)
    ]


@pytest.mark.parametrize(
    "ends", [("_L", "_R"), ("_ED", "_ES"), ("_pre", "_post"), ("_femur_left", "_femur_right")]
)
def test_sides_and_times_in_one_folder_are_subjects(tmp_path, ends):
    cohort = cohort_of(tmp_path, *(f"p{i}{end}.nii.gz" for i in (1, 2, 3) for end in ends))
    assert len(cohort.subjects) == 6


def test_meshes_beside_segmentations_of_their_names_are_left_out(tmp_path):
    cohort = cohort_of(tmp_path, *(f"h{i}{kind}" for i in (1, 2) for kind in (".nii.gz", ".stl")))
    assert files_of(cohort) == {"h1": "h1.nii.gz", "h2": "h2.nii.gz"}
    assert "h1.stl" in cohort.notes[0]


def test_a_folder_of_meshes_beside_one_of_segmentations_of_their_names_is_left_out(tmp_path):
    cohort = cohort_of(tmp_path, *(f"{kind}/h{i}{end}" for i in (1, 2) for kind, end in KINDS))
    assert files_of(cohort) == {"h1": "h1.nrrd", "h2": "h2.nrrd"}
    assert cohort.notes == ("skipped, next to files of the same names: meshes",)


def test_a_table_of_groups_only_belongs_to_the_files_beside_it(tmp_path):
    (tmp_path / "cohort.csv").write_text("participant_id,group\na,x\nb,y\n", encoding="utf-8")
    cohort = cohort_of(tmp_path, "a.nrrd", "b.nrrd")
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [("a", "x"), ("b", "y")]
    assert cohort.notes == ()


def test_a_table_of_another_name_is_left_alone_and_said(tmp_path):
    cohort = cohort_of(tmp_path, "a.stl", "b.stl", "Kohorte.csv", "~$Kohorte.xlsx")
    assert list(files_of(cohort)) == ["a", "b"]
    (note,) = cohort.notes
    assert "Kohorte.csv; " in note
    assert "cohort.csv" in note


@pytest.mark.parametrize(
    "heading",
    ["Kennung;Datei;Gruppe", "sujet;chemin;groupe", "paciente;archivo;grupo", "paziente;percorso;gruppo"],
)
def test_headings_may_be_in_another_language(tmp_path, heading):
    (tmp_path / "cohort.csv").write_text(f"{heading}\na;x.stl;1\nb;y.stl;2\n", encoding="utf-8-sig")
    result = cohort_of(tmp_path, "x.stl", "y.stl")
    assert [(subject.name, subject.path.name, subject.group) for subject in result.subjects] == [
        ("a", "x.stl", "1"),
        ("b", "y.stl", "2"),
    ]


@pytest.mark.parametrize("times", [("baseline", "followup"), ("2019-03-01", "2020-04-02")])
def test_folders_of_points_in_time_are_not_subjects_of_many_structures(tmp_path, times):
    names = [f"P{n}/{time}/{item}.nii.gz" for n in (1, 2, 3) for time in times for item in ("seg", "t1")]
    result = cohort_of(tmp_path, *names)
    assert files_of(result) == {
        f"P{n}_{time}": f"P{n}/{time}/seg.nii.gz" for n in (1, 2, 3) for time in times
    }


def test_folders_whose_names_differ_by_the_side_are_sides(tmp_path):
    result = cohort_of(tmp_path, *(f"femur_{side}/{n:02d}.stl" for side in "LR" for n in (1, 2)))
    assert {subject.name: subject.columns["side"] for subject in result.subjects} == {
        "01_L": "L", "02_L": "L", "01_R": "R", "02_R": "R",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("mask", "scan"),
    [
        ("{}/Segmentierung.nii.gz", "{}/MRT.nii.gz"),
        ("Masken/{}.nii.gz", "Bilder/{}.nii.gz"),
        ("{}_Maske.nii.gz", "{}.nii.gz"),
        ("{}/masque.nii.gz", "{}/IRM_t1.nii.gz"),
        ("mascaras/{}.nii.gz", "imagenes/{}.nii.gz"),
    ],
)
def test_masks_beside_scans_may_be_named_in_another_language(tmp_path, mask, scan):
    result = cohort_of(tmp_path, *(text.format(n) for n in ("a1", "a2", "a3") for text in (mask, scan)))
    assert [subject.path for subject in result.subjects] == [
        tmp_path / mask.format(n) for n in ("a1", "a2", "a3")
    ]


def test_columns_of_a_table_may_have_other_names(tmp_path):
    (tmp_path / "cohort.csv").write_text("Subject_ID;File;group\nx;a.nrrd;A\n", encoding="utf-8")
    (first,) = cohort_of(tmp_path, "a.nrrd").subjects
    assert (first.name, first.path, first.group, dict(first.columns)) == ("x", tmp_path / "a.nrrd", "A", {})


def test_a_subjects_structures_are_named_without_the_names_of_its_folders(tmp_path):
    names = [f"sub-1/ses-2/anat/sub-1_ses-2_{item}.nii.gz" for item in ("liver", "spleen")]
    cohort_of(tmp_path, *names)
    assert set(mask_files(tmp_path / "sub-1" / "ses-2" / "anat")) == {"liver", "spleen"}


@pytest.mark.parametrize("places", [("", ""), ("study/ct/", "study/seg/")])
def test_a_dicom_seg_beside_the_scan_is_the_subject(tmp_path, places):
    for patient in ("p1", "p2"):
        for index in range(3):
            dicom(tmp_path / patient / f"{places[0]}{index}.dcm")
        dicom(tmp_path / patient / f"{places[1]}heart.dcm", b"1.2.840.10008.5.1.4.1.1.66.4")
    assert files_of(read_cohort(tmp_path)) == {
        patient: f"{patient}/{places[1]}heart.dcm" for patient in ("p1", "p2")
    }


def test_surfaces_of_brains_are_subjects_with_sides(tmp_path):
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


def test_names_without_numbers_end_with_the_structure(tmp_path):
    names = [f"{who}_{item}.stl" for who in ("anna", "bert", "carl") for item in ("femur", "tibia")]
    cohort = cohort_of(tmp_path, *names)
    assert {subject.name: [*mask_files(subject.path)] for subject in cohort.subjects} == {
        who: ["femur", "tibia"] for who in ("anna", "bert", "carl")
    }


def test_structures_before_numbers_may_be_groups_and_get_a_note(tmp_path):
    cohort = cohort_of(tmp_path, *(f"{item}_{i}.nrrd" for item in ("liver", "spleen") for i in (1, 2, 3)))
    assert len(cohort.subjects) == 6
    assert "liver, spleen" in cohort.notes[0]
    assert not cohort_of(tmp_path / "b", *(f"liver_{i}.nrrd" for i in (1, 2, 3))).notes


def test_a_folder_for_each_side_gives_the_sides(tmp_path):
    cohort = cohort_of(tmp_path, *(f"{side}/f{i}.stl" for side in ("left", "right") for i in (1, 2)))
    assert sides_of(cohort).of == {f"f{i}_{side}": side for side in ("left", "right") for i in (1, 2)}
    assert len(cohort.subjects) == 4


def test_scans_of_benchmarks_are_no_structures(tmp_path):
    kits = [f"case_{i}/{kind}.nii.gz" for i in (1, 2) for kind in ("imaging", "segmentation")]
    oasis = [f"OAS_{i}/{kind}.nii.gz" for i in (3, 4) for kind in ("aligned_norm", "aligned_seg35")]
    cohort = [subject.path.name for subject in cohort_of(tmp_path, *kits, *oasis).subjects]
    assert cohort == ["aligned_seg35.nii.gz"] * 2 + ["segmentation.nii.gz"] * 2


@pytest.mark.parametrize("times", [("visit1", "visit2"), ("baseline", "followup")])
def test_folders_of_points_in_time_with_a_file_for_each_patient_are_groups(tmp_path, times):
    cohort = cohort_of(tmp_path, *(f"{time}/pat{i}.nii.gz" for time in times for i in range(3)))
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [
        (f"pat{i}_{time}", time) for time in times for i in range(3)
    ]


@pytest.mark.parametrize("sites", [("siteA", "siteB"), ("site1", "site2"), ("boston", "kyoto")])
@pytest.mark.parametrize("scans", [[], ["images"]])
def test_sites_with_a_folder_of_label_maps_each_are_groups(tmp_path, sites, scans):
    names = [
        f"{site}/{kind}/{n:02d}.nii.gz" for site in sites for kind in ("labels", *scans) for n in range(3)
    ]
    cohort = cohort_of(tmp_path, *names)
    assert {subject.name: (subject.group, subject.path.parent.name) for subject in cohort.subjects} == {
        f"{n:02d}_{site}": (site, "labels") for site in sites for n in range(3)
    }


@pytest.mark.parametrize("parts", [("rater1", "rater2"), ("batch_1", "batch_2"), ("AD", "CN"), ("F", "M")])
def test_numbered_parts_and_diagnoses_with_files_of_the_same_names_are_groups(tmp_path, parts):
    cohort = cohort_of(tmp_path, *(f"{part}/P{n}.nii.gz" for part in parts for n in range(3)))
    assert {subject.name: subject.group for subject in cohort.subjects} == {
        f"P{n}_{part}": part for part in parts for n in range(3)
    }


def test_folders_of_sides_in_a_subjects_folder_are_subjects(tmp_path):
    cohort = cohort_of(tmp_path, *(f"P{n}/{side}/femur.stl" for n in (1, 2) for side in ("left", "right")))
    assert sides_of(cohort).of == {f"P{n}_{side}": side for n in (1, 2) for side in ("left", "right")}


def test_sides_within_words_are_no_structures(tmp_path):
    cohort = cohort_of(tmp_path, *(f"P{n}_Femur{side}.stl" for n in (1, 2, 3) for side in ("Left", "Right")))
    assert len(cohort.subjects) == len(sides_of(cohort).of) == 6
    names = [f"{side}Femur{n}.stl" for n in (1, 2, 3) for side in ("left", "right")]
    assert not cohort_of(tmp_path / "b", *names).notes


@pytest.mark.parametrize("place", ["{}/CT/0.dcm", "{}/0.dcm"])
def test_a_mask_goes_before_the_dicom_slices_beside_it(tmp_path, place):
    for patient in ("p1", "p2", "p3"):
        dicom(tmp_path / place.format(patient))
    cohort = cohort_of(tmp_path, "p1/liver.nii.gz", "p2/liver.nii.gz")
    assert files_of(cohort) == {"p1": "p1/liver.nii.gz", "p2": "p2/liver.nii.gz"}
    assert "p3" in " ".join(cohort.notes)


def test_several_label_maps_of_a_freesurfer_subject_are_structures(tmp_path):
    cohort = cohort_of(tmp_path, *(f"s{n}/mri/{side}h.hippo.mgz" for n in (1, 2) for side in "lr"))
    assert [*mask_files(cohort.subjects[0].path)] == ["lh.hippo", "rh.hippo"]


def test_scans_of_nnunet_beside_label_maps_are_their_scans(tmp_path):
    cohort = cohort_of(tmp_path, *(f"c_{n}{end}.nii.gz" for n in (1, 2) for end in ("", "_0000", "_0001")))
    assert [(subject.name, subject.image is not None) for subject in cohort.subjects] == [
        ("c_1", True),
        ("c_2", True),
    ]


def test_folders_that_are_not_used_beside_files_get_a_note(tmp_path):
    names = ("P1.stl", "P2.stl", "old/P1.stl", "images/P1.nii", "project/groomed/P1.vtp")
    cohort = cohort_of(tmp_path, *names, "project/project.json")
    assert len(cohort.subjects) == 2
    assert [word in cohort.notes[0] for word in ("old", "images", "project")] == [True, False, False]
