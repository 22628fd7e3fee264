"""Label maps as series of DICOM slices."""

import shutil

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.io.images import read_segmentation

RLE, DEFLATED = "1.2.840.10008.1.2.5", "1.2.840.10008.1.2.1.99"


def test_a_series_is_stacked_by_where_its_slices_lie(series, blocks, points, expected):
    assert np.allclose(points(read_segmentation(series, None)), expected(blocks), atol=1e-4)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)


def test_a_folder_of_series_is_a_cohort(series):
    shutil.copytree(series, series.parent / "other")
    assert [subject.name for subject in read_cohort(series.parent).subjects] == ["other", "patient"]
    with pytest.raises(InputError, match="the folder above"):
        read_cohort(series)


def test_a_series_may_lie_two_folders_below_its_patient(series):
    cohort = series.parent
    deep = cohort.parent / "export" / "patient" / "study" / "series"
    shutil.copytree(series, deep)
    (first,) = read_cohort(cohort.parent / "export").subjects
    assert (first.name, first.path) == ("patient", deep)
    shutil.copytree(series, deep.with_name("other"))
    with pytest.raises(InputError, match=r"patient/study/\{subject\}"):
        read_cohort(cohort.parent / "export")


def test_slices_without_a_suffix_are_known_for_slices(series):
    for path in list(series.iterdir()):
        path.rename(path.with_suffix(""))
    assert [subject.name for subject in read_cohort(series.parent).subjects] == ["patient"]
    with pytest.raises(InputError, match=r"slices of one series.*folder above"):
        read_cohort(series)


def test_a_missing_slice_is_noticed(series):
    sorted(series.iterdir())[5].unlink()  # not one at an end
    with pytest.raises(InputError, match=r"10 slices .* 3 mm apart"):
        read_segmentation(series, None)


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
def test_slices_are_read_however_they_are_written(series, blocks, points, edit, expected, each):
    each(series, edit)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)


def jolt(content):
    content.ImagePositionPatient = [
        float(item) + 0.004 * (int(content.InstanceNumber) % 2) for item in content.ImagePositionPatient
    ]


def test_places_that_were_rounded_make_a_stack_all_the_same(series, blocks, points, expected, each):
    each(series, jolt)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=0.005)


def test_the_contents_of_a_disc_are_no_slice(series, blocks, points, expected):
    (series / "DICOMDIR").write_bytes(b"\0" * 128 + b"DICM")
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)


def test_a_slice_that_is_there_twice_is_told(series):
    first = min(series.iterdir())
    (series / "copy").write_bytes(first.read_bytes())
    with pytest.raises(InputError, match="several of its 12 slices"):
        read_segmentation(series, None)


def test_rescaled_values_are_read_rescaled(series, blocks, points, expected, each):
    each(series, scale)
    assert np.allclose(points(read_segmentation(series, 2)), expected(blocks, 2), atol=1e-4)
    with pytest.raises(InputError, match="label 1; it contains 2"):
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
        (lambda content: setattr(content, "Rows", 65535), "can't be read as a slice|but only"),
        (lambda content: delattr(content, "ImageOrientationPatient"), "can't be read as a slice"),
        (
            lambda content: setattr(content, "ImagePositionPatient", [0, 0, 0]),
            r"several of its \d+ slices have the same position",
        ),
        (lambda content: setattr(content, "PixelSpacing", [0.0, 1.0]), "its pixels are"),
        (lambda content: setattr(content.file_meta, "TransferSyntaxUID", DEFLATED), "deflate"),
        (lambda content: delattr(content, "PixelData"), "can't be read as a slice"),
        (lambda content: delattr(content, "ImageOrientationPatient"), "it lacks ImageOrientationPatient"),
        (tilt, "not at right angles"),
        (mislabel, "can't be read as a slice of a DICOM series; export it again"),
    ],
)
def test_slices_that_make_no_stack_are_refused_and_nothing_of_the_header_is_said(
    series, edit, message, capfd, each
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


def test_two_series_in_one_folder_are_refused(series, blocks, write_series):
    write_series(series, blocks, "1.2.3.5")
    with pytest.raises(InputError, match=r"2 DICOM series.*own folder"):
        read_segmentation(series, None)


def test_one_slice_is_refused_with_the_remedy(series):
    with pytest.raises(InputError, match="folder of its series"):
        read_segmentation(sorted(series.iterdir())[0], None)


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(InputError, match="no readable DICOM series"):
        read_segmentation(tmp_path, None)
