"""What would not fit into memory is refused by its header, with the number of GB, before it is read."""

import gzip
import struct
import zipfile

import numpy as np
import psutil
import pytest

from homolog.errors import InputError
from homolog.io.arrays import read_arrays
from homolog.io.images import read_segmentation

TOO_LARGE = r"20000 x 20000 x 20000 voxels\): needs [\d,]+ GB of memory, but only [\d.,]+ GB are free; crop "


def nrrd(edge, encoding):
    return (
        f"NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: {edge} {edge} {edge}\n"
        f"space directions: (1,0,0) (0,1,0) (0,0,1)\nencoding: {encoding}\nendian: little\n"
        "space origin: (0,0,0)\n\n"
    ).encode()


def metaimage(edge):
    return (
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        "CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n"
        "ElementSpacing = 1 1 1\n"
        f"DimSize = {edge} {edge} {edge}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    ).encode()


def nifti(edge):
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, edge, edge, edge, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, 2, 8)
    struct.pack_into("<9f", header, 76, 1, 1, 1, 1, 1, 1, 1, 1, 352)
    struct.pack_into("<h", header, 254, 1)
    struct.pack_into("<12f", header, 280, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)
    header[344:348] = b"n+1\0"
    return bytes(header)


@pytest.fixture
def within_100_mb():
    """Check that a test takes no more memory than that."""
    import SimpleITK  # noqa: F401 - takes its share of memory before the test

    process = psutil.Process()
    before = process.memory_info().rss
    yield
    assert process.memory_info().rss - before < 100e6


@pytest.mark.usefixtures("within_100_mb")
@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.nrrd", nrrd(20000, "raw") + b"1234"),
        ("a.nrrd", nrrd(20000, "gzip") + gzip.compress(b"1234", mtime=0)),
        ("a.mha", metaimage(20000) + b"1234"),
        ("a.nii", nifti(20000) + b"1234"),
        ("a.nii.gz", gzip.compress(nifti(20000) + b"1234", mtime=0)),
    ],
)
def test_a_volume_whose_header_claims_too_much_is_refused_in_gigabytes(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=TOO_LARGE):
        read_segmentation(tmp_path / name, None)


@pytest.mark.usefixtures("within_100_mb")
@pytest.mark.parametrize(("name", "head"), [("a.nrrd", nrrd(30, "gzip")), ("a.nii.gz", b"")])
def test_a_gzip_bomb_behind_a_small_header_is_not_unpacked(tmp_path, name, head):
    with (tmp_path / name).open("wb") as stream:
        stream.write(head)
        with gzip.open(stream, "wb", compresslevel=1) as packed:
            packed.write(b"" if head else nifti(30))
            for _ in range(32):
                packed.write(bytes(2**23))
    with pytest.raises(InputError, match=r"contains more .*voxels"):
        read_segmentation(tmp_path / name, None)


@pytest.mark.usefixtures("within_100_mb")
def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, zeros=np.zeros(2**26))
    monkeypatch.setattr("homolog.memory.free_memory", lambda: 2**28)
    with pytest.raises(InputError, match=r"a\.npz: needs 0\.537 GB .* 0\.268 GB"):
        read_arrays(path)


@pytest.mark.usefixtures("within_100_mb")
def test_an_archive_that_lies_about_its_array_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    head = str({"descr": "<f8", "fortran_order": False, "shape": (2**40,)}).ljust(117).encode() + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + b"1234")
    with pytest.raises(InputError, match="is damaged"):
        read_arrays(path)
