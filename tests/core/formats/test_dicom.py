"""DICOM segmentation objects and label maps as series of slices."""

import shutil
import sys

import numpy as np
import pytest
import SimpleITK

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.grooming.images import read_segmentation, read_volume

TURN = np.array(
    [[0.8, 0.6, 0.0], [0.6, -0.8, 0.0], [0.0, 0.0, -1.0]]
)  # columns: along x, y and z of the grid
SPACING, ORIGIN = np.array([1.5, 2.0, 3.0]), np.array([5.0, -6.0, 7.0])


def expected(blocks, value=None):
    inside = np.argwhere(blocks > 0 if value is None else blocks == value)
    found = inside * SPACING @ TURN.T + ORIGIN
    return found[np.lexsort(np.round(found, 1).T)]


@pytest.fixture
def series(blocks, tmp_path):
    """Return a folder with one DICOM file a slice, in an order that their names don't tell."""
    folder = tmp_path / "cohort" / "patient"
    folder.mkdir(parents=True)
    write_series(folder, blocks, "1.2.3.4")
    return folder


def write_series(folder, blocks, uid):
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k in range(blocks.shape[2]):
        image = SimpleITK.GetImageFromArray(blocks[:, :, k].T[None])
        image.SetSpacing(SPACING.tolist())
        place = ORIGIN + TURN[:, 2] * SPACING[2] * k
        tags = {
            "0008|0060": "OT", "0020|000d": "1.2.3", "0020|000e": uid, "0008|0018": f"{uid}.{k + 1}",
            "0020|0032": "\\".join(map(str, place)), "0020|0013": str(k),
            "0020|0037": "\\".join(map(str, [*TURN[:, 0], *TURN[:, 1]])), "0010|0010": "Doe^Jane",
        }  # fmt: skip
        for key, value in tags.items():
            image.SetMetaData(key, value)
        writer.SetFileName(folder / f"{uid}_{(7 * k) % 11:02d}.dcm")
        writer.Execute(image)


@pytest.fixture
def make_seg(series, tmp_path):
    """Return a function that writes a DICOM SEG over the series: masks (K, J, I[, 2]), type, what else."""
    import highdicom as hd
    import pydicom
    from pydicom.sr.codedict import codes

    sources = [pydicom.dcmread(one) for one in sorted(series.iterdir())]
    for one in sources:
        one.FrameOfReferenceUID, one.PatientID, one.StudyID = "1.2.9", "p", "s"
        for name in ("PatientBirthDate", "PatientSex", "StudyDate", "StudyTime", "AccessionNumber"):
            setattr(one, name, "")
        one.ReferringPhysicianName, one.SliceThickness, one.PixelSpacing = "", 3.0, [2.0, 1.5]
    sources.sort(key=lambda one: int(one.InstanceNumber))
    descriptions = [
        hd.seg.SegmentDescription(
            segment_number=number, segment_label=name, algorithm_type="MANUAL",
            segmented_property_category=codes.SCT.Organ, segmented_property_type=codes.SCT.Liver,
        )
        for number, name in enumerate(("heart", "both"), start=1)
    ]  # fmt: skip

    def make(masks, kind="BINARY", edit=None, **how):
        made = hd.seg.Segmentation(
            sources, masks, kind, descriptions, "1.2.5", 1, "1.2.5.1", 1, "maker", "model", "1", "1", **how
        )
        path = tmp_path / "seg" / "a.dcm"
        path.parent.mkdir(exist_ok=True)
        made.save_as(path)
        if edit is not None:
            content = pydicom.dcmread(path)
            edit(content)
            pydicom.dcmwrite(path, content, force_encoding=True, **encoding(content))
        return path

    return make


def encoding(content):
    uid = content.file_meta.TransferSyntaxUID
    return {"implicit_vr": uid.is_implicit_VR, "little_endian": uid.is_little_endian}


def overlapping(blocks):
    return np.stack([blocks == 1, blocks > 0], axis=-1).astype(np.uint8).transpose(2, 1, 0, 3)


@pytest.fixture
def seg(make_seg, blocks):
    """Return a DICOM SEG of two overlapping segments over the series."""
    return make_seg(overlapping(blocks))


def test_a_series_is_stacked_by_where_its_slices_lie(series, blocks, points):
    assert np.allclose(points(read_segmentation(series, None)), expected(blocks), atol=1e-4)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)


def test_a_folder_of_series_is_a_cohort(series):
    shutil.copytree(series, series.parent / "other")
    assert [one.name for one in read_cohort(series.parent).subjects] == ["other", "patient"]
    with pytest.raises(InputError, match="give the folder above it"):
        read_cohort(series)


def test_a_series_may_lie_two_folders_below_its_patient(series):
    cohort = series.parent
    deep = cohort.parent / "export" / "patient" / "study" / "series"
    shutil.copytree(series, deep)
    (one,) = read_cohort(cohort.parent / "export").subjects
    assert (one.name, one.path) == ("patient", deep)
    shutil.copytree(series, deep.with_name("other"))
    with pytest.raises(InputError, match=r"patient: holds 2 DICOM series; give a cohort\.csv"):
        read_cohort(cohort.parent / "export")


def test_slices_without_a_suffix_are_known_for_slices(series):
    for one in list(series.iterdir()):
        one.rename(one.with_suffix(""))
    assert [one.name for one in read_cohort(series.parent).subjects] == ["patient"]
    with pytest.raises(InputError, match="holds the slices of a DICOM series; give the folder above it"):
        read_cohort(series)


def test_a_missing_slice_is_noticed(series):
    sorted(series.iterdir())[5].unlink()  # not one at an end
    with pytest.raises(InputError, match="its 10 slices are not alike, parallel and 3 mm apart throughout"):
        read_segmentation(series, None)


def each(series, edit):
    """Change every slice."""
    import pydicom

    for path in sorted(series.iterdir()):
        content = pydicom.dcmread(path)
        edit(content)
        pydicom.dcmwrite(path, content, force_encoding=True, **encoding(content))


def scale(content):
    content.RescaleSlope, content.RescaleIntercept = 2.0, -2.0


def pack(content):
    """Compress the pixels by JPEG 2000."""
    import io

    from PIL import Image
    from pydicom.encaps import encapsulate
    from pydicom.uid import JPEG2000Lossless

    stream = io.BytesIO()
    Image.fromarray(content.pixel_array).save(stream, "JPEG2000", no_jp2=True, irreversible=False)
    content.PixelData = encapsulate([stream.getvalue()])
    content["PixelData"].is_undefined_length = True
    content.file_meta.TransferSyntaxUID = JPEG2000Lossless


def mislabel(content):
    """Say that RLE is JPEG lossless, for which pydicom has no decoder of its own."""
    content.compress(RLE)
    content.file_meta.TransferSyntaxUID = "1.2.840.10008.1.2.4.70"


@pytest.mark.parametrize(
    "edit",
    [
        lambda content: content.compress(RLE),
        pack,
        lambda content: setattr(content, "PixelSpacing", [2.0, 1.5]),
        lambda content: delattr(content, "PatientName"),
        lambda content: delattr(content, "InstanceNumber"),
    ],
)
def test_slices_are_read_however_they_are_written(series, blocks, points, edit):
    each(series, edit)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)


def jolt(content):
    content.ImagePositionPatient = [
        float(one) + 0.004 * (int(content.InstanceNumber) % 2) for one in content.ImagePositionPatient
    ]


def test_places_that_were_rounded_make_a_stack_all_the_same(series, blocks, points):
    each(series, jolt)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=0.005)


def test_the_contents_of_a_disc_are_no_slice(series, blocks, points):
    (series / "DICOMDIR").write_bytes(b"\0" * 128 + b"DICM")
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)


def test_a_slice_that_is_there_twice_is_told(series):
    one = min(series.iterdir())
    (series / "copy").write_bytes(one.read_bytes())
    with pytest.raises(InputError, match="several of its 12 slices lie at one place"):
        read_segmentation(series, None)


def test_rescaled_values_are_read_rescaled(series, blocks, points):
    each(series, scale)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)
    with pytest.raises(InputError, match="has no voxel of label 1; it holds 2"):
        read_segmentation(series, 1)


def unsized(content):
    for name in ("PixelSpacing", "NominalScannedPixelSpacing", "ImagerPixelSpacing"):
        content.pop(name, None)


def tilt(content):
    content.ImagePositionPatient[0] += 0.5 * int(content.InstanceNumber)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda content: setattr(content, "NumberOfFrames", 2), "it has several frames"),
        (unsized, "it lacks PixelSpacing"),
        (lambda content: setattr(content, "Rows", 65535), "can't be read as a slice|of which"),
        (lambda content: delattr(content, "ImageOrientationPatient"), "can't be read as a slice"),
        (
            lambda content: setattr(content, "ImagePositionPatient", [0, 0, 0]),
            r"several of its \d+ slices lie at one place",
        ),
        (lambda content: setattr(content, "PixelSpacing", [0.0, 1.0]), "its pixels are"),
        (lambda content: setattr(content.file_meta, "TransferSyntaxUID", DEFLATED), "is deflated as a whole"),
        (lambda content: delattr(content, "PixelData"), "can't be read as a slice"),
        (lambda content: delattr(content, "ImageOrientationPatient"), "it lacks ImageOrientationPatient"),
        (tilt, "not at right angles"),
        (mislabel, "can't be read as a slice of a DICOM series; export it again"),
    ],
)
def test_slices_that_make_no_stack_are_refused_and_nothing_of_the_header_is_said(
    series, edit, message, capfd
):
    each(series, edit)
    with pytest.raises(InputError, match=message) as refused:
        read_segmentation(series, None)
    assert "Jane" not in str(refused.value)
    assert "".join(capfd.readouterr()) == ""


def test_a_length_of_gigabytes_is_not_believed(series):
    import psutil

    path = sorted(series.iterdir())[3]
    content = path.read_bytes()
    at = content.index(b"\x10\x00\x10\x00") + 4  # the length of the patient's name
    path.write_bytes(content[:at] + b"\xf0\xff\xff\xff" + content[at + 4 :])
    before = psutil.Process().memory_info().rss
    with pytest.raises(InputError):
        read_segmentation(series, None)
    assert psutil.Process().memory_info().rss - before < 100e6


def test_two_series_in_one_folder_are_refused(series, blocks):
    write_series(series, blocks, "1.2.3.5")
    with pytest.raises(InputError, match="holds 2 DICOM series; give each its own folder"):
        read_segmentation(series, None)


def test_one_slice_is_refused_with_the_remedy(series):
    with pytest.raises(InputError, match="give the folder of its series"):
        read_segmentation(sorted(series.iterdir())[0], None)


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(InputError, match="no readable DICOM series"):
        read_segmentation(tmp_path, None)


def test_segments_are_read_by_name_from_where_they_lie(seg, blocks, points):
    assert [one.name for one in read_volume(seg).segments()] == ["heart", "both"]
    assert np.allclose(points(read_segmentation(seg, None, "heart")), expected(blocks, 1), atol=1e-4)
    assert np.allclose(points(read_segmentation(seg, None, "both")), expected(blocks), atol=1e-4)


def test_frames_that_are_left_out_are_no_border(make_seg, blocks):
    from homolog.grooming.clean import cleaned

    inside = np.zeros_like(blocks)
    inside[2:5, 3:6, 4:8] = 1
    path = make_seg(np.stack([inside] * 2, axis=-1).astype(np.uint8).transpose(2, 1, 0, 3))
    found = cleaned(read_segmentation(path, None, "heart"))
    assert np.count_nonzero(found.segmentation.mask) == np.count_nonzero(inside)
    assert not found.at_border


def test_overlapping_segments_are_not_taken_together(seg):
    with pytest.raises(InputError, match="its segments overlap"):
        read_segmentation(seg, None)


def test_a_folder_that_holds_one_segmentation_object_is_read(seg, blocks):
    assert read_segmentation(seg.parent, None, "both").mask.sum() == (blocks > 0).sum()
    assert [one.name for one in read_cohort(seg.parent).subjects] == ["a"]


def test_a_segmentation_object_cut_short_is_refused(seg):
    seg.write_bytes(seg.read_bytes()[:2500])
    with pytest.raises(InputError, match=r"a\.dcm: can't be read as DICOM SEG"):
        read_segmentation(seg, None, "heart")


def test_without_the_package_the_extra_is_named(seg, monkeypatch):
    monkeypatch.setitem(sys.modules, "highdicom.seg", None)
    with pytest.raises(InputError, match=r'pip install "homolog\[dicom\]"'):
        read_segmentation(seg, None, "heart")


RLE, BIG, DEFLATED = (
    "1.2.840.10008.1.2.5", "1.2.840.10008.1.2.2", "1.2.840.10008.1.2.1.99"
)  # fmt: skip


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
def test_every_type_of_segmentation_object_is_read(make_seg, blocks, points, kind, how):
    labels = blocks.transpose(2, 1, 0) if kind == "LABELMAP" else overlapping(blocks)
    path = make_seg(labels.astype(float) if kind == "FRACTIONAL" else labels, kind, **how)
    second = 2 if kind == "LABELMAP" else None
    assert [one.name for one in read_cohort(path.parent).subjects] == ["a"]
    assert np.allclose(points(read_segmentation(path, None, "heart")), expected(blocks, 1), atol=1e-4)
    assert np.allclose(points(read_segmentation(path, None, "both")), expected(blocks, second), atol=1e-4)


def test_probabilities_are_no_segmentation(make_seg, blocks):
    with pytest.raises(InputError, match="holds fractions, so it is no label map; threshold it first"):
        read_segmentation(make_seg(0.8 * overlapping(blocks), "FRACTIONAL"), None, "heart")


def shared(content):
    return content.SharedFunctionalGroupsSequence[0]


def frames(content):
    return content.PerFrameFunctionalGroupsSequence


def turn_per_frame(content):
    for one in frames(content):
        one.PlaneOrientationSequence = shared(content).PlaneOrientationSequence
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
        lambda content: [delattr(one, "DerivationImageSequence") for one in frames(content)],
        lambda content: setattr(content.file_meta, "TransferSyntaxUID", DEFLATED),
    ],
)
def test_what_may_be_missing_is_not_missed(make_seg, blocks, points, edit):
    found = read_segmentation(make_seg(overlapping(blocks), edit=edit), None, "both")
    assert np.allclose(points(found), expected(blocks), atol=1e-4)


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
        lambda content: [delattr(one, "PlanePositionSequence") for one in frames(content)],
        lambda content: [delattr(one, "SegmentIdentificationSequence") for one in frames(content)],
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
    monkeypatch.setattr("homolog.grooming.dicom_deflated._LARGEST", 3000)
    with pytest.raises(InputError, match=r"a\.dcm: unpacks to more than .* export it without compression"):
        read_segmentation(path, None, "both")


def test_a_segmentation_object_of_one_frame_is_refused_as_no_volume(make_seg, blocks):
    def keep_one(content):
        content.PerFrameFunctionalGroupsSequence = frames(content)[:1]
        del content.NumberOfFrames

    with pytest.raises(InputError, match="is not a 3-D volume but 1 x 10 x 9"):
        read_segmentation(make_seg(overlapping(blocks), edit=keep_one), None, "heart")
