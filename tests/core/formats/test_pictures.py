"""Masks as stacks of pictures: a folder of slices for each subject, and TIFF files of several pages."""

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.io.images import read_segmentation
from homolog.settings import Values

SIZE = (12, 10, 8)


@pytest.fixture
def ball():
    places = np.indices(SIZE).T - [6.0, 5.0, 4.0]
    return ((places**2).sum(axis=-1) < 12.0).T


def write_slices(folder, mask, name="mask_{}.png", step=1):
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(mask.shape[2]):
        Image.fromarray(255 * mask[..., number].T.astype(np.uint8)).save(
            folder / name.format(step * number + 2)
        )


def write_pages(path, mask, info=None):
    pages = [Image.fromarray(255 * mask[..., number].T.astype(np.uint8)) for number in range(mask.shape[2])]
    pages[0].save(path, save_all=True, append_images=pages[1:], tiffinfo=info or {})


def size_file(folder, text="0.5 0.5 2"):
    (folder / "voxel_size.txt").write_text(text)


def check(segmentation, mask):
    assert segmentation.mask.sum() == mask.sum()
    assert segmentation.spacing == pytest.approx([0.5, 0.5, 2.0])
    first = [int(np.flatnonzero(mask.any(axis=axes))[0]) - 1 for axes in ((1, 2), (0, 2), (0, 1))]
    assert segmentation.origin == pytest.approx(np.array(first) * [0.5, 0.5, 2.0])
    assert any("orientation" in note for note in segmentation.notes)


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
@pytest.mark.parametrize("inner", [".", "masks"])
def test_a_folder_of_slices_for_each_subject_is_a_cohort(tmp_path, ball, suffix, inner):
    for name in ("anna", "ben"):
        write_slices(tmp_path / name / inner, ball, "mask_{}." + suffix)  # 2 to 9: 10 would come before 2
        if inner == "masks":
            write_slices(tmp_path / name / "images", ball)
    size_file(tmp_path)
    cohort = read_cohort(tmp_path, "{subject}/masks" if inner == "masks" else None)
    assert [subject.name for subject in cohort.subjects] == ["anna", "ben"]
    check(read_segmentation(cohort.subjects[1].path, None), ball)


def test_masks_and_images_may_be_folders_above_the_subjects(tmp_path, ball):
    for kind in ("images", "masks"):
        for name in ("anna", "ben"):
            write_slices(tmp_path / kind / name, ball)
    cohort = read_cohort(tmp_path, "masks/{subject}")
    assert [subject.path for subject in cohort.subjects] == [tmp_path / "masks" / n for n in ("anna", "ben")]


def test_slices_are_ordered_by_their_numbers(tmp_path):
    mask = np.zeros((6, 6, 12), bool)
    mask[2:4, 2:4, 9:11] = True
    write_slices(tmp_path / "a", mask)
    size_file(tmp_path)
    assert read_segmentation(tmp_path / "a", None).origin == pytest.approx([0.5, 0.5, 16.0])


def test_labels_of_palettes_are_kept(tmp_path, ball):
    for number in range(SIZE[2]):
        picture = Image.fromarray(7 * ball[..., number].T.astype(np.uint8)).convert("P")
        picture.putdata((7 * ball[..., number].T).ravel().tolist())
        picture.save(tmp_path / f"{number}.png")
    size_file(tmp_path)
    assert read_segmentation(tmp_path, 7).mask.sum() == ball.sum()


def test_soft_edges_declared_as_probabilities_are_cut_at_half(tmp_path, ball):
    rng = np.random.default_rng(0)
    soft = 255.0 * np.kron(ball, np.ones((4, 4, 1)))
    edge = rng.random(soft.shape) < 0.1
    soft[edge] = np.where(
        soft[edge] > 0, rng.integers(128, 256, edge.sum()), rng.integers(0, 128, edge.sum())
    )
    for number in range(SIZE[2]):
        Image.fromarray(soft[..., number].T.astype(np.uint8)).save(tmp_path / f"{number}.png")
    size_file(tmp_path)
    result = read_segmentation(tmp_path, None, None, Values.PROBABILITY)
    assert result.mask.sum() == 16 * ball.sum()
    assert any("at least" in note for note in result.notes)


def test_pages_of_tiff_files_are_slices_with_the_size_that_imagej_and_ome_noted(tmp_path, ball):
    imagej = TiffImagePlugin.ImageFileDirectory_v2()
    imagej[270] = "ImageJ=1.54f\nimages=8\nslices=8\nunit=mm\nspacing=2.0\n"
    imagej[282] = imagej[283] = 2.0
    write_pages(tmp_path / "p1.tif", ball, imagej)
    sizes = 'PhysicalSizeX="500" PhysicalSizeY="0.5" PhysicalSizeYUnit="mm" PhysicalSizeZ="2000.0"'
    write_pages(tmp_path / "p2.tif", ball, {270: f"<OME><Image><Pixels {sizes}/></Image></OME>"})
    cohort = read_cohort(tmp_path)
    assert [subject.name for subject in cohort.subjects] == ["p1", "p2"]
    for subject in cohort.subjects:
        check(read_segmentation(subject.path, None), ball)


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_pictures_without_a_size_are_refused_with_the_file_to_write(tmp_path, ball, kind):
    path = tmp_path / ("a" if kind == "folder" else "a.tif")
    (write_slices if kind == "folder" else write_pages)(path, ball)
    with pytest.raises(InputError, match=r"voxel_size\.txt .* 0\.5 0\.5 2"):
        read_segmentation(path, None)


@pytest.mark.parametrize("text", ["", "1 1", "1 1 0", "1 1 x", "1 1 nan"])
def test_a_size_that_makes_no_sense_is_refused(tmp_path, ball, text):
    write_slices(tmp_path, ball)
    size_file(tmp_path, text)
    with pytest.raises(InputError, match=r"voxel_size\.txt: should contain three numbers"):
        read_segmentation(tmp_path, None)


def test_stacks_with_gaps_of_several_kinds_or_sizes_or_in_colours_are_refused(tmp_path, ball):
    size_file(tmp_path)
    for name in ("gap", "kinds", "size", "colour"):
        write_slices(tmp_path / name, ball)
    (tmp_path / "gap" / "mask_5.png").unlink()
    write_slices(tmp_path / "kinds", ball, "scan_{}.png")
    Image.fromarray(np.zeros((5, 5), np.uint8)).save(tmp_path / "size" / "mask_4.png")
    Image.fromarray(np.arange(360, dtype=np.uint8).reshape(10, 12, 3)).save(
        tmp_path / "colour" / "mask_4.png"
    )
    for name, text in {
        "gap": "missing after number 4",
        "kinds": "order of its slices",
        "size": "differs in size",
        "colour": "colour",
    }.items():
        with pytest.raises(InputError, match=text):
            read_segmentation(tmp_path / name, None)


def test_masks_in_one_colour_are_read_and_in_two_refused(tmp_path, ball):
    size_file(tmp_path)
    red, green = np.array([200, 0, 0]), np.array([0, 90, 0])
    for name, other in (("one", red), ("two", green)):
        (tmp_path / name).mkdir()
        for number, rows in enumerate(ball.transpose()):
            colour = other if number == 5 else red
            pixels = (rows[..., None] * colour).astype(np.uint8)
            Image.fromarray(pixels).save(tmp_path / name / f"mask_{number}.png")
    assert read_segmentation(tmp_path / "one", None).mask.sum() == np.count_nonzero(ball)
    with pytest.raises(InputError, match="has several colours"):
        read_segmentation(tmp_path / "two", None)


def test_the_folder_of_one_stack_is_no_cohort(tmp_path, ball):
    write_slices(tmp_path, ball)
    with pytest.raises(InputError, match="the slices of one series"):
        read_cohort(tmp_path)


def test_pictures_beside_segmentations_are_left_alone(tmp_path, ball):
    import nibabel

    for name in ("a", "b"):
        (tmp_path / "labels").mkdir(exist_ok=True)
        nibabel.Nifti1Image(ball.astype(np.uint8), np.eye(4)).to_filename(
            tmp_path / "labels" / f"{name}.nii.gz"
        )
    write_slices(tmp_path / "figures", ball)
    with pytest.raises(InputError, match=r'  "labels/\{subject\}\.nii\.gz"  2 subjects'):
        read_cohort(tmp_path)
