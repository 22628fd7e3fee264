"""Structures of a cohort, however its files are laid out."""

import json

import nibabel
import numpy as np
import pytest

from homolog.cohort import Subject, read_cohort
from homolog.errors import InputError
from homolog.grooming import check_cohort
from homolog.grooming.subject import read_source
from homolog.io.images import read_volume
from homolog.io.structures import (
    chosen_structures,
    list_structures,
    structures_of,
    structures_of_files,
)
from homolog.settings import GroomSettings

BRAIN = {17: "Left-Hippocampus", 53: "Right-Hippocampus", 4: "Left-Lateral-Ventricle"}


@pytest.fixture
def brain():
    """Return FreeSurfer's labels of two hippocampi and a ventricle that is cut off."""
    values = np.zeros((16, 18, 20), np.int32)
    values[3:7, 4:8, 5:9] = 17
    values[9:13, 4:8, 5:10] = 53
    values[3:7, 12:, 5:9] = 4
    return values


@pytest.fixture
def nifti(tmp_path):
    """Write labels as NIfTI, with names in an extension if they are given, and return the path."""

    def write(name, values, names=None, spacing=1.0):
        image = nibabel.Nifti1Image(values, np.diag([spacing, spacing, spacing, 1.0]))
        if names:
            entries = "".join(
                f'<Label Key="{value}" Red="1.0" Green="0" Blue="0" Alpha="1"><![CDATA[{item}]]></Label>\n'
                for value, item in names.items()
            )
            text = (
                f"<?xml version='1.0'?> <CaretExtension><VolumeInformation><LabelTable>{entries}</LabelTable>"
            )
            image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, text.encode()))
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        nibabel.save(image, path)
        return path

    return write


def ball(radius=5, size=16, at=8):
    grid = np.indices((size, size, size)) - at
    return (np.square(grid).sum(axis=0) <= radius**2).astype(np.uint8)


@pytest.mark.parametrize("suffix", ["mgz", "mgh"])
@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.int32, np.float32])
def test_freesurfers_volumes_lie_where_nibabel_puts_them(tmp_path, brain, suffix, kind):
    turn = np.array([[-1.0, 0.0, 0.0, 9.0], [0.0, 0.0, 1.5, -8.0], [0.0, -2.0, 0.0, 7.0], [0, 0, 0, 1]])
    values = np.minimum(brain, 250).astype(kind)
    nibabel.save(nibabel.MGHImage(values, turn), tmp_path / f"aseg.{suffix}")
    result = read_source(Subject("a", tmp_path / f"aseg.{suffix}"), GroomSettings(label=17))
    inside = np.argwhere(result.mask) * result.spacing @ result.rotation.T + result.origin
    expected = np.argwhere(values == 17) @ turn[:3, :3].T + turn[:3, 3]
    expected = expected * [-1.0, -1.0, 1.0]
    order = [item[np.lexsort(np.round(item, 3).T)] for item in (inside, expected)]
    assert np.allclose(*order, atol=1e-3)


@pytest.mark.parametrize("cut", [10, 200, 2000])
def test_a_freesurfer_volume_that_is_cut_short_is_refused(tmp_path, brain, cut):
    nibabel.save(nibabel.MGHImage(brain, np.eye(4)), tmp_path / "aseg.mgh")
    (tmp_path / "aseg.mgh").write_bytes((tmp_path / "aseg.mgh").read_bytes()[:cut])
    with pytest.raises(InputError, match=r"is cut short|is not a readable image"):
        read_volume(tmp_path / "aseg.mgh")


def test_a_freesurfer_volume_whose_name_says_wrongly_whether_it_is_packed_is_read(tmp_path, brain):
    nibabel.save(nibabel.MGHImage(brain, np.eye(4)), tmp_path / "a.mgz")
    (tmp_path / "a.mgz").rename(tmp_path / "a.mgh")
    volume = read_volume(tmp_path / "a.mgh")
    assert np.array_equal(np.sort(np.unique(volume.layers[0])), np.unique(brain))
    assert volume.notes


@pytest.mark.parametrize(
    "name", ["Left-Hippocampus", "hippocampus-left", "HIPPOCAMPUS_LEFT", "l hippocampus"]
)
def test_a_structure_is_found_by_name_in_freesurfers_list_with_a_note(nifti, brain, name):
    result = read_source(Subject("a", nifti("a.nii.gz", brain)), GroomSettings(segment=name))
    assert (result.name, result.mask.sum()) == ("Left-Hippocampus", 64)
    assert any("FreeSurfer" in note for note in result.notes)


def test_the_names_in_a_files_extension_go_before_every_table(nifti, brain, tmp_path):
    (tmp_path / "names.json").write_text(json.dumps({"17": "wrong", "53": "also wrong"}))
    path = nifti("a.nii.gz", brain, {17: "liver", 53: "spleen &amp; co"})
    result = read_source(Subject("a", path), GroomSettings(segment="LIVER"))
    assert (result.mask.sum(), result.notes) == (64, ())
    assert [item.name for item in structures_of(Subject("a", path))] == ["liver", "spleen &amp; co", ""]


def test_an_unknown_name_is_refused_with_near_ones(nifti, brain):
    with pytest.raises(InputError, match=r"'hippocampus'; similar names: Left-Hippocampus"):
        read_source(Subject("a", nifti("a.nii.gz", brain)), GroomSettings(segment="hippocampus"))


def test_a_name_of_the_list_without_voxels_is_said_to_have_none(nifti, brain):
    with pytest.raises(InputError, match="'left amygdala'"):
        read_source(Subject("a", nifti("a.nii.gz", brain)), GroomSettings(segment="left amygdala"))


def test_a_name_where_nothing_gives_names_is_refused_with_the_remedy(nifti):
    path = nifti("a.nii.gz", ball())
    with pytest.raises(InputError, match="table of the labels' names"):
        read_source(Subject("a", path), GroomSettings(segment="liver"))


def test_structures_are_listed_with_volumes_and_the_border(nifti, brain):
    result = {item.name: item for item in structures_of(Subject("a", nifti("a.nii.gz", brain, spacing=2.0)))}
    assert result["Left-Hippocampus"].volume == pytest.approx(64 * 8 / 1000)
    assert {name: item.at_border for name, item in result.items()} == {
        "Left-Hippocampus": False,
        "Right-Hippocampus": False,
        "Left-Lateral-Ventricle": True,
    }


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint32, np.uint64, np.int64, np.float32, np.float64])
def test_labels_of_any_kind_of_number_are_counted_alike(tmp_path, kind):
    values = np.zeros((8, 9, 10), kind)
    values[1:3, 2:4, 3:5] = 3
    values[5:7, 2:4, 3:6] = 200
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4), dtype=values.dtype), tmp_path / "a.nii.gz")
    result = structures_of(Subject("a", tmp_path / "a.nii.gz"))
    assert [(item.value, round(item.volume * 1000)) for item in result] == [(3, 8), (200, 12)]


def test_large_and_negative_values_are_counted_too(tmp_path):
    values = np.full((8, 9, 10), -5, np.int32)
    values[1:3, 2:4, 3:5] = 2_000_000
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "a.nii.gz")
    assert [item.value for item in structures_of(Subject("a", tmp_path / "a.nii.gz"))] == [2_000_000]


def test_a_cohorts_structures_count_the_subjects_that_have_them(nifti, brain, tmp_path):
    nifti("a.nii.gz", brain)
    nifti("b.nii.gz", np.where(brain == 53, 0, brain))  # too few labels to speak for FreeSurfer alone
    (tmp_path / "c.nii.gz").write_bytes(b"no image")
    result = list_structures(read_cohort(tmp_path))
    assert {structure.title: sorted(structure.by_subject) for structure in result.structures} == {
        "Left-Lateral-Ventricle": ["a", "b"],
        "Left-Hippocampus": ["a", "b"],
        "Right-Hippocampus": ["a"],
    }
    assert result.structures[0].at_border == ["a", "b"]
    assert list(result.problems) == ["c"]


def test_a_name_that_only_freesurfer_has_is_taken_from_its_list_in_files_of_few_labels(nifti, brain):
    path = nifti("b.nii.gz", np.where(brain == 17, brain, 0))
    assert read_source(Subject("b", path), GroomSettings(segment="hippocampus left")).mask.sum() == 64
    with pytest.raises(InputError, match="no structure named 'liver'"):
        read_source(Subject("b", path), GroomSettings(segment="liver"))


def test_structures_are_joined_by_name_though_numbers_and_spelling_differ(nifti, tmp_path):
    nifti("a.nii.gz", ball() * 3, {3: "kidney_left"})
    nifti("b.nii.gz", ball() * 7, {7: "Left Kidney"})
    (kidney,) = list_structures(read_cohort(tmp_path)).structures
    assert (len(kidney.by_subject), kidney.values) == (2, (3, 7))


def test_structures_are_chosen_by_name_number_or_all(nifti, brain, tmp_path):
    nifti("a.nii.gz", brain)
    result = list_structures(read_cohort(tmp_path)).structures
    assert [structure.title for structure in chosen_structures(result, ["53", "hippocampus left"])] == [
        "Right-Hippocampus",
        "Left-Hippocampus",
    ]
    assert len(chosen_structures(result, ["All"])) == 3
    with pytest.raises(InputError, match=r"no subject .*'hippocampus'; .*Left-Hipp"):
        chosen_structures(result, ["hippocampus"])


@pytest.fixture
def patients(nifti, tmp_path):
    """Return a folder as TotalSegmentator leaves it: scans, and masks of structures; b has no spleen."""
    for name in ("a", "b"):
        nifti(f"scans/{name}/ct.nii.gz", np.random.default_rng(1).normal(size=(8, 8, 8)).astype(np.float32))
        nifti(f"scans/{name}/segmentations/liver.nii.gz", ball())
        nifti(f"scans/{name}/segmentations/kidney_left.nii.gz", ball(3))
    nifti("scans/a/segmentations/spleen.nii.gz", ball(4))
    nifti("scans/b/segmentations/spleen.nii.gz", ball(4) * 0)
    return tmp_path / "scans"


def test_a_mask_for_each_structure_is_found_by_the_files_name(patients):
    cohort = read_cohort(patients)
    assert [subject.name for subject in cohort.subjects] == ["a", "b"]
    result = [read_source(subject, GroomSettings(segment="Left-Kidney")) for subject in cohort.subjects]
    assert [item.mask.sum() for item in result] == [ball(3).sum()] * 2
    assert check_cohort(cohort, GroomSettings(segment="liver")) == []
    (problem,) = check_cohort(cohort, GroomSettings(segment="spleen"))
    assert problem.subject == "b"


def test_folders_of_masks_are_refused_until_it_is_said_which_is_meant(patients):
    subject = read_cohort(patients).subjects[0]
    with pytest.raises(InputError, match=r"several structures; .* kidney_left"):
        read_source(subject, GroomSettings())
    with pytest.raises(InputError, match="one file per structure"):
        read_source(subject, GroomSettings(label=3))
    with pytest.raises(InputError, match=r"'kidney'; similar names: kidney_left"):
        read_source(subject, GroomSettings(segment="kidney"))


def test_folders_of_masks_are_listed_without_the_empty_ones(patients):
    result = list_structures(read_cohort(patients)).structures
    assert {item.title: len(item.by_subject) for item in result} == {
        "kidney_left": 2,
        "liver": 2,
        "spleen": 1,
    }
    assert all(item.values == () for item in result)


def test_masks_that_are_empty_in_all_subjects_are_named_and_may_be_chosen(nifti, patients):
    for name in ("a", "b"):
        nifti(f"scans/{name}/segmentations/gallbladder.nii.gz", ball() * 0)
    result = list_structures(read_cohort(patients))
    assert result.empty == ("gallbladder",)
    assert [
        item.name for item in chosen_structures(result.structures, ["gallbladder", "liver"], result.empty)
    ] == ["liver"]


def test_bids_table_at_the_top_of_the_data_set_names_the_labels(nifti, brain, tmp_path):
    (tmp_path / "sub-1" / "ses-1" / "anat").mkdir(parents=True)
    path = nifti("sub-1/ses-1/anat/sub-1_ses-1_desc-own_dseg.nii.gz", (brain == 17).astype(np.int32))
    for table, name in (("desc-own_dseg.tsv", "Cerebellum"), ("desc-other_dseg.tsv", "Liver")):
        (tmp_path / table).write_text(f"index\tname\n1\t{name}\n", encoding="utf-8")
    (structure,) = structures_of(Subject("sub-1", path))
    assert structure.name == "Cerebellum"


def test_structures_of_files_are_listed_by_name_with_the_most_frequent_first(patients):
    (patients / "b" / "segmentations" / "spleen.nii.gz").unlink()
    found = structures_of_files(read_cohort(patients))
    assert {item.name: len(item.by_subject) for item in found} == {"kidney_left": 2, "liver": 2, "spleen": 1}
    assert found[-1].name == "spleen"


def test_the_only_structure_of_a_file_may_have_the_files_name(nifti):
    one, two = ball(), ball()
    two[0, 0, 0] = 2
    volume = read_volume(nifti("Left Kidney.nii.gz", one))
    assert volume.segmentation(None, "kidney_left").mask.sum() == one.sum()
    for path, name in ((nifti("a/kidney.nii.gz", two), "kidney"), (nifti("b/kidney.nii.gz", one), "liver")):
        with pytest.raises(InputError, match="has no structure named"):
            read_volume(path).segmentation(None, name)
