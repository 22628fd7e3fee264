"""GIPL images, as ITK writes them."""

import gzip
import struct

import numpy as np
import pytest
import SimpleITK

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.io.images import read_segmentation, read_volume
from homolog.io.scans import read_scan

SPACING, ORIGIN = (1.5, 0.5, 2.0), (-10.0, 20.0, 30.0)


@pytest.fixture
def gipl(blocks, tmp_path):
    """Return a function that writes the blocks as GIPL."""

    def write(name="a.gipl", kind=np.uint8):
        image = SimpleITK.GetImageFromArray(blocks.astype(kind).transpose(2, 1, 0))
        image.SetSpacing(SPACING)
        image.SetOrigin(ORIGIN)
        SimpleITK.WriteImage(image, str(tmp_path / name))
        return tmp_path / name

    return write


@pytest.mark.parametrize("name", ["a.gipl", "a.gipl.gz"])
@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.float32])
def test_labels_are_read_from_where_they_lie(gipl, blocks, name, kind):
    path = gipl(name, kind)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.layers[0], blocks)
    np.testing.assert_allclose(volume.index_to_world[:3, :3], np.diag(SPACING))
    np.testing.assert_allclose(volume.index_to_world[:3, 3], ORIGIN)
    assert read_segmentation(path, 2).mask.sum() == (blocks == 2).sum()
    assert [subject.name for subject in read_cohort(path.parent).subjects] == ["a"]


def test_grey_values_are_read(gipl, blocks):
    scan = read_scan(gipl("a.gipl.gz", np.int16))
    np.testing.assert_array_equal(scan.values, blocks)
    np.testing.assert_allclose(scan.box[0], ORIGIN)


@pytest.mark.parametrize("name", ["a.gipl", "a.gipl.gz"])
@pytest.mark.parametrize("kept", [100, 300])
def test_a_file_cut_short_is_refused(gipl, name, kept):
    path = gipl(name)
    content = path.read_bytes()
    if name.endswith(".gz"):
        content = gzip.compress(gzip.decompress(content)[:kept])
    path.write_bytes(content[:kept] if not name.endswith(".gz") else content)
    with pytest.raises(InputError, match=r"a\.gipl.*cut short"):
        read_volume(path)


@pytest.mark.parametrize(
    ("place", "code", "value", "complaint"),
    [
        (8, ">H", 144, "not a readable image"),
        (0, ">H", 60000, "cut short"),
        (10, ">f", 0.0, "spacing"),
        (204, ">d", float("nan"), "origin"),
        (4, ">H", 1, "not a 3-D volume"),
    ],
)
def test_wrong_headers_are_refused(gipl, place, code, value, complaint):
    path = gipl()
    content = bytearray(path.read_bytes())
    struct.pack_into(code, content, place, value)
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint):
        read_segmentation(path, None)
