"""Grooming of single subjects that differs from the cohort's: the column ``grooming``."""

import numpy as np
import pytest
import SimpleITK

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.grooming import groom_cohort
from homolog.registration import align_cohort, check_sides
from homolog.settings import GroomSettings, OwnGrooming, Pieces, Turn

SETTINGS = GroomSettings(mesh_edge=2.0)


def write_scan(path, loose):
    """Write a long body that is unlike itself turned or mirrored, with a loose piece or none."""
    x, y, z = np.meshgrid(*[np.arange(-16.0, 17.0)] * 2, np.arange(-20.0, 21.0), indexing="ij")
    mask = np.square(x / 5.0) + np.square(y / 7.0) + np.square(z / 14.0) <= 1.0
    mask |= np.square(x - 4.0) + np.square(y - 4.0) + np.square(z - 8.0) <= 16.0
    if loose:
        mask |= np.square(x) + np.square(y + 13.0) + np.square(z) <= 9.0
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(mask.astype(np.uint8).T), path)


@pytest.fixture
def cohort_of(tmp_path):
    """Return a function that makes a cohort of four like bodies, with what the table says of the last."""

    def made(text):
        for name in "abcd":
            write_scan(tmp_path / f"{name}.nrrd", loose=name == "d")
        rows = [f"{name},{name}.nrrd,{text * (name == 'd')}" for name in "abcd"]
        (tmp_path / "cohort.csv").write_text("\n".join(["name,path,Grooming", *rows]) + "\n")
        return read_cohort(tmp_path / "cohort.csv")

    return made


def test_a_cell_is_read_and_written():
    own = OwnGrooming.read(" pieces=all;tunnels = 10; turned=long; mirrored=yes", "a")
    assert own == OwnGrooming(pieces=Pieces.ALL, tunnels=10.0, turned=Turn.LONG, mirrored=True)
    assert OwnGrooming.read(own.text, "a") == own
    assert OwnGrooming.read("", "a") == OwnGrooming()
    applied = own.applied(SETTINGS)
    assert (applied.pieces, applied.tunnels, applied.mesh_edge) == (Pieces.ALL, 10.0, 2.0)


@pytest.mark.parametrize("text", ["pieces=both", "colour=red", "turned", "tunnels=99", "label=-3"])
def test_a_cell_that_is_not_understood_is_refused_with_the_subject(text, cohort_of):
    cohort = cohort_of(text)
    with pytest.raises(InputError, match=f"^d: {text}"):
        groom_cohort(cohort, SETTINGS)


def test_only_the_subject_whose_table_says_so_keeps_all_its_pieces(cohort_of, tmp_path):
    before = groom_cohort(cohort_of(""), SETTINGS, cache=tmp_path / "kept")
    after = groom_cohort(cohort_of("pieces=all"), SETTINGS, cache=tmp_path / "kept")
    assert [item.report.components_dropped for item in before] == [0, 0, 0, 1]
    assert [item.report.components_dropped for item in after] == [0, 0, 0, 0]
    assert any("joined by bridges" in note for note in after[3].report.notes)
    assert after[3].report.volume_after > before[3].report.volume_after
    for first, second in zip(before[:3], after[:3], strict=True):
        assert np.array_equal(first.mesh.vertices, second.mesh.vertices)


@pytest.mark.parametrize("method", ["icp", "axes", "none"])
def test_a_subject_is_turned_about_the_axis_that_its_table_names(cohort_of, method):
    settings = SETTINGS.model_copy(update={"alignment": method})
    groomed = groom_cohort(cohort_of(""), settings)
    poses = [align_cohort(cohort_of(text), groomed, settings)[1] for text in ("", "turned=long")]
    assert np.allclose(poses[0][:3], poses[1][:3])
    turn = (poses[1] @ np.linalg.inv(poses[0]))[3, :3, :3]
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert np.trace(turn) == pytest.approx(-1.0, abs=0.1)  # 180°
    assert turn[2, 2] > 0.95


def test_a_subject_is_mirrored_as_its_table_says(cohort_of):
    groomed = groom_cohort(cohort_of(""), SETTINGS)
    aligned, poses = align_cohort(cohort_of("mirrored=yes"), groomed, SETTINGS)
    assert (np.linalg.det(poses[:, :3, :3]) < 0.0).tolist() == [False, False, False, True]
    assert "mirrored, as its table says" in aligned[3].report.notes


def test_a_wrong_cell_is_refused_before_anything_is_computed(cohort_of):
    with pytest.raises(InputError, match="turned=up"):
        check_sides(cohort_of("turned=up"), SETTINGS)
