import numpy as np
import pytest
import SimpleITK
from scipy import ndimage

from homolog.errors import InputError
from homolog.io.images import read_segmentation, read_volume
from homolog.settings import Values


def world_points(segmentation):
    inside = np.argwhere(segmentation.mask) * segmentation.spacing
    return inside @ segmentation.rotation.T + segmentation.origin


@pytest.fixture
def labelled():
    values = np.zeros((6, 7, 8), np.uint8)
    values[1:3, 2:4, 3] = 1
    values[3, 2:5, 4:6] = 2
    return values


def test_every_value_above_zero_is_inside_without_a_label(labelled, save):
    assert read_segmentation(save(labelled), None).mask.sum() == 10


def test_labels_that_are_taken_together_are_noted(labelled, save):
    together, alone = (read_segmentation(save(labelled), label) for label in (None, 2))
    assert [note for note in together.notes if "combined into one" in note]
    assert not [note for note in alone.notes if "combined into one" in note]
    assert not [note for note in read_segmentation(save(labelled == 2), None).notes if "together" in note]


def test_the_note_on_labels_that_are_taken_together_gives_their_names(labelled, save, tmp_path):
    path = save(labelled)
    table = '1 255 0 0 1 1 1 "Niere links"\n2 0 255 0 1 1 1 "Zyste"\n'
    (tmp_path / "Labels.txt").write_text(table, encoding="utf-8")
    note = next(note for note in read_segmentation(path, None).notes if "combined into one" in note)
    assert "Niere links (1), Zyste (2)" in note


def test_a_label_is_picked_alone_with_one_voxel_around_it(labelled, save, around):
    result = read_segmentation(save(labelled), 2)
    assert np.array_equal(result.mask, around(labelled == 2))
    assert result.volume == 6.0


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".mha", ".mhd", ".nhdr"])
def test_each_format_puts_the_voxels_at_the_same_places(labelled, save, suffix):
    turn = np.array([[0.0, -1.0, 0.0], [0.8, 0.0, -0.6], [0.6, 0.0, 0.8]])
    path = save(labelled, f"a{suffix}", (1.0, 2.0, 3.0), (5.0, -6.0, 7.0), turn)
    expected = np.argwhere(labelled) * [1.0, 2.0, 3.0] @ turn.T + [5.0, -6.0, 7.0]
    assert np.allclose(world_points(read_segmentation(path, None)), expected, atol=1e-4)


def test_a_mirrored_grid_becomes_right_handed_at_the_same_places(labelled, save):
    mirrored = save(labelled, direction=np.diag([1.0, 1.0, -1.0]), origin=(1.0, 2.0, 3.0))
    result = read_segmentation(mirrored, None)
    expected = np.argwhere(labelled) * [1.0, 1.0, -1.0] + [1.0, 2.0, 3.0]
    assert np.linalg.det(result.rotation) == pytest.approx(1.0)
    assert {tuple(world_point) for world_point in world_points(result)} == {tuple(item) for item in expected}


def test_an_absent_label_is_named_with_those_that_are_there(labelled, save):
    with pytest.raises(InputError, match=r"a\.nrrd.*label 7; it contains 1, 2"):
        read_segmentation(save(labelled), 7)


def test_an_empty_label_map_is_refused(save):
    with pytest.raises(InputError, match="no voxel above 0"):
        read_segmentation(save(np.zeros((4, 4, 4), np.uint8)), None)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gone\.nrrd: does not exist"):
        read_segmentation(tmp_path / "gone.nrrd", None)


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".mha"])
def test_a_file_cut_short_is_refused(save, suffix):
    noise = np.random.default_rng(0).integers(0, 2, (30, 30, 30)).astype(np.uint8)
    path = save(noise, f"a{suffix}")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(InputError, match=r"cut short|no readable"):
        read_segmentation(path, None)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.nii", "is not a readable image"),
        ("a.nii.gz", "is not a readable image"),
        ("a.nrrd", "is not a readable image"),
        ("a.tif", "can't be read"),
        ("a.mnc", "has an unsupported type; convert it"),
        ("a.raw", "choose its header file if there is one"),
    ],
)
def test_something_else_under_an_image_name_is_refused(tmp_path, name, message):
    path = tmp_path / name
    path.write_text("not an image")
    with pytest.raises(InputError, match=rf"{name}: .*{message}"):
        read_segmentation(path, None)


@pytest.mark.parametrize(("written", "called"), [("a.nii.gz", "b.nii"), ("a.nii", "b.nii.gz")])
@pytest.mark.parametrize("version", [1, 2])
def test_a_name_that_says_wrongly_whether_the_file_is_compressed_is_noted(tmp_path, written, called, version):
    import nibabel

    mask = np.zeros((5, 6, 7), np.uint8)
    mask[1:4, 2:4, 3:6] = 1
    kind = nibabel.Nifti1Image if version == 1 else nibabel.Nifti2Image
    kind(mask, np.diag([1.0, 2.0, 3.0, 1.0])).to_filename(tmp_path / written)
    expected = read_segmentation(tmp_path / written, None)
    result = read_segmentation((tmp_path / written).rename(tmp_path / called), None)
    assert np.array_equal(result.mask, expected.mask)
    assert np.array_equal(result.spacing, [1.0, 2.0, 3.0])
    assert any("although its name" in note for note in result.notes)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("noise", [1e-7, 1e-4])
def test_label_values_that_are_nearly_whole_are_taken_as_whole(save, kind, noise):
    rng = np.random.default_rng(3)
    labels = rng.integers(0, 3, (9, 8, 7))
    labels[0, 0] = 0
    path = save((labels + rng.uniform(-noise, noise, labels.shape)).astype(kind))
    assert [segment.value for segment in read_volume(path).segments()] == [1, 2]
    assert np.count_nonzero(read_segmentation(path, None).mask) == np.count_nonzero(labels)
    assert np.count_nonzero(read_segmentation(path, 2).mask) == np.count_nonzero(labels == 2)


@pytest.mark.parametrize("shape", [(5, 6), (5, 6, 1), (4, 5, 6, 2)])
def test_an_image_of_two_or_four_dimensions_is_refused(tmp_path, shape):
    values = np.ones(shape[::-1], np.uint8)
    path = tmp_path / "a.nrrd"
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values, isVector=False), str(path))
    with pytest.raises(InputError, match=f"not a 3-D volume but {' x '.join(map(str, shape))};"):
        read_segmentation(path, None)


def test_a_colour_image_is_refused(tmp_path):
    path = tmp_path / "a.nrrd"
    image = SimpleITK.GetImageFromArray(np.ones((4, 4, 4, 3), np.uint8), isVector=True)
    SimpleITK.WriteImage(image, str(path))
    with pytest.raises(InputError, match="3 values per voxel"):
        read_segmentation(path, None)


def test_not_a_number_is_refused(save):
    values = np.ones((4, 4, 4), np.float32)
    values[1, 2, 3] = np.nan
    with pytest.raises(InputError, match="not numbers"):
        read_segmentation(save(values), None)


def test_an_intensity_image_is_refused(save):
    with pytest.raises(InputError, match="segment pictures first"):
        read_segmentation(save(np.linspace(0, 1, 64, dtype=np.float32).reshape(4, 4, 4)), None)


def test_an_absurd_size_in_the_header_is_refused_before_reading(tmp_path):
    path = tmp_path / "a.nrrd"
    path.write_text(
        "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 90000 90000 90000\n"
        "space directions: (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\nspace origin: (0,0,0)\n\n1234"
    )
    with pytest.raises(InputError, match="90000 x 90000 x 90000 voxels"):
        read_segmentation(path, None)


def test_a_header_with_broken_text_is_read_all_the_same(labelled, save):
    path = save(labelled, "a.mha")
    path.write_bytes(path.read_bytes().replace(b"CenterOfRotation", b"CenterOfRot\xff\xfeon"))
    assert read_segmentation(path, None).mask.sum() == 10


@pytest.mark.parametrize("name", ["a.mha", "a.nrrd", "a.mhd"])
def test_one_point_in_time_is_a_volume(tmp_path, labelled, name):
    moment = SimpleITK.GetImageFromArray(labelled.T)
    moment.SetSpacing([1.0, 2.0, 3.0])
    moment.SetDirection([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    SimpleITK.WriteImage(moment, tmp_path / f"three_{name}")
    SimpleITK.WriteImage(SimpleITK.JoinSeries([moment]), tmp_path / name)
    result, expected = (read_segmentation(tmp_path / item, None) for item in (name, f"three_{name}"))
    assert np.array_equal(result.mask, expected.mask)
    assert np.allclose(result.rotation, expected.rotation)
    assert np.allclose(result.spacing, expected.spacing)
    assert np.allclose(result.origin, expected.origin)


BALL = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 8.0
AWAY = ndimage.distance_transform_edt(~BALL) - ndimage.distance_transform_edt(BALL)
SOFT = ndimage.gaussian_filter(BALL.astype(np.float32), 1.0)


@pytest.mark.parametrize("full", [1.0, 17.0, 100.0, 255.0])
@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_declared_probabilities_are_the_structure_from_a_half_on(save, full, kind):
    if kind is np.uint8 and full <= 1.0:
        pytest.skip("has no values between")
    result = read_segmentation(save((full * SOFT).astype(kind)), None, None, Values.PROBABILITY)
    assert result.mask.sum() == pytest.approx(BALL.sum(), rel=0.1)
    assert any("at least" in note for note in result.notes)


@pytest.mark.parametrize("order", [1, 3])
def test_an_interpolated_mask_that_overshoots_may_be_declared_as_probabilities(save, order):
    finer = ndimage.zoom(BALL[::2, ::2, ::2].astype(np.float32), 2, order=order)
    result = read_segmentation(save(finer), None, None, Values.PROBABILITY)
    assert result.mask.sum() == (finer >= 0.5).sum()


@pytest.mark.parametrize(
    "values",
    [
        AWAY.astype(np.float32),
        (-AWAY).astype(np.float32),
        (np.sign(AWAY) * AWAY**2).astype(np.int32),  # as SimpleITK's SignedMaurerDistanceMap
        (-np.rint(AWAY)).astype(np.int16),
        np.clip(AWAY / 4.0, -1.0, 1.0).astype(np.float32),
    ],
    ids=["negative inside", "positive inside", "squared", "whole numbers", "cut off"],
)
def test_declared_distances_are_the_structure_on_the_side_away_from_the_border(save, values):
    result = read_segmentation(save(values), None, None, Values.DISTANCE)
    assert result.mask.sum() == BALL.sum()
    assert any("distances" in note for note in result.notes)


@pytest.mark.parametrize(
    ("values", "declared", "looks"),
    [
        (AWAY, Values.LABELS, "values: distance"),
        (SOFT, Values.LABELS, "values: probability"),
        (np.rint(AWAY).astype(np.int16), Values.LABELS, "values: distance"),
        (AWAY, Values.PROBABILITY, "signed distances"),
        (SOFT, Values.DISTANCE, "labels or probabilities"),
        (BALL.astype(np.uint8), Values.DISTANCE, "labels or probabilities"),
    ],
)
def test_values_that_are_not_what_was_declared_are_refused_with_what_they_look_like(
    save, values, declared, looks
):
    values = values.astype(np.float32) if values.dtype == np.float64 else values
    with pytest.raises(InputError, match=f"a.nrrd: .*{looks}"):
        read_segmentation(save(values), None, None, declared)


@pytest.mark.parametrize(
    "values",
    [
        np.where(BALL, -1, 0).astype(np.int8),
        np.where(BALL, 1, -1024).astype(np.int16),
        np.where(BALL, 1.0, np.nan).astype(np.float32),
        np.where(BALL, 1 / 255, 0.0).astype(np.float32),
    ],
    ids=["value below 0", "background below 0", "not a number outside", "a fraction"],
)
def test_two_values_are_a_mask_with_a_note(save, values):
    result = read_segmentation(save(values), None)
    assert result.mask.sum() == BALL.sum()
    assert len(result.notes) == 1


def test_values_that_are_not_numbers_inside_are_refused(save):
    with pytest.raises(InputError, match="not numbers"):
        read_segmentation(save(np.where(BALL, np.nan, 1.0).astype(np.float32)), None)


def turned(labels, order):
    """Return a map rotated by 17 degrees, rounded, as if it had been registered with interpolation."""
    return np.rint(ndimage.rotate(labels.astype(float), 17, order=order, reshape=False)).astype(np.int16)


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("full", [2, 3, 17])
def test_labels_that_were_interpolated_are_never_taken_in_silence(save, order, full):
    path = save(np.maximum(turned(full * BALL, order), 0))
    with pytest.raises(InputError, match=r"interpolated.*nearest neighbour"):
        read_segmentation(path, None)
    (note,) = read_segmentation(path, full).notes
    assert "nearest neighbour" in note


def test_an_interpolated_map_of_a_public_list_is_refused_too(save):
    blocks = np.array([2, 3, 4, 10, 11, 12, 13, 17, 41, 42, 49, 53])[np.arange(12).reshape(2, 2, 3)]
    labels = np.pad(np.kron(blocks, np.ones((6, 6, 6), int)), 4)
    read_segmentation(save(turned(labels, 0)), None)
    with pytest.raises(InputError, match=r"interpolated.*nearest neighbour"):
        read_segmentation(save(np.maximum(turned(labels, 1), 0)), None)


def test_labels_turned_by_nearest_neighbour_are_taken_without_a_word(save):
    nested = np.where(np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 5.0, 3, 2) * BALL
    result = read_segmentation(save(turned(nested, 0)), 3)
    assert result.mask.any()
    assert not result.notes


def test_labels_in_layers_are_not_soft_edges(save):
    away = np.abs(np.indices((28, 28, 28)) - 13.5).max(axis=0).astype(int)
    layers = np.maximum(12 - away, 0) // 2
    assert read_segmentation(save(layers.astype(np.uint8)), None).mask.sum() == np.count_nonzero(layers)


def test_layers_of_one_voxel_are_taken_if_a_table_names_them(save, tmp_path):
    layers = np.where(np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 7.0, 2, 1) * BALL
    path = save(layers.astype(np.uint8))
    with pytest.raises(InputError, match="table next to the file"):
        read_segmentation(path, None)
    (tmp_path / "labels.txt").write_text("1 wall\n2 lumen\n")
    assert read_segmentation(path, None).mask.sum() == BALL.sum()


def test_labels_that_lie_apart_are_not_taken_together(save):
    labels = np.zeros((24, 12, 12), np.uint8)
    labels[2:10, 2:10, 2:10] = 1
    labels[13:21, 2:10, 2:10] = 2
    with pytest.raises(InputError, match="do not touch"):
        read_segmentation(save(labels), None)
    labels[10:13, 4:8, 4:8] = 1
    assert read_segmentation(save(labels), None).mask.sum() == (labels > 0).sum()


def test_pieces_that_all_have_the_same_labels_are_taken_together(save):
    labels = np.zeros((24, 12, 12), np.uint8)
    labels[2:10, 2:10, 2:10] = labels[13:20, 2:10, 2:10] = 1
    labels[4:8, 4:8, 4:8] = labels[15:18, 4:8, 4:8] = 2
    assert read_segmentation(save(labels), None).mask.sum() == (labels > 0).sum()


def test_a_picture_of_few_grey_values_is_refused(save):
    with pytest.raises(InputError, match="picture"):
        read_segmentation(
            save(np.random.default_rng(3).integers(0, 255, (16, 16, 16)).astype(np.uint8)), None
        )
    many = np.kron(np.arange(64).reshape(4, 4, 4), np.ones((6, 6, 6))).astype(np.uint8)
    assert read_segmentation(save(many), None).mask.any()
