"""Labels that are read together under one name: ``wall=2+3``."""

import numpy as np
import pytest
from pydantic import ValidationError

from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.grooming.subject import read_source
from homolog.settings import GroomSettings


@pytest.fixture
def scan(tmp_path):
    """Return a label map of three boxes with labels 1 to 3."""
    import nibabel

    labels = np.zeros((20, 10, 10), np.uint8)
    for value in (1, 2, 3):
        labels[5 * value - 3 : 5 * value + 1, 2:8, 2:8] = value
    path = tmp_path / "scan.nii.gz"
    nibabel.save(nibabel.Nifti1Image(labels, np.diag([1.0, 2.0, 1.0, 1.0])), path)
    return path


def read(path, structures):
    settings = GroomSettings(structures=structures).of_structures
    return {name: read_source(Subject("s", path), own) for name, own in settings.items()}


def test_labels_are_joined_under_a_name(scan):
    read_structures = read(scan, "wall=2+3, core=1")
    assert list(read_structures) == ["wall", "core"]
    wall, two, three = read_structures["wall"], *read(scan, "2,3").values()
    assert wall.volume == two.volume + three.volume
    assert np.allclose(wall.rotation, two.rotation)


def test_a_joined_mask_lies_where_its_labels_lie(scan):
    wall, whole = read(scan, "wall=1+3,rest=2")["wall"], read(scan, "all=1+2+3,rest=2")["all"]
    for mask in (wall, whole):
        inside = np.argwhere(mask.mask)
        corner = mask.origin + (mask.rotation * mask.spacing) @ inside.min(axis=0)
        opposite = mask.origin + (mask.rotation * mask.spacing) @ inside.max(axis=0)
        low, high = np.minimum(corner, opposite), np.maximum(corner, opposite)
        assert np.allclose(high - low, [13.0, 10.0, 5.0])


def test_a_missing_label_of_a_joined_structure_is_named(scan):
    with pytest.raises(InputError, match="no voxel of label 7"):
        read(scan, "wall=2+7,core=1")


@pytest.fixture
def cup(tmp_path):
    """Return a label map of a cup of labels 2 and 3, open at an end and lying across the axes of its file."""
    import nibabel

    labels = np.zeros((20, 12, 12), np.uint8)
    labels[2:16, 2:10, 2:10] = 2
    labels[2:16, 2:6, 2:10][labels[2:16, 2:6, 2:10] == 2] = 3
    labels[4:16, 4:8, 4:8] = 0
    path = tmp_path / "cup.nii.gz"
    nibabel.save(nibabel.Nifti1Image(labels, np.diag([1.0, 2.0, 1.0, 1.0])), path)
    return path


def test_a_cavity_is_what_a_wall_encloses_in_its_slices(cup):
    cavity = read(cup, "wall=2+3,cavity=inside(wall)")["cavity"]
    assert cavity.volume == 12 * 4 * 4 * 2.0
    alike = read(cup, "cavity=inside(2+3),half=2")["cavity"]
    assert np.array_equal(alike.mask, cavity.mask)


def test_what_encloses_nothing_has_no_cavity(cup, scan):
    with pytest.raises(InputError, match="encloses no voxel"):
        read(cup, "cavity=inside(2),wall=3")
    with pytest.raises(InputError, match="encloses no voxel"):
        read(scan, "cavity=inside(core),core=1")


@pytest.mark.parametrize("text", ["femur", "femur,femur", "femur,,tibia", "=2,tibia"])
def test_a_list_that_does_not_name_several_structures_is_refused(text):
    with pytest.raises(ValidationError, match="two or more structures"):
        GroomSettings(structures=text)
