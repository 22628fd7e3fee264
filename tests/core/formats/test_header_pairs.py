"""Volumes whose header and voxels are two files."""

import gzip

import nibabel as nib
import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.io.images import read_volume
from homolog.io.scans import read_scan

VALUES = np.zeros((5, 6, 7), np.int16)
VALUES[1:3, 2:5, 3:6] = 2
LAS = np.diag([-1.0, 2.0, 3.0, 1.0])


def packed(path):
    path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()


@pytest.fixture
def analyze(tmp_path):
    nib.save(nib.AnalyzeImage(VALUES, LAS), tmp_path / "a.hdr")
    return tmp_path / "a.hdr"


@pytest.mark.parametrize("pack", [(), ("a.img",), ("a.img", "a.hdr")])
def test_analyze_is_read_as_las_with_a_note(analyze, pack):
    for name in pack:
        packed(analyze.with_name(name))
    (first,) = read_cohort(analyze.parent).subjects
    volume = read_volume(first.path)
    assert (first.name, np.asarray(volume.layers[0]).tolist()) == ("a", VALUES.tolist())
    assert np.allclose(volume.index_to_world, np.diag([1.0, -2.0, 3.0, 1.0]))
    assert "LAS" in volume.segmentation(2).notes[0]
    assert np.array_equal(read_scan(first.path).values, VALUES)


def test_a_pair_of_nifti_lies_where_its_header_says(tmp_path):
    affine = np.array(
        [[0.0, 0.0, 3.0, 4.0], [-1.0, 0.0, 0.0, 5.0], [0.0, 2.0, 0.0, 6.0], [0.0, 0.0, 0.0, 1.0]]
    )
    image = nib.Nifti1Pair(VALUES, affine)
    image.set_sform(affine, 1)
    nib.save(image, tmp_path / "a.hdr")
    volume = read_volume(tmp_path / "a.hdr")
    assert np.allclose(volume.index_to_world, np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine)
    assert not volume.notes


def test_headers_of_other_kinds_and_headers_without_voxels_are_refused(analyze):
    content = analyze.with_name("a.img").read_bytes()
    analyze.with_name("a.img").write_bytes(content[:-9])
    with pytest.raises(InputError, match="cut short"):
        read_volume(analyze)
    analyze.with_name("a.img").unlink()
    with pytest.raises(InputError, match=r"a\.img or a\.img\.gz"):
        read_volume(analyze)
    analyze.write_text("ENVI\nsamples = 3\n")
    with pytest.raises(InputError, match=r"a\.hdr: is not a readable image"):
        read_volume(analyze)
