"""Grey-value scans: read once in the file's numbers, in the patient's frame, or refused."""

from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK

from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.io.scans import Scan, check_frame, read_scan

SPACING, ORIGIN = (0.5, 1.0, 2.0), (10.0, -20.0, 30.0)


@pytest.fixture
def grey() -> np.ndarray:
    return np.random.default_rng(0).integers(-1000, 1500, (7, 6, 5)).astype(np.int16)


def written(path: Path, grey: np.ndarray) -> Path:
    image = SimpleITK.GetImageFromArray(grey.T)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    SimpleITK.WriteImage(image, str(path))
    return path


@pytest.mark.parametrize("suffix", [".nrrd", ".mha", ".nii", ".nii.gz"])
def test_every_format_gives_the_same_slices_in_the_same_place(tmp_path, grey, suffix):
    scan = read_scan(written(tmp_path / f"a{suffix}", grey))
    assert scan.values.dtype == np.int16
    assert np.array_equal(scan.plane(2, 3), grey[:, :, 3])
    assert np.allclose(scan.spacing, SPACING)
    assert np.allclose(scan.box[0], ORIGIN, atol=1e-4)


def test_slope_and_intercept_are_applied_to_slices_only(tmp_path, grey):
    image = nibabel.Nifti1Image(2.0 * grey - 1024.0, np.eye(4), dtype=np.int16)
    image.header.set_slope_inter(2.0, -1024.0)
    image.to_filename(tmp_path / "scaled.nii.gz")
    scan = read_scan(tmp_path / "scaled.nii.gz")
    assert scan.values.dtype == np.int16
    assert np.allclose(scan.plane(0, 1), nibabel.load(scan.path).get_fdata()[1])
    assert (scan.slope, scan.intercept) == (2.0, -1024.0)


def test_an_uncompressed_nifti_stays_on_the_disk(tmp_path, grey):
    assert isinstance(read_scan(written(tmp_path / "a.nii", grey)).values, np.memmap)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd"])
def test_a_scan_that_is_cut_short_is_refused_by_name(tmp_path, grey, suffix):
    path = written(tmp_path / f"cut{suffix}", grey)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match="cut"):
        read_scan(path)


def test_a_scan_that_shows_the_structure_is_accepted_whatever_its_grid(tmp_path, grey):
    scan = read_scan(written(tmp_path / "a.nrrd", grey))
    middle = scan.box.mean(axis=0) + np.random.default_rng(1).normal(scale=0.3, size=(50, 3))
    assert check_frame(scan, middle, "a") == 1.0


def test_a_scan_in_another_frame_is_refused_with_both_boxes(tmp_path, grey):
    scan = read_scan(written(tmp_path / "a.nrrd", grey))
    elsewhere = scan.box.mean(axis=0) + np.array([400.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"10 to 13 x -20 to -15 x 30 to 38 mm.*401 mm apart"):
        check_frame(scan, elsewhere + np.eye(3), "a")


def test_an_oblique_scan_is_judged_along_its_own_axes():
    turn = np.eye(4)
    turn[:2, :2] = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    scan = Scan(Path("a"), np.zeros((40, 4, 4), np.uint8), turn)
    corner_of_the_box = np.array([[2.0, 26.0, 1.0]])
    within = transform_points(turn, np.array([[38.0, 1.0, 1.0]]))
    assert check_frame(scan, within, "a") == 1.0
    with pytest.raises(InputError):
        check_frame(scan, corner_of_the_box, "a")


def test_the_automatic_window_leaves_air_and_outliers_out():
    values = np.zeros((40, 40, 40), np.float32)
    values[10:30, 10:30, 10:30] = np.random.default_rng(2).uniform(100.0, 200.0, (20, 20, 20))
    values[15, 15, 15] = 1e6
    low, high = Scan(Path("a"), values, np.eye(4)).automatic_window()
    assert 90.0 < low < 110.0
    assert 190.0 < high < 210.0


def test_a_slice_is_taken_without_a_copy_of_the_scan():
    import tracemalloc

    values = np.zeros((60, 60, 400), np.int16, order="F")
    scan = Scan(Path("a"), values, np.eye(4))
    tracemalloc.start()
    for axis in range(3):
        scan.plane(axis, 7)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < values.nbytes / 4
