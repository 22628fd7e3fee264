"""What looks like a file and has no end: pipes and devices."""

import os
from pathlib import Path

import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.io.arrays import read_arrays
from homolog.io.bounded import read_json
from homolog.io.images import read_segmentation
from homolog.io.markups import read_markups
from homolog.io.meshes import read_mesh
from homolog.io.particles import read_particles
from homolog.io.project import ProjectFolder

READERS = {
    "a.particles": read_particles,
    "a.json": lambda path: read_json(path, "kind"),
    "a.mrk.json": read_markups,
    "a.npz": read_arrays,
    "a.vtk": read_mesh,
    "a.nrrd": lambda path: read_segmentation(path, None),
    "a.nii.gz": lambda path: read_segmentation(path, None),
    "a.dcm": lambda path: read_segmentation(path, None),
    "project.json": lambda path: ProjectFolder(path.parent).read(),
    "cohort.csv": lambda path: read_cohort(path.parent),
}


@pytest.fixture(params=["pipe", "device", "folder"])
def endless(request):
    """Return a function that makes something at a path that is no file."""

    def make(path):
        match request.param:
            case "pipe":
                os.mkfifo(path)
            case "device":
                path.symlink_to("/dev/zero")
            case _:
                path.mkdir()
        return path

    return make


@pytest.mark.timeout(20)
@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="this system has no such devices")
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_refused_at_once(tmp_path, endless, name):
    with pytest.raises(InputError, match=r"."):
        READERS[name](endless(tmp_path / name))


def test_a_file_of_an_implausible_size_is_refused(tmp_path):
    with (tmp_path / "a.particles").open("wb") as stream:
        stream.truncate(2**30)
    with pytest.raises(InputError, match="too large"):
        read_particles(tmp_path / "a.particles")
