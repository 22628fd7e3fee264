"""Encodings, frames, and headers with their voxels in another file."""

import gzip

import numpy as np
import pytest
import SimpleITK

from homolog.errors import InputError
from homolog.grooming.images import read_segmentation


def expected(blocks, turn=(1, 1, 1)):
    found = (np.argwhere(blocks) * [1.0, 2.0, 3.0] + [5.0, -6.0, 7.0]) * turn
    return found[np.lexsort(np.round(found, 1).T)]


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize(
    ("space", "turn"),
    [
        ("left-posterior-superior", (1, 1, 1)),
        ("right-anterior-superior", (-1, -1, 1)),
        ("left-anterior-superior", (1, -1, 1)),
        ("LPS", (1, 1, 1)),
    ],
)
def test_a_nrrd_is_put_where_its_space_says(blocks, write_nrrd, points, encoding, space, turn):
    found = read_segmentation(write_nrrd("a.nrrd", blocks, encoding=encoding, space=space), None)
    assert np.allclose(points(found), expected(blocks, turn))
    assert not found.notes


def test_a_nrrd_of_no_anatomical_space_is_read_with_a_note(blocks, write_nrrd, points):
    found = read_segmentation(write_nrrd("a.nrrd", blocks, space="scanner-xyz"), None)
    assert np.allclose(points(found), expected(blocks))
    assert "does not say how the patient lay" in found.notes[0]


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_a_detached_header_finds_its_voxels_beside_it(blocks, write_nrrd, points, tmp_path, encoding):
    body = blocks.tobytes(order="F")
    (tmp_path / "voxels.bin").write_bytes(gzip.compress(body) if encoding == "gzip" else body)
    path = write_nrrd("a.nhdr", blocks, encoding=encoding, data_file="voxels.bin")
    assert np.allclose(points(read_segmentation(path, None)), expected(blocks))


@pytest.mark.parametrize(
    "name", ["../voxels.bin", "/etc/hostname", "sub/../../voxels.bin", "C:\\x.raw", "..\\x"]
)
def test_voxels_elsewhere_than_beside_the_header_are_refused(blocks, write_nrrd, tmp_path, name):
    path = write_nrrd("a.nhdr", blocks, data_file=name)
    with pytest.raises(
        InputError, match=r"a\.nhdr: its voxels are said to be in .*; put that file beside it"
    ):
        read_segmentation(path, None)
    meta = tmp_path / "a.mhd"
    meta.write_text(f"ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementDataFile = {name}\n")
    with pytest.raises(InputError, match=r"a\.mhd: its voxels are said to be in"):
        read_segmentation(meta, None)


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
def test_voxels_that_are_missing_are_named(blocks, tmp_path, name):
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(blocks), tmp_path / name)
    (raw,) = (one for one in tmp_path.iterdir() if one.suffix in (".raw", ".zraw", ".gz"))
    raw.unlink()
    with pytest.raises(InputError, match=f"{raw.name}, which is not there; put that file beside it"):
        read_segmentation(tmp_path / name, None)


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
def test_voxels_cut_short_are_refused(tmp_path, name):
    noise = np.random.default_rng(0).integers(0, 2, (20, 20, 20)).astype(np.uint8)
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(noise), tmp_path / name)
    (raw,) = (one for one in tmp_path.iterdir() if one.suffix in (".raw", ".zraw", ".gz"))
    raw.write_bytes(raw.read_bytes()[:300])
    with pytest.raises(InputError, match="may be cut short"):
        read_segmentation(tmp_path / name, None)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("name", ["a.mhd", "a.mha"])
def test_a_metaimage_is_read_compressed_or_not(blocks, tmp_path, points, name, compressed):
    image = SimpleITK.GetImageFromArray(blocks.T)
    image.SetSpacing((1.0, 2.0, 3.0))
    image.SetOrigin((5.0, -6.0, 7.0))
    SimpleITK.WriteImage(image, tmp_path / name, compressed)
    assert np.allclose(points(read_segmentation(tmp_path / name, None)), expected(blocks))


def test_bzip2_is_refused_with_the_remedy(blocks, write_nrrd):
    path = write_nrrd("a.nrrd", blocks, encoding="bzip2")
    with pytest.raises(InputError, match="compressed by bzip2, which can't be read; save it again with gzip"):
        read_segmentation(path, None)
