"""DICOM segmentation objects."""

import sys

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.io.images import read_segmentation, read_volume


def overlapping(blocks):
    return np.stack([blocks == 1, blocks > 0], axis=-1).astype(np.uint8).transpose(2, 1, 0, 3)


@pytest.fixture
def seg(make_seg, blocks):
    """Return a DICOM SEG of two overlapping segments over the series."""
    return make_seg(overlapping(blocks))


def test_segments_are_read_by_name_from_where_they_lie(seg, blocks, points, expected):
    assert [segment.name for segment in read_volume(seg).segments()] == ["heart", "both"]
    assert np.allclose(points(read_segmentation(seg, None, "heart")), expected(blocks, 1), atol=1e-4)
    assert np.allclose(points(read_segmentation(seg, None, "both")), expected(blocks), atol=1e-4)


def test_frames_that_are_left_out_are_no_border(make_seg, blocks):
    from homolog.grooming.clean import cleaned

    inside = np.zeros_like(blocks)
    inside[2:5, 3:6, 4:8] = 1
    path = make_seg(np.stack([inside] * 2, axis=-1).astype(np.uint8).transpose(2, 1, 0, 3))
    result = cleaned(read_segmentation(path, None, "heart"))
    assert np.count_nonzero(result.segmentation.mask) == np.count_nonzero(inside)
    assert not result.borders


def test_overlapping_segments_are_not_taken_together(seg):
    with pytest.raises(InputError, match="its segments overlap"):
        read_segmentation(seg, None)


def test_a_folder_that_holds_one_segmentation_object_is_read(seg, blocks):
    assert read_segmentation(seg.parent, None, "both").mask.sum() == (blocks > 0).sum()
    assert [subject.name for subject in read_cohort(seg.parent).subjects] == ["a"]


def test_a_segmentation_object_cut_short_is_refused(seg):
    seg.write_bytes(seg.read_bytes()[:2500])
    with pytest.raises(InputError, match=r"a\.dcm: can't be read"):
        read_segmentation(seg, None, "heart")


def test_without_the_package_the_extra_is_named(seg, monkeypatch):
    monkeypatch.setitem(sys.modules, "highdicom.seg", None)
    with pytest.raises(InputError, match=r'pip install "homolog\[dicom\]"'):
        read_segmentation(seg, None, "heart")


UNEVEN = np.zeros((11, 9, 8), np.uint8)  # frames of 99 pixels, which begin and end within bytes
UNEVEN[2:9, 2:7, 2:6] = 1
UNEVEN[4:6, 3:5, 3:5] = 2


@pytest.mark.parametrize("blocks", [UNEVEN])
def test_frames_that_begin_and_end_within_a_byte_are_read(make_seg, blocks, points, expected):
    path = make_seg(overlapping(blocks))
    for name, value in (("heart", 1), ("both", None)):
        assert np.allclose(points(read_segmentation(path, None, name)), expected(blocks, value), atol=1e-4)


def test_a_table_is_advised_for_a_folder_of_several_segmentation_objects(seg):
    (seg.parent / "b.dcm").write_bytes(seg.read_bytes())
    with pytest.raises(InputError, match=r"a\.dcm, b\.dcm.*column path"):
        read_segmentation(seg.parent, None, "both")


RLE, BIG, DEFLATED = ("1.2.840.10008.1.2.5", "1.2.840.10008.1.2.2", "1.2.840.10008.1.2.1.99")


@pytest.mark.parametrize(
    ("kind", "how"),
    [
        ("BINARY", {"omit_empty_frames": False}),
        ("BINARY", {"transfer_syntax_uid": "1.2.840.10008.1.2"}),
        ("FRACTIONAL", {}),
        ("FRACTIONAL", {"transfer_syntax_uid": RLE}),
        ("LABELMAP", {}),
        ("LABELMAP", {"transfer_syntax_uid": RLE}),
        ("LABELMAP", {"dimension_organization_type": "3D"}),
    ],
)
def test_every_type_of_segmentation_object_is_read(make_seg, blocks, points, kind, how, expected):
    labels = blocks.transpose(2, 1, 0) if kind == "LABELMAP" else overlapping(blocks)
    path = make_seg(labels.astype(float) if kind == "FRACTIONAL" else labels, kind, **how)
    second = 2 if kind == "LABELMAP" else None
    assert [subject.name for subject in read_cohort(path.parent).subjects] == ["a"]
    assert np.allclose(points(read_segmentation(path, None, "heart")), expected(blocks, 1), atol=1e-4)
    assert np.allclose(points(read_segmentation(path, None, "both")), expected(blocks, second), atol=1e-4)


def test_probabilities_are_no_segmentation(make_seg, blocks):
    probabilities = 0.8 * overlapping(blocks)
    probabilities[::2] *= 0.75
    with pytest.raises(InputError, match="contains fractions"):
        read_segmentation(make_seg(probabilities, "FRACTIONAL"), None, "heart")


def shared(content):
    return content.SharedFunctionalGroupsSequence[0]


def frames(content):
    return content.PerFrameFunctionalGroupsSequence


def turn_per_frame(content):
    for frame in frames(content):
        frame.PlaneOrientationSequence = shared(content).PlaneOrientationSequence
    del shared(content).PlaneOrientationSequence


@pytest.mark.parametrize(
    "edit",
    [
        lambda content: delattr(content, "PatientName"),
        lambda content: delattr(content, "DimensionOrganizationSequence"),
        lambda content: delattr(content, "ReferencedSeriesSequence"),
        lambda content: delattr(content, "SegmentsOverlap"),
        lambda content: delattr(shared(content).PixelMeasuresSequence[0], "SpacingBetweenSlices"),
        turn_per_frame,
        lambda content: [delattr(frame, "DerivationImageSequence") for frame in frames(content)],
        lambda content: setattr(content.file_meta, "TransferSyntaxUID", DEFLATED),
    ],
)
def test_what_may_be_missing_is_not_missed(make_seg, blocks, points, edit, expected):
    result = read_segmentation(make_seg(overlapping(blocks), edit=edit), None, "both")
    assert np.allclose(points(result), expected(blocks), atol=1e-4)


def place(frame):
    return frame.PlanePositionSequence[0]


@pytest.mark.parametrize(
    "edit",
    [
        lambda content: delattr(content, "FrameOfReferenceUID"),
        lambda content: delattr(content, "SegmentSequence"),
        lambda content: delattr(content, "Rows"),
        lambda content: setattr(content, "Rows", 60000),
        lambda content: setattr(content, "NumberOfFrames", 3),
        lambda content: setattr(content, "NumberOfFrames", 100_000),
        lambda content: setattr(shared(content).PixelMeasuresSequence[0], "PixelSpacing", [0, 1]),
        lambda content: setattr(shared(content).PixelMeasuresSequence[0], "SpacingBetweenSlices", 9.0),
        lambda content: delattr(shared(content), "PlaneOrientationSequence"),
        lambda content: [delattr(frame, "PlanePositionSequence") for frame in frames(content)],
        lambda content: [delattr(frame, "SegmentIdentificationSequence") for frame in frames(content)],
        lambda content: setattr(place(frames(content)[2]), "ImagePositionPatient", [1, 2, 3]),
        lambda content: setattr(content.file_meta, "TransferSyntaxUID", BIG),
    ],
)
def test_what_contradicts_itself_is_refused_and_nothing_of_the_header_is_said(make_seg, blocks, edit, capfd):
    path = make_seg(overlapping(blocks), edit=edit)
    with pytest.raises(InputError, match=r"a\.dcm: .*export it again") as refused:
        read_segmentation(path, None, "both")
    assert "Jane" not in str(refused.value)
    assert "".join(capfd.readouterr()) == ""


def test_a_deflated_bomb_is_not_unpacked(make_seg, blocks, monkeypatch):
    path = make_seg(
        overlapping(blocks), edit=lambda content: setattr(content.file_meta, "TransferSyntaxUID", DEFLATED)
    )
    monkeypatch.setattr("homolog.io.dicom.LARGEST", 3000)
    with pytest.raises(InputError, match=r"a\.dcm: unpacks to more than"):
        read_segmentation(path, None, "both")


def test_a_segmentation_object_of_one_frame_is_refused_as_no_volume(make_seg, blocks):
    def keep_one(content):
        content.PerFrameFunctionalGroupsSequence = frames(content)[:1]
        del content.NumberOfFrames

    with pytest.raises(InputError, match="is not a 3-D volume but 1 x 10 x 9"):
        read_segmentation(make_seg(overlapping(blocks), edit=keep_one), None, "heart")
