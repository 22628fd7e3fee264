"""NIfTI 1 and 2, and what their two matrices say."""

import gzip

import nibabel
import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.images import read_segmentation, read_volume

RAS = np.array([[0.0, -2.0, 0.0, 10.0], [1.5, 0.0, 0.0, 20.0], [0.0, 0.0, 3.0, 30.0], [0.0, 0.0, 0.0, 1.0]])
MOVED = RAS + np.array([[0, 0, 0, 4.0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
LARGER = np.diag([1.2, 1.2, 1.2, 1.0]) @ RAS
MIRRORED = np.diag([-1.0, 1.0, 1.0, 1.0]) @ RAS
TURNED = np.array([[0, -1.0, 0, 3], [1, 0, 0, -5], [0, 0, 1, 7], [0, 0, 0, 1]]) @ RAS
SHEARED = RAS + np.array([[0, 0, 1.0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])


def said(result):
    """Return the notes but that several labels were taken together."""
    return tuple(note for note in result.notes if "combined into one" not in note)


@pytest.fixture
def write(blocks, tmp_path):
    def save(
        qform, sform, name="a.nii.gz", kind=nibabel.Nifti1Image, units="mm", values=blocks, codes=(1, 2)
    ):
        image = kind(values, None)
        image.header.set_xyzt_units(units)
        image.header["pixdim"][1:4] = (1.5, 2.0, 3.0)
        image.set_qform(qform, codes[0] if qform is not None else 0)
        image.set_sform(sform, codes[1] if sform is not None else 0)
        nibabel.save(image, tmp_path / name)
        return tmp_path / name

    return save


def expected(blocks, matrix=RAS):
    ras = np.argwhere(blocks) @ matrix[:3, :3].T + matrix[:3, 3]
    result = ras * [-1.0, -1.0, 1.0]
    return result[np.lexsort(np.round(result, 1).T)]


@pytest.mark.parametrize("kind", [nibabel.Nifti1Image, nibabel.Nifti2Image])
@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
@pytest.mark.parametrize(("qform", "sform"), [(RAS, RAS), (RAS, None), (None, RAS)])
def test_either_version_and_matrix_puts_the_voxels_at_the_same_places(
    write, blocks, points, kind, name, qform, sform
):
    result = read_segmentation(write(qform, sform, name, kind), None)
    assert np.allclose(points(result), expected(blocks), atol=1e-4)
    assert not said(result)


@pytest.mark.parametrize("codes", [(1, 2), (1, 4), (2, 4), (2, 1), (3, 1)])
@pytest.mark.parametrize("other", [MOVED, TURNED])
def test_codes_that_name_two_frames_are_no_trouble_and_the_scanner_goes_first(
    write, blocks, points, codes, other
):
    result = read_segmentation(write(RAS, other, codes=codes), None)
    assert np.allclose(points(result), expected(blocks, other if codes[1] == 1 else RAS), atol=1e-3)
    assert said(result) == ()


@pytest.mark.parametrize("codes", [(1, 1), (2, 2), (4, 4)])
def test_two_places_in_one_frame_are_told_with_how_far_and_which_was_used(write, blocks, points, codes):
    result = read_segmentation(write(RAS, MOVED, codes=codes), None)
    used, other = (MOVED, "sform") if codes[1] == 1 else (RAS, "qform")
    assert np.allclose(points(result), expected(blocks, used), atol=1e-3)
    frame = {1: "scanner", 2: "aligned", 4: "MNI"}[codes[0]]
    assert said(result) == (
        f"its qform ({frame}) and sform ({frame}) put voxels up to 4.0 mm apart; the {other} was used, as 3D "
        "Slicer does",
    )


@pytest.mark.parametrize(
    ("other", "codes"),
    [
        *((item, codes) for item in (MOVED, SHEARED, TURNED) for codes in ((1, 1), (1, 2), (2, 1), (1, 4))),
        *((item, codes) for item in (LARGER, MIRRORED) for codes in ((1, 2), (1, 4), (2, 3))),
        (MIRRORED, (2, 1)),
    ],
)
def test_what_is_taken_lies_where_slicer_puts_it(write, points, other, codes):
    import SimpleITK

    path = write(RAS, other, codes=codes)
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    image = SimpleITK.ReadImage(path)
    index = np.argwhere(SimpleITK.GetArrayFromImage(image).T)
    there = np.array([image.TransformIndexToPhysicalPoint(item.tolist()) for item in index])
    assert np.allclose(
        points(read_segmentation(path, None)), there[np.lexsort(np.round(there, 1).T)], atol=1e-3
    )


@pytest.mark.parametrize("codes", [(1, 1), (2, 1)])
@pytest.mark.parametrize("other", [LARGER, SHEARED])
def test_a_sform_of_other_voxel_sizes_is_not_taken_and_told(write, blocks, points, codes, other):
    result = read_segmentation(write(RAS, other, codes=codes), None)
    assert np.allclose(points(result), expected(blocks), atol=1e-3)
    assert "the qform was used" in result.notes[0]


def test_mirror_images_in_one_frame_are_refused_and_in_two_frames_told(write, blocks, points):
    with pytest.raises(InputError, match=r"a\.nii\.gz: .* mirror images .* scanner"):
        read_segmentation(write(RAS, MIRRORED, codes=(1, 1)), None)
    result = read_segmentation(write(RAS, MIRRORED), None)
    assert np.allclose(points(result), expected(blocks), atol=1e-3)
    assert "mirror image of the other" in result.notes[0]


def test_rounding_is_no_disagreement(write, blocks, points):
    result = read_segmentation(write(RAS, RAS + 1e-4), None)
    assert np.allclose(points(result), expected(blocks), atol=1e-2)


def test_a_shear_is_refused(write):
    with pytest.raises(InputError, match="sform is skew"):
        read_segmentation(write(None, SHEARED), None)


def test_voxel_sizes_that_contradict_the_sform_are_refused(write):
    with pytest.raises(InputError, match="sform is skew"):
        read_segmentation(write(None, LARGER), None)


def test_a_file_that_does_not_say_how_the_patient_lay_is_read_with_a_note(write, blocks, points):
    result = read_segmentation(write(None, None), None)
    assert np.allclose(points(result), expected(blocks, np.diag([1.5, 2.0, 3.0, 1.0])), atol=1e-4)
    assert "no qform or sform" in result.notes[0]


@pytest.mark.parametrize(("units", "factor"), [("micron", 0.001), ("meter", 1000.0)])
def test_other_units_become_millimetres(write, blocks, points, units, factor):
    result = read_segmentation(write(RAS, RAS, units=units), None)
    assert np.allclose(points(result, factor), expected(blocks), atol=1e-4)


def test_scaled_values_are_read_scaled(write, tmp_path, blocks, around):
    image = nibabel.load(write(RAS, None, "a.nii"))
    image.header.set_slope_inter(2.0, 0.0)
    scaled = nibabel.Nifti1Image(blocks.astype(np.int16), None, image.header)
    scaled.to_filename(tmp_path / "b.nii")
    raw = bytearray((tmp_path / "b.nii").read_bytes())
    raw[112:116] = np.float32(2.0).tobytes()  # scl_slope
    (tmp_path / "b.nii").write_bytes(raw)
    assert np.array_equal(read_segmentation(tmp_path / "b.nii", 4).mask, around(blocks == 2))


def test_a_fourth_axis_of_one_is_no_hindrance_and_of_two_is(write, blocks):
    path = write(RAS, None, "four.nii", values=blocks[..., None])
    assert np.array_equal(read_segmentation(path, None).mask.sum(), (blocks > 0).sum())
    with pytest.raises(InputError, match="2 values per voxel"):
        read_segmentation(write(RAS, None, "two.nii", values=np.stack([blocks, blocks], axis=-1)), None)


@pytest.mark.parametrize("background", [True, False])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_channel_for_each_structure_becomes_its_label(write, blocks, background, kind):
    first = 0 if background else 1
    channels = np.stack([blocks == label for label in range(first, 3)], axis=-1).astype(kind)
    path = write(RAS, None, "one.nii", values=channels * kind(0.8) if kind is np.float32 else channels)
    volume = read_volume(path)
    assert np.array_equal(volume.layers[0], blocks)
    assert "background" in volume.notes[-1] or not background


def test_the_only_point_in_time_with_labels_is_taken(write, blocks):
    path = write(RAS, None, "time.nii", values=np.stack([0 * blocks, blocks, 0 * blocks], axis=-1))
    volume = read_volume(path)
    assert np.array_equal(volume.layers[0], blocks)
    assert "only 2 has labels" in volume.notes[-1]


def test_colours_are_refused(write):
    colours = np.zeros((4, 4, 4), [("R", "u1"), ("G", "u1"), ("B", "u1")])
    with pytest.raises(InputError, match="instead of single numbers"):
        read_segmentation(write(RAS, None, "rgb.nii", values=colours), None)


def floats(*values):
    return np.array(values, "<f4").tobytes()


def shorts(*values):
    return np.array(values, "<i2").tobytes()


NOTHING = float("nan")


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (80, floats(-1.5), "should be positive"),
        (80, floats(0.0), "should be non-zero"),
        (80, floats(NOTHING), "has the spacing"),
        (256, floats(2.0, 2.0, 2.0), "is not a readable image"),
        (256, floats(NOTHING), "has the spacing"),
        (42, shorts(90), "is cut short"),
        (42, shorts(8), "contains more voxels than its header declares"),
        (42, shorts(-9), "not a 3-D volume"),
        (40, shorts(9), "is not a readable image"),
        (70, shorts(1), "is not a readable image"),
        (108, floats(0.0), "says that voxels begin at byte 0"),
        (108, floats(400.0), "is cut short"),
        (108, floats(1e30), "says that voxels begin at byte 1000000"),
        (108, floats(NOTHING), "is not a readable image"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused_and_nothing_printed(
    write, name, place, value, message, capfd
):
    path = write(RAS, None, name)
    content = path.read_bytes() if name == "a.nii" else gzip.decompress(path.read_bytes())
    content = content[:place] + value + content[place + len(value) :]
    path.write_bytes(content if name == "a.nii" else gzip.compress(content))
    with pytest.raises(InputError, match=rf"{name}: .*{message}"):
        read_segmentation(path, None)
    assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
@pytest.mark.parametrize("value", [-1.5, 0.0])
@pytest.mark.parametrize("qform", [RAS, None])
def test_voxel_sizes_of_zero_or_below_are_those_of_the_sform(write, blocks, points, name, value, qform):
    path = write(qform, RAS, name)
    content = path.read_bytes() if name == "a.nii" else gzip.decompress(path.read_bytes())
    content = content[:80] + floats(value) + content[84:]
    path.write_bytes(content if name == "a.nii" else gzip.compress(content))
    result = read_segmentation(path, None)
    assert np.allclose(points(result), expected(blocks), atol=1e-4)
    assert "those of its sform" in said(result)[0]


@pytest.mark.parametrize(("cut", "end"), [(slice(-20), b""), (slice(-8), bytes(8))])
def test_packed_voxels_that_are_damaged_are_refused(write, cut, end):
    path = write(RAS, None, "a.nii.gz")
    path.write_bytes(path.read_bytes()[cut] + end)
    with pytest.raises(InputError, match=r"a\.nii\.gz: is cut short"):
        read_segmentation(path, None)


def test_the_other_byte_order_is_read(blocks, points, tmp_path):
    header = nibabel.Nifti1Header(endianness=">")
    nibabel.save(nibabel.Nifti1Image(blocks.astype(">i2"), RAS, header), tmp_path / "a.nii")
    assert (tmp_path / "a.nii").read_bytes()[:4] == b"\0\0\x01\x5c"
    assert np.allclose(points(read_segmentation(tmp_path / "a.nii", None)), expected(blocks), atol=1e-4)
