"""Files that name their segments (3D Slicer's .seg.nrrd)."""

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.grooming import check_cohort
from homolog.io.images import read_segmentation, read_volume
from homolog.settings import GroomSettings


@pytest.fixture
def flat(blocks, write_nrrd, named):
    """Return a file of one layer with two segments."""
    return write_nrrd("a.seg.nrrd", blocks, named(("Left heart", 1, 0), ("lung", 2, 0)))


@pytest.fixture
def layered(blocks, write_nrrd, named):
    """Return a file whose segments share the value 1 in two layers and overlap."""
    second = np.zeros_like(blocks)
    second[2:6, 3:6, 4:6] = 1
    return write_nrrd(
        "b.seg.nrrd", np.stack([blocks, second]), named(("heart", 1, 0), ("lung", 2, 0), ("tumour", 1, 1))
    )


def test_a_segment_is_found_by_its_name_whatever_its_case(flat, blocks, around):
    assert np.array_equal(read_segmentation(flat, None, "left HEART").mask, around(blocks == 1))
    assert np.array_equal(read_segmentation(flat, 2).mask, around(blocks == 2))


def test_the_name_goes_before_the_value(flat, blocks, around):
    assert np.array_equal(read_segmentation(flat, 1, "lung").mask, around(blocks == 2))


def test_segments_that_touch_may_be_taken_together(flat, blocks, around):
    assert np.array_equal(read_segmentation(flat, None).mask, around(blocks > 0))


def test_segments_that_lie_apart_are_not_taken_together(blocks, write_nrrd, named):
    blocks = np.where(blocks == 1, 0, blocks)
    blocks[1:3, 2:5, 3:7] = 1
    path = write_nrrd("a.seg.nrrd", blocks, named(("Left heart", 1, 0), ("lung", 2, 0)))
    with pytest.raises(InputError, match="Left heart, lung"):
        read_segmentation(path, None)


def test_segments_are_listed_with_their_names(flat, layered):
    assert [(segment.name, segment.value) for segment in read_volume(flat).segments()] == [
        ("Left heart", 1),
        ("lung", 2),
    ]
    assert [segment.name for segment in read_volume(layered).segments()] == ["heart", "lung", "tumour"]


@pytest.mark.parametrize(("first", "second"), [(1, 2), (3, 12)])
def test_segments_are_found_whatever_numbers_the_header_gives_them(
    blocks, write_nrrd, named, first, second, around
):
    text = "\n".join(named(("Left heart", 1, 0), ("lung", 2, 0)))
    text = text.replace("Segment1_", f"Segment{second}_").replace("Segment0_", f"Segment{first}_")
    path = write_nrrd("a.seg.nrrd", blocks, text.split("\n"))
    assert np.array_equal(read_segmentation(path, None, "lung").mask, around(blocks == 2))
    assert [segment.name for segment in read_volume(path).segments()] == ["Left heart", "lung"]


def test_overlapping_layers_are_split_by_name(layered):
    assert read_segmentation(layered, None, "tumour").mask.sum() == 4 * 3 * 2
    assert read_segmentation(layered, None, "heart").mask.sum() == 2 * 3 * 4
    assert read_segmentation(layered, 2).mask.sum() == 3 * 2 * 7


def test_overlapping_layers_are_not_taken_together(layered):
    with pytest.raises(InputError, match=r"b\.seg\.nrrd: .* overlap \(heart \(1\), lung \(2\), tumour"):
        read_segmentation(layered, None)


def test_a_value_that_two_layers_share_is_refused_with_their_names(layered):
    with pytest.raises(InputError, match=r"label 1 matches heart \(1\) and tumour \(1\)"):
        read_segmentation(layered, 1)


def test_an_unknown_name_is_refused_with_those_that_are_there(flat):
    with pytest.raises(InputError, match=r"'liver'; it contains Left heart \(1\), lung \(2\)"):
        read_segmentation(flat, None, "liver")


def test_a_name_that_two_segments_share_is_refused(blocks, write_nrrd, named):
    path = write_nrrd("a.seg.nrrd", blocks, named(("heart", 1, 0), ("Heart", 2, 0)))
    with pytest.raises(InputError, match="its own name"):
        read_segmentation(path, None, "heart")


def test_a_file_without_names_is_read_by_the_value(blocks, write_nrrd, around):
    path = write_nrrd("plain.nrrd", blocks)
    assert np.array_equal(read_segmentation(path, 2, "lung").mask, around(blocks == 2))
    with pytest.raises(InputError, match=r"'lung'; it contains 1, 2"):
        read_segmentation(path, None, "lung")


@pytest.mark.parametrize(("segment", "message"), [(("a", "x", 0), "invalid entry"), (("a", 1, 3), "layers")])
def test_a_header_that_makes_no_sense_is_refused(blocks, write_nrrd, named, segment, message):
    with pytest.raises(InputError, match=message):
        read_volume(write_nrrd("a.seg.nrrd", blocks, named(segment)))


def test_a_picture_is_not_taken_for_a_label_map(save_picture):
    with pytest.raises(InputError, match="picture"):
        read_segmentation(save_picture(below_zero=False), None)
    with pytest.raises(InputError, match="values below 0"):
        read_segmentation(save_picture(below_zero=True), None)
    assert read_segmentation(save_picture(below_zero=True), 100).mask.any()


@pytest.fixture
def save_picture(tmp_path):
    """Write something like a CT volume and return its path."""
    import SimpleITK

    def write(*, below_zero):
        values = np.arange(20**3, dtype=np.int16).reshape(20, 20, 20) - 1000 * below_zero
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), tmp_path / "ct.nrrd")
        return tmp_path / "ct.nrrd"

    return write


def test_a_value_that_means_different_structures_is_refused_by_name(blocks, write_nrrd, named, tmp_path):
    write_nrrd("a.seg.nrrd", blocks, named(("heart", 1, 0), ("lung", 2, 0)))
    write_nrrd("b.seg.nrrd", blocks, named(("Heart ", 1, 0), ("lung", 2, 0)))
    write_nrrd("c.seg.nrrd", blocks, named(("lung", 1, 0), ("heart", 2, 0)))
    cohort = read_cohort(tmp_path)
    assert [subject.name for subject in cohort.subjects] == ["a", "b", "c"]
    (problem,) = check_cohort(cohort, GroomSettings(label=1))
    assert (problem.subject, "'lung' here, but 'heart'" in problem.message) == ("c", True)
    assert check_cohort(cohort, GroomSettings(segment="heart")) == []
