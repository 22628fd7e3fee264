"""Encodings, frames, and headers with their voxels in another file."""

import gzip
import zlib

import numpy as np
import pytest
import SimpleITK

from homolog.errors import InputError
from homolog.io.images import read_segmentation


def said(result):
    """Return the notes but that several labels were taken together."""
    return tuple(note for note in result.notes if "combined into one" not in note)


def expected(blocks, turn=(1, 1, 1)):
    result = (np.argwhere(blocks) * [1.0, 2.0, 3.0] + [5.0, -6.0, 7.0]) * turn
    return result[np.lexsort(np.round(result, 1).T)]


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
    result = read_segmentation(write_nrrd("a.nrrd", blocks, encoding=encoding, space=space), None)
    assert np.allclose(points(result), expected(blocks, turn))
    assert not said(result)


def test_a_nrrd_of_no_anatomical_space_is_read_with_a_note(blocks, write_nrrd, points):
    result = read_segmentation(write_nrrd("a.nrrd", blocks, space="scanner-xyz"), None)
    assert np.allclose(points(result), expected(blocks))
    assert "gives no patient orientation" in result.notes[0]


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
    with pytest.raises(InputError, match=r"a\.nhdr: .* that file next to"):
        read_segmentation(path, None)
    meta = tmp_path / "a.mhd"
    meta.write_text(f"ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementDataFile = {name}\n")
    with pytest.raises(InputError, match=r"a\.mhd: its voxels"):
        read_segmentation(meta, None)


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
def test_voxels_that_are_missing_are_named(blocks, tmp_path, name):
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(blocks), tmp_path / name)
    (raw,) = (path for path in tmp_path.iterdir() if path.suffix in (".raw", ".zraw", ".gz"))
    raw.unlink()
    with pytest.raises(InputError, match=f"{raw.name}, which is missing"):
        read_segmentation(tmp_path / name, None)


@pytest.mark.parametrize("name", ["a.nhdr", "a.mhd"])
def test_voxels_cut_short_are_refused(tmp_path, name):
    noise = np.random.default_rng(0).integers(0, 2, (20, 20, 20)).astype(np.uint8)
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(noise), tmp_path / name)
    (raw,) = (path for path in tmp_path.iterdir() if path.suffix in (".raw", ".zraw", ".gz"))
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


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize(
    ("lines", "right"), [(["byte skip: 8"], True), ([], False), (["byte skip: 4"], False)]
)
def test_what_is_skipped_before_the_voxels_must_leave_as_many_as_there_are(
    blocks, write_nrrd, points, tmp_path, encoding, lines, right
):
    body = b"12345678" + blocks.tobytes(order="F")
    (tmp_path / "voxels.bin").write_bytes(gzip.compress(body) if encoding == "gzip" else body)
    path = write_nrrd("a.nhdr", blocks, lines, encoding=encoding, data_file="voxels.bin")
    if right:
        assert np.allclose(points(read_segmentation(path, None)), expected(blocks))
        return
    with pytest.raises(InputError, match=r"a\.nhdr: .*contains"):
        read_segmentation(path, None)


def test_lines_are_skipped_and_the_end_of_a_file_is_found(blocks, write_nrrd, points, tmp_path):
    (tmp_path / "voxels.bin").write_bytes(b"made\nby hand\n" + blocks.tobytes(order="F"))
    for line in ("line skip: 2", "byte skip: -1"):
        path = write_nrrd("a.nhdr", blocks, [line], data_file="voxels.bin")
        assert np.allclose(points(read_segmentation(path, None)), expected(blocks))


@pytest.mark.parametrize("names", ["LIST\n{}", "voxels%02d.bin 1 11 1"])
def test_voxels_in_a_file_for_each_slice_are_put_together(blocks, write_nrrd, points, tmp_path, names):
    for k in range(11):
        (tmp_path / f"voxels{k + 1:02d}.bin").write_bytes(blocks[:, :, k].tobytes(order="F"))
    listed = "\n".join(f"voxels{k + 1:02d}.bin" for k in range(11))
    path = write_nrrd("a.nhdr", blocks, data_file=names.format(listed))
    path.write_bytes(path.read_bytes().rstrip() + b"\n")
    assert np.allclose(points(read_segmentation(path, None)), expected(blocks))
    (tmp_path / "voxels07.bin").unlink()
    with pytest.raises(InputError, match=r"voxels07\.bin, which is missing"):
        read_segmentation(path, None)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sizes: 9 10 11", "sizes: 9 10 10", "contains 990 bytes of voxels, and its header declares 900"),
        ("sizes: 9 10 11", "sizes: 9 10 12", r"may be cut short \(990 of 1080 bytes"),
        (
            "encoding: raw",
            'encoding: raw\nspace units: "m" "m" "m"',
            "has the units m, m, m; save it again in mm",
        ),
        ("(1,0,0) (0,2,0)", "(nan,0,0) (0,2,0)", "is not a readable image"),
        ("(1,0,0) (0,2,0)", "(0,0,0) (0,2,0)", "Refusing to change spacing"),
        ("(1,0,0) (0,2,0)", "(1,0,0) (1,2,0)", "not at right angles"),
        ("space directions: (1,0,0) (0,2,0) (0,0,3)", "spacings: 1 -2 3", "has the spacing 1 -2 3"),
        ("space directions: (1,0,0) (0,2,0) (0,0,3)", "spacings: nan nan nan", "has the spacing nan"),
    ],
)
def test_a_nrrd_header_that_contradicts_itself_is_refused(blocks, write_nrrd, old, new, message):
    path = write_nrrd("a.nrrd", blocks)
    path.write_bytes(path.read_bytes().replace(old.encode(), new.encode(), 1))
    if "spacings" in new:
        path.write_bytes(path.read_bytes().replace(b"space: left-posterior-superior\n", b"", 1))
        path.write_bytes(path.read_bytes().replace(b"space origin: (5,-6,7)\n", b"", 1))
    with pytest.raises(InputError, match=message):
        read_segmentation(path, None)


@pytest.fixture
def write_meta(blocks, tmp_path):
    """Write a MetaImage file by hand with some of its header's lines changed or, if None, left out."""

    def write(name="a.mha", *, body=None, **lines):
        header = (
            {
                "ObjectType": "Image",
                "NDims": "3",
                "BinaryData": "True",
                "BinaryDataByteOrderMSB": "False",
                "CompressedData": "False",
                "TransformMatrix": "1 0 0 0 1 0 0 0 1",
                "Offset": "5 -6 7",
                "ElementSpacing": "1 2 3",
                "DimSize": "9 10 11",
                "ElementType": "MET_UCHAR",
            }
            | {"ElementDataFile": "LOCAL"}
            | lines
        )
        last = header.pop("ElementDataFile")
        voxels = blocks.tobytes(order="F") if body is None else body
        text = "".join(f"{key} = {value}\n" for key, value in header.items() if value is not None)
        (tmp_path / name).write_bytes(f"{text}ElementDataFile = {last}\n".encode() + voxels)
        return tmp_path / name

    return write


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ({"ElementSpacing": "1 -2 3"}, "has the spacing 1 -2 3; correct its header"),
        ({"ElementSpacing": "1 nan 3"}, "has the spacing 1 nan 3"),
        ({"ElementSpacing": "1 x 3"}, "its elementspacing is '1 x 3'"),
        ({"Offset": "nan 0 0"}, "has the origin nan 0 0"),
        ({"TransformMatrix": "2 0 0 0 1 0 0 0 1"}, "its axes 2 0 0 0 1 0 0 0 1 are not a rotation"),
        ({"TransformMatrix": "1 0 0 0.5 1 0 0 0 1"}, "are not a rotation"),
        ({"HeaderSize": "8"}, "in another one"),
        ({"NDims": "-13"}, "has -13 dimensions"),
        ({"DimSize": "9 10 10"}, "contains 990 bytes of voxels, and its header declares 900"),
        ({"DimSize": "9 10 12"}, r"may be cut short \(990 of 1080 bytes"),
    ],
)
def test_a_metaimage_header_that_contradicts_itself_is_refused(write_meta, lines, message):
    with pytest.raises(InputError, match=message):
        read_segmentation(write_meta(**lines), None)


@pytest.mark.parametrize(
    ("spacing", "note"),
    [({"ElementSpacing": None}, True), ({"ElementSpacing": None, "ElementSize": "1 2 3"}, False)],
)
def test_voxels_of_unknown_size_are_read_with_a_note(write_meta, blocks, points, spacing, note):
    result = read_segmentation(write_meta(**spacing), None)
    assert said(result) == (("its header gives no voxel size; 1 mm was assumed",) if note else ())
    assert result.spacing.tolist() == ([1.0, 1.0, 1.0] if note else [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("size", "lines", "right"),
    [
        (0, {}, True),
        (1, {}, False),
        (0, {"DimSize": "9 10 10"}, False),
        (0, {"DimSize": "9 10 12"}, False),
    ],
)
@pytest.mark.parametrize("name", ["a.mha", "a.mhd"])
def test_compressed_voxels_must_be_those_of_the_header(
    write_meta, blocks, points, tmp_path, name, size, lines, right
):
    body = zlib.compress(blocks.tobytes(order="F"))
    lines = {"CompressedData": "True", **lines}
    lines["CompressedDataSize"] = None if size is None else str(len(body) + size)
    if name == "a.mhd":
        (tmp_path / "a.zraw").write_bytes(body)
        lines["ElementDataFile"] = "a.zraw"
    path = write_meta(name, body=body if name == "a.mha" else b"", **lines)
    if right:
        assert np.allclose(points(read_segmentation(path, None)), expected(blocks))
        return
    with pytest.raises(InputError, match="compressed voxels"):
        read_segmentation(path, None)


@pytest.mark.parametrize("name", ["a.mha", "a.mhd"])
def test_the_compressed_size_may_be_missing_where_voxels_have_a_file_of_their_own(
    write_meta, blocks, points, tmp_path, name
):
    body = zlib.compress(blocks.tobytes(order="F"))
    lines = {"CompressedData": "True"}
    if name == "a.mha":
        with pytest.raises(InputError, match=rf"'CompressedDataSize = {len(body)}'"):
            read_segmentation(write_meta(name, body=body, **lines), None)
        return
    (tmp_path / "a.zraw").write_bytes(body)
    path = write_meta(name, body=b"", ElementDataFile="a.zraw", **lines)
    assert np.allclose(points(read_segmentation(path, None)), expected(blocks))


@pytest.mark.parametrize("skip", [8, -1])
def test_what_precedes_a_metaimages_voxels_is_skipped(write_meta, blocks, points, tmp_path, skip):
    (tmp_path / "voxels.raw").write_bytes(b"12345678" + blocks.tobytes(order="F"))
    path = write_meta("a.mhd", body=b"", HeaderSize=str(skip), ElementDataFile="voxels.raw")
    assert np.allclose(points(read_segmentation(path, None)), expected(blocks))


def test_bzip2_is_refused_with_the_remedy(blocks, write_nrrd):
    path = write_nrrd("a.nrrd", blocks, encoding="bzip2")
    with pytest.raises(InputError, match=r"bzip2.*gzip"):
        read_segmentation(path, None)


@pytest.mark.parametrize("name", ["a.NRRD", "a.MHA", "a.Mha"])
def test_suffixes_in_capitals_are_known(blocks, tmp_path, name):
    image = SimpleITK.GetImageFromArray(np.ascontiguousarray(blocks.transpose()).astype(np.uint8))
    SimpleITK.WriteImage(image, tmp_path / name.lower())
    (tmp_path / name.lower()).rename(tmp_path / name)
    assert read_segmentation(tmp_path / name, None).mask.sum() == np.count_nonzero(blocks)
