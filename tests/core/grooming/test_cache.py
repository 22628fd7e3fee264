from pathlib import Path

import numpy as np
import pytest

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.grooming import groom_cohort
from homolog.grooming.cache import content_key, load_groomed
from homolog.io.images import Segmentation
from homolog.settings import Alignment, GroomSettings
from homolog.surfaces.mesh import TriangleMesh


def segmentation(mask=None, spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0)):
    mask = np.ones((3, 4, 5), bool) if mask is None else mask
    return Segmentation(mask, np.eye(3), np.array(spacing), np.array(origin))


@pytest.mark.parametrize(
    "changed",
    [{"smoothing": 0.5}, {"spacing": 1.2}, {"mesh_edge": 2.0}, {"adaptive_mesh": True}],
)
def test_settings_that_shape_the_surface_change_the_key(changed):
    assert content_key(segmentation(), GroomSettings(**changed)) != content_key(
        segmentation(), GroomSettings()
    )


@pytest.mark.parametrize("changed", [{"alignment": Alignment.NONE}, {"scaling": True}, {"label": 3}])
def test_settings_that_leave_the_voxels_and_the_surface_alone_do_not(changed):
    assert content_key(segmentation(), GroomSettings(**changed)) == content_key(
        segmentation(), GroomSettings()
    )


def test_voxels_their_arrangement_and_their_place_change_the_key():
    settings = GroomSettings()
    other = np.ones((3, 4, 5), bool)
    other[1, 1, 1] = False
    keys = {
        content_key(segmentation(), settings),
        content_key(segmentation(other), settings),
        content_key(segmentation(np.ones((5, 4, 3), bool)), settings),
        content_key(segmentation(spacing=(1.0, 1.0, 2.0)), settings),
        content_key(segmentation(origin=(1.0, 0.0, 0.0)), settings),
        content_key(TriangleMesh(np.eye(3), np.array([[0, 1, 2]])), settings),
        content_key(TriangleMesh(np.eye(3), np.array([[0, 2, 1]])), settings),
    }
    assert len(keys) == 7


def test_what_is_not_there_is_not_found(tmp_path):
    assert load_groomed(Path(tmp_path), "a", "key") is None


def test_names_that_would_share_a_file_are_refused_before_grooming(tmp_path):
    subjects = tuple(Subject(name, tmp_path / "missing.nii") for name in ("p 1", "P 1", "p:1"))
    with pytest.raises(InputError, match=r"p 1 and p:1 .* rename one"):
        groom_cohort(Cohort(subjects, tmp_path), GroomSettings(), cache=tmp_path)
