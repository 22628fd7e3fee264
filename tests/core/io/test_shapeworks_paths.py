"""Projects that were written on other machines: Windows paths, whole paths."""

import json
import os

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.io.shapeworks import leads_out, place_of
from homolog.io.shapeworks_export import write_shapeworks
from homolog.run.import_model import import_model


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "study" / "my particles").mkdir(parents=True)
    (tmp_path / "study" / "my particles" / "a.particles").touch()
    (tmp_path / "elsewhere.ply").touch()
    return tmp_path / "study"


@pytest.mark.parametrize(
    "path",
    [
        "my particles/a.particles",
        "my%20particles/a.particles",
        r"my particles\a.particles",
        r".\my particles\a.particles",
        r"C:\Users\Jo\study\my particles\a.particles",
        "D:/study/my particles/a.particles",
        r"\\server\share\study\my particles\a.particles",
        "/home/jo/study/my particles/a.particles",
    ],
)
def test_paths_of_every_system_lead_to_the_file(folder, path):
    assert os.path.samefile(place_of(path, folder), folder / "my particles" / "a.particles")


@pytest.mark.parametrize(
    "path", [r"C:\x\gone.ply", "/gone/b.ply", r"\\server\share\b.ply", r"C:\x\..\..\elsewhere.ply", "C:", "/"]
)
def test_whole_paths_of_files_that_are_not_here_lead_nowhere(folder, path):
    assert place_of(path, folder) in (None, folder / "/")


def test_a_whole_path_that_is_there_is_followed_and_a_relative_one_that_is_not_is_kept(folder):
    assert place_of(str(folder.parent / "elsewhere.ply"), folder) == folder.parent / "elsewhere.ply"
    assert place_of("gone.ply", folder) == folder / "gone.ply"


@pytest.mark.parametrize(
    ("path", "out"), [("a/b.ply", False), ("a/../b.ply", True), ("C:b", True), ("/b", True)]
)
def test_ways_out_of_the_folder_are_seen(path, out):
    assert leads_out(path) is out


@pytest.fixture
def rewrite(exported, content):
    """Return a function that changes every path of the project and writes it again."""

    def write(change):
        for row in content["data"]:
            for key in ("local_particles_1", "world_particles_1", "groomed_1", "shape_1"):
                row[key] = change(row[key])
        exported.write_text(json.dumps(content), encoding="utf-8")
        return exported

    return write


@pytest.mark.parametrize("before", ["", "C:\\Users\\Jo\\out\\", "\\\\server\\share\\out\\"])
def test_a_project_written_on_windows_is_imported_whole(rewrite, tmp_path, finished_run, before):
    project = ProjectFolder(tmp_path / "imported")
    notes = import_model(rewrite(lambda path: before + path.replace("/", "\\")), project)
    messages = ["16 of its paths lead out of its folder; missing files were searched for in the folder"]
    assert notes == (messages if before else [])
    assert np.array_equal(read_result(project).world, read_result(finished_run).world)
    again = json.loads(write_shapeworks(project, tmp_path / "again").read_text())
    for row in again["data"]:
        assert (tmp_path / "again" / row["shape_1"]).is_file()


def test_particles_on_another_machine_are_refused_by_name(rewrite, tmp_path):
    path = rewrite(lambda path: "C:\\gone\\" + path.rpartition("/")[2].replace("a_", "z_"))
    text = r"subject a has a file on another machine, C:\\gone\\z_\w+\.particles; copy it into the project's"
    with pytest.raises(InputError, match=text):
        import_model(path, ProjectFolder(tmp_path / "imported"))
    assert not (tmp_path / "imported").exists()


def test_paths_that_lead_nowhere_are_kept_as_they_are(rewrite, exported, content, tmp_path):
    for row in content["data"]:
        row["image_ct"] = "E:\\scans\\ct.nrrd"
    project = ProjectFolder(tmp_path / "imported")
    import_model(rewrite(str), project)
    again = json.loads(write_shapeworks(project, tmp_path / "again").read_text())
    assert {row["image_ct"] for row in again["data"]} == {"E:\\scans\\ct.nrrd"}
