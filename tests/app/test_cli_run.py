import json
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from homolog.files.project import Project
from homolog.files.results import read_result
from homolog_app.cli import main

QUICK = ["--device", "cpu", "--workers", "1", "--alignment", "center", "--particles", "32"]
SHORT = [*QUICK, "--split-iterations", "5", "--anneal-iterations", "20", "--settle-iterations", "20"]
LONG = [*QUICK, "--split-iterations", "5", "--anneal-iterations", "800", "--settle-iterations", "5"]


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path / "project")


@pytest.fixture
def begin(ellipsoids, project):
    """Return a function that starts a long run as a process of its own and waits until it optimizes."""
    started = []

    def make():
        words = ["run", str(ellipsoids), "--out", str(project.folder), *LONG, "--progress", "json"]
        process = subprocess.Popen(
            [sys.executable, "-m", "homolog_app", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )
        started.append(process)
        for line in process.stdout:
            if json.loads(line)["phase"] == "optimizing":
                return process
        pytest.fail(process.stderr.read())

    yield make
    for process in started:
        process.kill()
        process.communicate()


def test_a_folder_becomes_a_project_with_pictures(ellipsoids, project, capsys):
    assert main(["run", str(ellipsoids), "--out", str(project.folder), *SHORT, "--progress", "json"]) == 0
    *records, last = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"phase", "fraction", "message", "eta_s"} == set(records[0])
    assert [one["fraction"] for one in records if one["phase"]][-1] == 1.0
    assert last == {"reason": "completed", "project": str(project.folder)}
    assert {one.name for one in project.figures.iterdir()} >= {"mean.png", "modes.png", "subjects_01.png"}
    assert read_result(project).world.shape == (4, 32, 3)


def test_a_project_runs_again_with_other_settings(ellipsoids, project):
    quiet = ["--progress", "none", "--no-figures"]
    assert main(["run", str(ellipsoids), "--out", str(project.folder), *SHORT, *quiet]) == 0
    assert main(["run", str(project.folder), "--particles", "24", "--method", "euclidean", *quiet]) == 0
    record = project.read()
    assert (record.result.particles, record.result.metric) == (24, "euclidean")
    assert record.settings.optimize.anneal_iterations == 20


def test_ctrl_c_stops_at_once_and_says_how_to_go_on(begin, project):
    process = begin()
    process.send_signal(signal.SIGINT)
    shown, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(shown.splitlines()[-1])["reason"] == "cancelled"
    assert f"cancelled; to go on: homolog run {project.folder} --resume" in said
    assert "Traceback" not in said
    assert project.checkpoint.is_file()
    assert project.read().result.ended == "cancelled"


def test_a_killed_run_goes_on_and_ends_as_if_it_had_not_been_killed(
    begin, ellipsoids, project, tmp_path, capsys
):
    quiet = ["--progress", "none", "--no-figures"]
    process = begin()
    process.kill()
    process.wait()
    assert project.checkpoint.is_file()
    assert main(["info", str(project.folder)]) == 0
    assert f"to go on: homolog run {project.folder} --resume" in capsys.readouterr().out
    assert main(["run", str(project.folder), "--resume", *quiet]) == 0
    whole = Project(tmp_path / "whole")
    assert main(["run", str(ellipsoids), "--out", str(whole.folder), *LONG, *quiet]) == 0
    assert np.array_equal(read_result(project).world, read_result(whole).world)
    assert main(["run", str(project.folder), "--resume", *quiet]) == 2
    assert "there is nothing to resume" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{scans}"], "say where the results go"),
        (["{scans}", "--out", "{scans}"], "holds other files"),
        (["{scans}", "--resume", "--out", "{new}"], "is no project, so there is nothing to resume"),
        (["{new}", "--out", "{new}"], "there is no such folder"),
        (["{scans}", "--out", "{new}", "--particles", "3"], "--particles 3: Input should be greater"),
        (["{scans}", "--out", "{new}", "--device", "cuda:77"], "is not on this machine"),
        (["{scans}", "--out", "{scans}/a.nrrd/project", "--device", "cpu"], "can't be written"),
    ],
)
def test_wrong_uses_end_with_two_and_a_line_and_write_nothing(ellipsoids, tmp_path, capsys, words, message):
    places = {"scans": ellipsoids, "new": tmp_path / "new"}
    assert main(["run", *(word.format(**places) for word in words)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def scans(ellipsoids, tmp_path):
    """Return a copy of the ellipsoids beside bad files, each called by what is wrong with it."""
    import SimpleITK

    folder = tmp_path / "scans"
    shutil.copytree(ellipsoids, folder)
    good = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(folder / "a.nrrd"))
    with_nan = good.astype(np.float32)
    with_nan[0, 0, 0] = np.nan
    for name, array in {
        "empty": np.zeros_like(good),
        "flat": good[0],
        "series": np.stack([good, good]),
        "nan": with_nan,
    }.items():
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(array, isVector=False), folder / f"{name}.nrrd")
    (folder / "cut.nrrd").write_bytes((folder / "a.nrrd").read_bytes()[:-300])
    (folder / "text.nii").write_text("no image")
    (folder / "open.obj").write_text("v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 2 3\nf 1 3 4\nf 1 4 2\n")
    return folder


def test_each_bad_file_gets_a_line_with_its_name_and_nothing_is_written(scans, tmp_path, capsys):
    names = [one.name for one in sorted(scans.iterdir())]
    rows = [f"{name.split('.')[0]},scans/{name}" for name in [*names, "gone.nrrd"]]
    (tmp_path / "cohort.csv").write_text("\n".join(["name,path", *rows]))
    words = [
        "run",
        str(tmp_path / "cohort.csv"),
        "--out",
        str(tmp_path / "new"),
        *SHORT,
        "--progress",
        "none",
    ]
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    bad = ["cut", "empty", "flat", "nan", "open", "series", "text", "gone"]
    assert len(lines) == len(bad)
    for name, line in zip(bad, lines, strict=True):
        assert f"{name}." in line
    assert not (tmp_path / "new").exists()


def test_bad_files_can_be_left_out_and_are_named(scans, tmp_path, capsys):
    words = ["run", str(scans), "--out", str(tmp_path / "new"), *SHORT, "--progress", "none", "--no-figures"]
    assert main([*words, "--skip-bad"]) == 0
    assert capsys.readouterr().err.count("homolog: left out: ") == 7
    assert read_result(Project(tmp_path / "new")).names == ("a", "b", "c", "d")


def test_what_grooming_changed_is_told(ellipsoids, tmp_path, capsys):
    import SimpleITK

    scans = tmp_path / "scans"
    shutil.copytree(ellipsoids, scans)
    array = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(scans / "a.nrrd"))
    pieces = array.copy()
    pieces[:2, :2, :2] = 1
    for name, values in (("border", array[:, :, 4:]), ("pieces", pieces)):
        SimpleITK.WriteImage(
            SimpleITK.GetImageFromArray(np.ascontiguousarray(values)), scans / f"{name}.nrrd"
        )
    words = ["run", str(scans), "--out", str(tmp_path / "new"), *SHORT, "--progress", "none", "--no-figures"]
    assert main(words) == 0
    main(["info", str(tmp_path / "new")])
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note")]
    assert any("border:" in note for note in notes)
    assert any("pieces:" in note for note in notes)
    assert not any(f" {name}:" in note for note in notes for name in "abcd")
