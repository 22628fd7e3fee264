"""Folders below a cohort's: groups, sides, times, structures, tables."""

import os
from pathlib import Path

import pytest

from homolog.cohort import mask_files, read_cohort, sides_of, with_both_sides
from homolog.errors import InputError
from homolog.io.structures import structures_of_files

ENDS = ("first", "corr", "flirt")
KINDS = (("labels", ".nrrd"), ("meshes", ".ply"))


@pytest.mark.parametrize(
    ("scan", "mask", "name"),
    [
        ("case{}.nii.gz", "case{}_seg.nii.gz", "case{}"),
        ("L1_{}_ct.nii.gz", "L1_{}.nii.gz", "L1_{}"),
        ("ct_{}.nrrd", "mask_{}.nrrd", "mask_{}"),
        ("p{}_t2_tse_tra.nii.gz", "p{}_seg.nii.gz", "p{}_seg"),
        ("p{}_CT.nii.gz", "p{} Segmentation.seg.nrrd", "p{} Segmentation"),
    ],
)
def test_scans_beside_label_maps_are_their_scans_and_no_subjects(tmp_path, scan, mask, name, cohort_of):
    cohort = cohort_of(tmp_path, *(text.format(i) for i in (1, 2) for text in (scan, mask)))
    assert [(subject.name, subject.path.name, subject.image.name) for subject in cohort.subjects] == [
        (name.format(i), mask.format(i), scan.format(i)) for i in (1, 2)
    ]
    assert scan.format(1) in cohort.notes[0]


def test_points_in_time_of_one_patient_are_subjects(tmp_path, cohort_of, files_of):
    names = [f"p{i}/p{i}_frame{k}{kind}.nii.gz" for i in (1, 2) for k in ("01", "12") for kind in ("", "_gt")]
    cohort = cohort_of(tmp_path, *names, "p1/p1_4d.nii.gz", "p1/Info.cfg")
    assert files_of(cohort) == {
        f"p{i}_frame{k}_gt": f"p{i}/p{i}_frame{k}_gt.nii.gz" for i in (1, 2) for k in ("01", "12")
    }


def test_files_one_folder_deeper_are_their_patients(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, *(f"p{i}/2020-0{i}/heart.nii.gz" for i in (1, 2)))
    assert files_of(cohort) == {f"p{i}": f"p{i}/2020-0{i}/heart.nii.gz" for i in (1, 2)}
    (tmp_path / "p3" / "empty").mkdir(parents=True)
    assert read_cohort(tmp_path).notes == ("skipped, without a segmentation or mesh: p3",)
    with pytest.raises(InputError, match=r"several .*: x, y"):
        cohort_of(
            tmp_path / "p3",
            *(f"{place}/p{i}/{j}/{k}.stl" for place in "xy" for i in "12" for j in "12" for k in "ab"),
        )


def test_a_folder_for_each_group_gives_the_groups(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, "controls/c1.stl", "controls/c2.stl", "patients/p1.stl", "patients/p2.stl")
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [
        ("c1", "controls"), ("c2", "controls"), ("p1", "patients"), ("p2", "patients"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "place",
    ["{0}/p{1}.nii.gz", "{0}/{0}_p{1}.nii.gz", "{0}/p{1}_{0}.stl", "{0}/p{1}/mask.nii.gz", "x/{0}/p{1}.ply"],
)
def test_a_folder_for_each_structure_of_the_same_subjects_gives_their_structures(tmp_path, place, cohort_of):
    names = [place.format(item, i) for item in ("liver", "spleen") for i in (1, 2, 3)]
    cohort = cohort_of(tmp_path, *names[:-1], "CT/p1.txt")
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2", "p3"]
    counts = {item.name: len(item.by_subject) for item in structures_of_files(cohort).structures}
    assert counts == {"liver": 3, "spleen": 2}
    assert mask_files(cohort.subjects[0].path)["spleen"] == tmp_path / names[3]


@pytest.mark.parametrize(
    "groups", [("controls", "patients"), ("Control Group", "Patients (AD)"), ("Kontrollen", "Hip dysplasia")]
)
def test_folders_of_groups_may_have_files_of_the_same_names(tmp_path, groups, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{group}/s{i}.stl" for group in groups for i in (1, 2)))
    assert {subject.name: subject.group for subject in cohort.subjects} == {
        f"s{i}_{group}": group for group in groups for i in (1, 2)
    }


@pytest.mark.parametrize("above", ["T1/T1_first/", "T1_first/", "a/b/c/", "structure_label/", ""])
def test_a_subjects_files_may_lie_several_folders_deeper(tmp_path, above, cohort_of, files_of):
    names = [f"{i}/{above}T1_{kind}" for i in (11, 12) for kind in ("all_firstseg.nii.gz", "first.com")]
    cohort = cohort_of(tmp_path / "study" / "part", *names)
    assert [subject.name for subject in read_cohort(tmp_path).subjects] == ["11", "12"]
    assert [*files_of(cohort).values()] == names[::2]


def test_a_map_of_all_structures_in_a_folder_below_goes_before_a_mask(tmp_path, cohort_of):
    names = [
        f"{i}/T1/{item}.nii.gz"
        for i in (1, 2)
        for item in ("T1", "T1_brain_mask", "T1_first/T1_all_firstseg")
    ]
    assert [subject.path.name for subject in cohort_of(tmp_path, *names).subjects] == [
        "T1_all_firstseg.nii.gz"
    ] * 2


def test_a_surface_in_two_formats_is_one_subject(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, *(f"s{i}.{kind}" for i in (1, 2) for kind in ("stl", "ply")))
    assert files_of(cohort) == {"s1": "s1.ply", "s2": "s2.ply"}
    assert "s1.stl, s2.stl" in cohort.notes[0]


def test_what_is_no_segmentation_is_named_in_the_refusal(tmp_path, cohort_of):
    with pytest.raises(InputError, match=r"\.jpg \(2\), \.zip \(1\)"):
        cohort_of(tmp_path, "a/1.jpg", "a/2.jpg", "b.zip")


def test_folders_with_files_of_the_same_subjects_are_no_groups(tmp_path, cohort_of):
    ends = {"labels_native": "", "myo_iso": "_myo"}
    with pytest.raises(InputError, match=r"labels_native \(2\), myo_iso \(2\); give one of them"):
        cohort_of(tmp_path, *(f"{item}/p0{i}_ED{end}.nrrd" for item, end in ends.items() for i in (1, 2)))


def test_several_structures_of_each_subject_in_one_folder_are_told_apart_by_their_names(tmp_path, cohort_of):
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
    counts = {item.name: len(item.by_subject) for item in structures_of_files(cohort).structures}
    assert counts == {"liver": 3, "spleen": 3, "kidney_left": 1}


def test_a_scan_beside_the_only_structure_in_one_folder_is_no_subject(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"p{i}_{item}.nii.gz" for item in ("liver", "ct") for i in (1, 2, 3)))
    assert [(subject.name, subject.image.name) for subject in cohort.subjects] == [
        (f"p{i}_liver", f"p{i}_ct.nii.gz") for i in (1, 2, 3)
    ]


@pytest.mark.parametrize(
    "ends", [("_L", "_R"), ("_ED", "_ES"), ("_pre", "_post"), ("_femur_left", "_femur_right")]
)
def test_sides_and_times_in_one_folder_are_subjects(tmp_path, ends, cohort_of):
    cohort = cohort_of(tmp_path, *(f"p{i}{end}.nii.gz" for i in (1, 2, 3) for end in ends))
    assert len(cohort.subjects) == 6


def test_meshes_beside_segmentations_of_their_names_are_left_out(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, *(f"h{i}{kind}" for i in (1, 2) for kind in (".nii.gz", ".stl")))
    assert files_of(cohort) == {"h1": "h1.nii.gz", "h2": "h2.nii.gz"}
    assert "h1.stl" in cohort.notes[0]


def test_a_folder_of_meshes_beside_one_of_segmentations_is_left_out(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, *(f"{kind}/h{i}{end}" for i in (1, 2) for kind, end in KINDS))
    assert files_of(cohort) == {"h1": "h1.nrrd", "h2": "h2.nrrd"}
    assert cohort.notes == ("skipped, next to files with the same names: meshes",)


def test_a_table_of_groups_only_belongs_to_the_files_beside_it(tmp_path, cohort_of):
    (tmp_path / "cohort.csv").write_text("participant_id,group\na,x\nb,y\n", encoding="utf-8")
    cohort = cohort_of(tmp_path, "a.nrrd", "b.nrrd")
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [("a", "x"), ("b", "y")]
    assert cohort.notes == ()


def test_a_table_of_another_name_is_left_alone_and_said(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, "a.stl", "b.stl", "Kohorte.csv", "~$Kohorte.xlsx")
    assert list(files_of(cohort)) == ["a", "b"]
    (note,) = cohort.notes
    assert "Kohorte.csv; " in note
    assert "cohort.csv" in note


def test_a_table_of_labels_is_no_table_of_subjects_that_is_not_used(tmp_path, cohort_of):
    (tmp_path / "dseg.tsv").write_text("index\tname\n1\tliver\n", encoding="utf-8")
    assert cohort_of(tmp_path, "a.nii.gz", "b.nii.gz").notes == ()


@pytest.mark.parametrize(
    "heading",
    ["Kennung;Datei;Gruppe", "sujet;chemin;groupe", "paciente;archivo;grupo", "paziente;percorso;gruppo"],
)
def test_headings_may_be_in_another_language(tmp_path, heading, cohort_of):
    (tmp_path / "cohort.csv").write_text(f"{heading}\na;x.stl;1\nb;y.stl;2\n", encoding="utf-8-sig")
    result = cohort_of(tmp_path, "x.stl", "y.stl")
    assert [(subject.name, subject.path.name, subject.group) for subject in result.subjects] == [
        ("a", "x.stl", "1"),
        ("b", "y.stl", "2"),
    ]


@pytest.mark.parametrize("place", ["D:\\Study\\seg\\", "/home/someone/study/seg/", "\\\\server\\seg\\"])
def test_absolute_paths_of_another_computer_are_found_by_their_ends(tmp_path, place, cohort_of, files_of):
    (tmp_path / "cohort.csv").write_text(f"name,path\na,{place}p1.stl\nb,{place}p2.stl\n", encoding="utf-8")
    cohort = cohort_of(tmp_path, "seg/p1.stl", "seg/p2.stl", "p2.stl")
    assert files_of(cohort) == {"a": "seg/p1.stl", "b": "seg/p2.stl"}
    (note,) = cohort.notes
    assert f"2 of 2, such as {place}p1.stl: seg/p1.stl" in note


@pytest.mark.parametrize("times", [("baseline", "followup"), ("2019-03-01", "2020-04-02")])
def test_folders_of_points_in_time_are_not_subjects_of_many_structures(tmp_path, times, cohort_of, files_of):
    names = [f"P{n}/{time}/{item}.nii.gz" for n in (1, 2, 3) for time in times for item in ("seg", "t1")]
    result = cohort_of(tmp_path, *names)
    assert files_of(result) == {
        f"P{n}_{time}": f"P{n}/{time}/seg.nii.gz" for n in (1, 2, 3) for time in times
    }


def test_folders_whose_names_differ_by_the_side_are_sides(tmp_path, cohort_of):
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
def test_masks_beside_scans_may_be_named_in_another_language(tmp_path, mask, scan, cohort_of):
    result = cohort_of(tmp_path, *(text.format(n) for n in ("a1", "a2", "a3") for text in (mask, scan)))
    assert [subject.path for subject in result.subjects] == [
        tmp_path / mask.format(n) for n in ("a1", "a2", "a3")
    ]


def test_columns_of_a_table_may_have_other_names(tmp_path, cohort_of):
    (tmp_path / "cohort.csv").write_text("Subject_ID;File;group\nx;a.nrrd;A\n", encoding="utf-8")
    (first,) = cohort_of(tmp_path, "a.nrrd").subjects
    assert (first.name, first.path, first.group, dict(first.columns)) == ("x", tmp_path / "a.nrrd", "A", {})


def test_a_subjects_structures_are_named_without_the_names_of_its_folders(tmp_path, cohort_of):
    names = [f"sub-1/ses-2/anat/sub-1_ses-2_{item}.nii.gz" for item in ("liver", "spleen")]
    cohort_of(tmp_path, *names)
    assert set(mask_files(tmp_path / "sub-1" / "ses-2" / "anat")) == {"liver", "spleen"}


def test_names_without_numbers_end_with_the_structure(tmp_path, cohort_of):
    names = [f"{who}_{item}.stl" for who in ("anna", "bert", "carl") for item in ("femur", "tibia")]
    cohort = cohort_of(tmp_path, *names)
    assert {subject.name: [*mask_files(subject.path)] for subject in cohort.subjects} == {
        who: ["femur", "tibia"] for who in ("anna", "bert", "carl")
    }


def test_structures_before_numbers_may_be_groups_and_get_a_note(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{item}_{i}.nrrd" for item in ("liver", "spleen") for i in (1, 2, 3)))
    assert len(cohort.subjects) == 6
    assert "liver, spleen" in cohort.notes[0]
    assert not cohort_of(tmp_path / "b", *(f"liver_{i}.nrrd" for i in (1, 2, 3))).notes


def test_a_folder_for_each_side_gives_the_sides(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{side}/f{i}.stl" for side in ("left", "right") for i in (1, 2)))
    assert sides_of(cohort).of == {f"f{i}_{side}": side for side in ("left", "right") for i in (1, 2)}
    assert len(cohort.subjects) == 4


def test_scans_of_benchmarks_are_no_structures(tmp_path, cohort_of):
    kits = [f"case_{i}/{kind}.nii.gz" for i in (1, 2) for kind in ("imaging", "segmentation")]
    oasis = [f"OAS_{i}/{kind}.nii.gz" for i in (3, 4) for kind in ("aligned_norm", "aligned_seg35")]
    cohort = [subject.path.name for subject in cohort_of(tmp_path, *kits, *oasis).subjects]
    assert cohort == ["aligned_seg35.nii.gz"] * 2 + ["segmentation.nii.gz"] * 2


@pytest.mark.parametrize("times", [("visit1", "visit2"), ("baseline", "followup")])
def test_folders_of_points_in_time_with_a_file_for_each_patient_are_groups(tmp_path, times, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{time}/pat{i}.nii.gz" for time in times for i in range(3)))
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [
        (f"pat{i}_{time}", time) for time in times for i in range(3)
    ]


@pytest.mark.parametrize("sites", [("siteA", "siteB"), ("site1", "site2"), ("boston", "kyoto")])
@pytest.mark.parametrize("scans", [[], ["images"]])
def test_sites_with_a_folder_of_label_maps_each_are_groups(tmp_path, sites, scans, cohort_of):
    names = [
        f"{site}/{kind}/{n:02d}.nii.gz" for site in sites for kind in ("labels", *scans) for n in range(3)
    ]
    cohort = cohort_of(tmp_path, *names)
    assert {subject.name: (subject.group, subject.path.parent.name) for subject in cohort.subjects} == {
        f"{n:02d}_{site}": (site, "labels") for site in sites for n in range(3)
    }


@pytest.mark.parametrize("parts", [("rater1", "rater2"), ("batch_1", "batch_2"), ("AD", "CN"), ("F", "M")])
def test_numbered_parts_and_diagnoses_with_files_of_the_same_names_are_groups(tmp_path, parts, cohort_of):
    cohort = cohort_of(tmp_path, *(f"{part}/P{n}.nii.gz" for part in parts for n in range(3)))
    assert {subject.name: subject.group for subject in cohort.subjects} == {
        f"P{n}_{part}": part for part in parts for n in range(3)
    }


def test_folders_of_sides_in_a_subjects_folder_are_subjects(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"P{n}/{side}/femur.stl" for n in (1, 2) for side in ("left", "right")))
    assert sides_of(cohort).of == {f"P{n}_{side}": side for n in (1, 2) for side in ("left", "right")}


@pytest.mark.parametrize(("left", "right"), [("OS", "OD"), ("li", "re"), ("sin", "dex"), ("L", "R")])
def test_abbreviations_of_sides_count_if_both_occur(tmp_path, cohort_of, left, right):
    cohort = cohort_of(tmp_path, *(f"P{n}_orbit_{right if n % 2 else left}.nii.gz" for n in range(4)))
    assert list(sides_of(cohort).of.values()) == ["left", "right"] * 2


def test_an_abbreviation_that_may_mean_something_else_is_no_side_alone(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"P{n}_os_coxae.nii.gz" for n in range(4)))
    assert not sides_of(cohort).of


def test_sides_within_words_are_no_structures(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"P{n}_Femur{side}.stl" for n in (1, 2, 3) for side in ("Left", "Right")))
    assert len(cohort.subjects) == len(sides_of(cohort).of) == 6
    names = [f"{side}Femur{n}.stl" for n in (1, 2, 3) for side in ("left", "right")]
    assert not cohort_of(tmp_path / "b", *names).notes


def test_folders_that_are_not_used_beside_files_get_a_note(tmp_path, cohort_of):
    names = ("P1.stl", "P2.stl", "old/P1.stl", "images/P1.nii", "project/groomed/P1.vtp")
    cohort = cohort_of(tmp_path, *names, "project/project.json")
    assert len(cohort.subjects) == 2
    assert [word in cohort.notes[0] for word in ("old", "images", "project")] == [True, False, False]


@pytest.mark.parametrize(
    "files", [("left", "right"), ("hippocampus_L", "hippocampus_R"), ("{p}-lh", "{p}-rh")]
)
def test_files_of_both_sides_in_a_subject_s_folder_are_subjects(tmp_path, files, cohort_of):
    names = [f"p{i}/{file.format(p=f'p{i}')}.nii.gz" for i in (1, 2) for file in files]
    (tmp_path / "cohort.csv").write_text("name,group\np1,a\np2,b\n", encoding="utf-8")
    structures = cohort_of(tmp_path, *names[:-1])
    assert [subject.name for subject in structures.subjects] == ["p1", "p2"]
    cohort = with_both_sides(structures)
    assert [(subject.name, subject.group) for subject in cohort.subjects] == [
        ("p1_left", "a"), ("p1_right", "a"), ("p2_left", "b"),
    ]  # fmt: skip
    assert [subject.path for subject in cohort.subjects] == [tmp_path / name for name in names[:-1]]
    assert sides_of(cohort).of == {"p1_left": "left", "p1_right": "right", "p2_left": "left"}
    assert len(cohort.notes) == 1


@pytest.mark.parametrize(
    "files", [("liver", "spleen"), ("a_L", "a_R", "b_L", "b_R"), ("left",), ("L", "left")]
)
def test_files_of_several_structures_or_of_one_side_remain_to_choose(tmp_path, files, cohort_of):
    cohort = cohort_of(tmp_path, *(f"p{i}/{file}.nii.gz" for i in (1, 2) for file in files))
    assert with_both_sides(cohort) is cohort


def test_participants_of_bids_give_groups_and_covariates(tmp_path, cohort_of):
    text = "participant_id\tage\tgroup\nsub-01\t61\tpatient\nsub-02\tn/a\tn/a\nsub-09\t50\tcontrol\n"
    (tmp_path / "participants.tsv").write_text(text, encoding="utf-8")
    names = [f"sub-0{i}/anat/sub-0{i}_dseg.nii.gz" for i in (1, 2)]
    whole = cohort_of(tmp_path, *(f"derivatives/seg/{name}" for name in names))
    for cohort in (whole, read_cohort(tmp_path / "derivatives" / "seg")):
        assert [(subject.group, subject.columns["age"]) for subject in cohort.subjects] == [
            ("patient", "61"), (None, "n/a"),
        ]  # fmt: skip
        assert any("sub-09" in note for note in cohort.notes)


def test_participants_of_other_subjects_are_left_out_with_a_note(tmp_path, cohort_of):
    (tmp_path / "participants.tsv").write_text("participant_id\tage\nx\t1\n", encoding="utf-8")
    cohort = cohort_of(tmp_path, "a.stl", "b.stl")
    assert len(cohort.subjects) == 2
    assert "participants.tsv" in cohort.notes[0]


@pytest.mark.parametrize("place", ["{}.nii.gz", "{}/segmentations/liver.nii.gz"])
@pytest.mark.parametrize(
    "system",
    ["@eaDir/p9.nii.gz/x.nrrd", "__MACOSX/p9.nii.gz", "lost+found/p9.nii.gz", "$RECYCLE.BIN/p9.nii.gz"],
)
def test_folders_of_operating_systems_and_storage_hold_no_subjects(tmp_path, cohort_of, place, system):
    cohort = cohort_of(tmp_path, *(place.format(f"p{i}") for i in (1, 2, 3)), system)
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2", "p3"]
    assert not cohort.notes


@pytest.fixture
def forbidden(monkeypatch):
    """Make folders with a name unreadable; permissions do not hold for the administrator, who runs tests."""
    scandir = os.scandir

    def refuse(path="."):
        if Path(path).name.startswith("forbidden"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refuse)


@pytest.mark.parametrize("place", ["{}.nii.gz", "{}/liver.nii.gz", "{}/segmentations/liver.nii.gz"])
@pytest.mark.parametrize("where", ["forbidden/a.stl", "p1/forbidden/a.stl"])
@pytest.mark.usefixtures("forbidden")
def test_unreadable_folders_are_skipped_with_a_note(tmp_path, cohort_of, place, where):
    if place == "{}.nii.gz":
        where = where.replace("p1/", "other/")
    cohort = cohort_of(tmp_path, *(place.format(f"p{i}") for i in (1, 2, 3)), where)
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2", "p3"]
    assert [note for note in cohort.notes if where.removesuffix("/a.stl") in note and "Permission" in note]


def test_links_that_lead_nowhere_are_skipped_with_a_note(tmp_path, cohort_of):
    for name, target in (("p4.nrrd", tmp_path / "gone.nrrd"), ("p5.nrrd", tmp_path / "p5.nrrd")):
        (tmp_path / name).symlink_to(target)
    (tmp_path / "p6.nrrd").symlink_to(tmp_path / "p1.nrrd")
    cohort = cohort_of(tmp_path, *(f"p{i}.nrrd" for i in (1, 2, 3)))
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2", "p3", "p6"]
    assert [note for note in cohort.notes if "p4.nrrd, p5.nrrd" in note]


@pytest.mark.usefixtures("forbidden")
def test_a_folder_with_nothing_but_unreadable_folders_is_refused_with_the_reason(tmp_path):
    (tmp_path / "forbidden1").mkdir()
    with pytest.raises(InputError, match=r"no segmentation or mesh.*forbidden1"):
        read_cohort(tmp_path)


@pytest.mark.parametrize(
    ("masks", "scans"),
    [
        ("ribfrac-val-labels/RibFrac{}-label.nii.gz", "ribfrac-val-images/RibFrac{}-image.nii.gz"),
        ("TrainingMask/{}.nii.gz", "TrainingImg/{}_0000.nii.gz"),
        ("CT_masks/{}.nii.gz", "CT_volumes/{}.nii.gz"),
        ("Pelvic_masks/{}.nii.gz", "Pelvic/{}.nii.gz"),
        ("bones_Anonymized_mask/bones/b{}_mask.nii.gz", "bones_data/b{}_data.nii.gz"),
        ("nnUNet_raw/D1/labelsTr/b{}.nii.gz", "nnUNet_preprocessed/D1/gt_segmentations/b{}.nii.gz"),
        ("nnUNet_raw_data_base/raw/T1/labelsTr/b{}.nii.gz", "nnUNet_preprocessed/b{}.nii.gz"),
    ],
)
def test_folders_of_a_named_data_set_are_told_by_the_other_words(tmp_path, masks, scans, cohort_of, files_of):
    cohort = cohort_of(tmp_path, *(text.format(i) for i in (1, 2, 3) for text in (masks, scans)))
    assert {(tmp_path / masks.format(i)) for i in (1, 2, 3)} == {item.path for item in cohort.subjects}


def test_masks_of_several_structures_in_folders_named_like_them_stay_structures(tmp_path, cohort_of):
    places = [f"{kind}_masks/p{i}.nii.gz" for kind in ("liver", "spleen") for i in (1, 2, 3)]
    assert set(mask_files(cohort_of(tmp_path, *places).subjects[0].path)) == {"liver_masks", "spleen_masks"}


def test_numbered_patients_have_folders_of_structures(tmp_path, cohort_of):
    places = [f"S{i}/{kind}/{kind.lower()}.nii.gz" for i in (1, 2, 3) for kind in ("Femur", "Tibia")]
    cohort = cohort_of(tmp_path, *places)
    assert [item.name for item in cohort.subjects] == ["S1", "S2", "S3"]
    assert set(mask_files(cohort.subjects[0].path)) == {"Femur", "Tibia"}


def test_numbered_batches_of_training_and_testing_are_groups(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"Training Batch {k}/seg-{i}{k}.nii" for i in (1, 2) for k in (1, 2)))
    assert {item.group for item in cohort.subjects} == {"Training Batch 1", "Training Batch 2"}


@pytest.mark.parametrize("visits", [("T0", "T1", "T2"), ("m00", "m12"), ("bl", "m06")])
def test_visits_from_the_first_on_are_subjects_and_no_scans_or_structures(tmp_path, cohort_of, visits):
    cohort = cohort_of(tmp_path, *(f"P{i}/{visit}/lh.nii.gz" for i in (1, 2, 3) for visit in visits))
    assert [item.name for item in cohort.subjects] == [f"P{i}_{visit}" for i in (1, 2, 3) for visit in visits]


@pytest.mark.parametrize(
    ("scan", "mask"), [("p{}.nii", "labels/p{}.nii"), ("scan_{}.nii", "masks/seg_{}.nii")]
)
def test_label_maps_below_their_scans_are_the_subjects(tmp_path, cohort_of, scan, mask):
    cohort = cohort_of(tmp_path, *(text.format(i) for i in (1, 2) for text in (scan, mask)))
    assert [item.path for item in cohort.subjects] == [tmp_path / mask.format(i) for i in (1, 2)]
    assert mask.partition("/")[0] in cohort.notes[0]


def test_one_more_mask_below_many_label_maps_does_not_replace_them(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"p{i}.nii" for i in (1, 2, 3)), "masks/p1.nii")
    assert len(cohort.subjects) == 3
    assert "masks" in cohort.notes[0]


def test_numbers_that_follow_mask_and_image_at_once_are_of_the_subject(tmp_path, cohort_of):
    cohort = cohort_of(tmp_path, *(f"liver-{kind}{i:03d}.nrrd" for i in (1, 2) for kind in ("orig", "seg")))
    assert [item.path.name for item in cohort.subjects] == ["liver-seg001.nrrd", "liver-seg002.nrrd"]
    assert cohort.subjects[0].image.name == "liver-orig001.nrrd"


def test_two_versions_of_the_label_maps_are_not_combined(tmp_path, cohort_of):
    places = [f"masks_{kind}/p{i}.nrrd" for i in (1, 2, 3) for kind in ("final", "old")]
    with pytest.raises(InputError, match=r"masks_final \(3\), masks_old \(3\); give one"):
        cohort_of(tmp_path, *places)


def test_files_are_read_once_if_they_are_also_compressed(tmp_path, cohort_of, files_of):
    cohort = cohort_of(tmp_path, *(f"p{i}.nii{end}" for i in (1, 2) for end in ("", ".gz")))
    assert files_of(cohort) == {f"p{i}": f"p{i}.nii.gz" for i in (1, 2)}
    assert "p1.nii" in cohort.notes[0]
