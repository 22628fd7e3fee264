import json
import os
import shlex
import shutil
import signal
import subprocess
import sys

import nibabel
import numpy as np
import pytest

from homolog.errors import Cancelled
from homolog.io.markups import write_markups
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.run import Run
from homolog_app.cli import main

LONG = ["--anneal-iterations", "600", "--settle-iterations", "5"]
QUIET = ["--progress", "none", "--no-figures"]
SHORT = ["--particles", "48", "--alignment", "center", "--mesh-edge", "2", "--split-iterations", "5"]
SHORT += ["--anneal-iterations", "20", "--settle-iterations", "20"]  # those of the finished run


@pytest.fixture
def scans(ellipsoids, tmp_path):
    """Return a copy of the ellipsoids."""
    return shutil.copytree(ellipsoids, tmp_path / "scans")


@pytest.fixture
def project(finished_run, scans, tmp_path):
    """Return a copy of the finished project, whose settings are those of a short run, beside the scans."""
    return ProjectFolder(shutil.copytree(finished_run.folder, tmp_path / "project"))


@pytest.fixture
def begin(project):
    """Return a function that starts a long run as a process of its own and waits until it optimizes."""
    started = []

    def make():
        arguments = ["run", str(project.folder), *LONG, "--progress", "json"]
        process = subprocess.Popen(
            [sys.executable, "-m", "homolog_app", *arguments],
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


def test_a_project_runs_again_with_other_settings_and_gets_pictures(project, capsys):
    arguments = [
        "run",
        str(project.folder),
        "--particles",
        "24",
        "--method",
        "euclidean",
        "--progress",
        "json",
    ]
    assert main(arguments) == 0
    *records, last = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"phase", "fraction", "message", "eta_s"} == set(records[0])
    assert [item["fraction"] for item in records if item["phase"]][-1] == 1.0
    assert last == {"reason": "completed", "project": str(project.folder)}
    record = project.read()
    assert (record.result.particles, record.result.metric) == (24, "euclidean")
    assert record.settings.optimize.anneal_iterations == 20
    assert {path.name for path in project.figures.iterdir()} == {"mean.png", "modes.png", "subjects_01.png"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_stop_at_once_and_say_how_to_go_on(begin, project, number):
    process = begin()
    process.send_signal(number)
    shown, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(shown.splitlines()[-1])["reason"] == "cancelled"
    assert f"to continue: homolog run {project.folder} --resume" in said
    assert "Traceback" not in said
    assert project.checkpoint.is_file()
    assert project.read().unfinished
    assert project.read().result.ended != "cancelled"


def test_the_particles_of_a_first_run_are_kept_when_it_is_cancelled(begin, project):
    project.write(project.read().model_copy(update={"result": None}))
    process = begin()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert "saved as a result" in said
    assert project.read().result.ended == "cancelled"


def test_a_killed_run_is_resumed_once_and_to_its_end(begin, project, capsys):
    process = begin()
    process.kill()
    process.wait()
    assert project.checkpoint.is_file()
    assert main(["info", str(project.folder)]) == 0
    assert f"to continue: homolog run {project.folder} --resume" in capsys.readouterr().out
    assert main(["run", str(project.folder), "--resume", *QUIET]) == 0
    assert project.read().result.settings.optimize.anneal_iterations == 600
    assert not project.read().unfinished
    assert main(["run", str(project.folder), "--resume", *QUIET]) == 2
    assert "nothing to resume" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["{scans}"], "--out PROJECT"),
        (["{scans}", "--out", "{scans}"], "contains other files"),
        (["{scans}", "--resume", "--out", "{new}"], "nothing to resume"),
        (["{new}", "--out", "{new}"], "does not exist"),
        (["{scans}", "--out", "{new}", "--particles", "3"], "--particles 3: must be at least 4"),
        (["{scans}", "--out", "{new}", "--device", "cuda:77"], "is not on this machine"),
        (["{scans}", "--out", "{scans}/a.nrrd/project", "--device", "cpu"], "can't be written"),
    ],
)
def test_wrong_uses_end_with_two_and_a_line_and_write_nothing(ellipsoids, tmp_path, capsys, options, message):
    places = {"scans": ellipsoids, "new": tmp_path / "new"}
    assert main(["run", *(word.format(**places) for word in options)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def mixed(scans):
    """Return the scans beside files that are bad or peculiar, each called by what is wrong with it."""
    import SimpleITK

    good = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(scans / "a.nrrd"))
    with_nan = good.astype(np.float32)
    with_nan[0, 0, 0] = np.nan
    pieces = good.copy()
    pieces[:2, :2, :2] = 1
    for name, array in {
        "empty": np.zeros_like(good),
        "flat": good[0],
        "series": np.stack([good, good]),
        "nan": with_nan,
        "border": np.ascontiguousarray(good[:, :, 4:]),
        "pieces": pieces,
    }.items():
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(array, isVector=False), scans / f"{name}.nrrd")
    (scans / "cut.nrrd").write_bytes((scans / "a.nrrd").read_bytes()[:-300])
    (scans / "text.nii").write_text("no image")
    return scans


BAD = ["cut", "empty", "flat", "series", "text"]


def test_each_bad_file_gets_a_line_with_its_name_and_nothing_is_written(mixed, tmp_path, capsys):
    names = [path.name for path in sorted(mixed.iterdir())]
    rows = [f"{name.split('.')[0]},scans/{name}" for name in [*names, "gone.nrrd"]]
    (tmp_path / "cohort.csv").write_text("\n".join(["name,path", *rows]))
    assert main(["run", str(tmp_path / "cohort.csv"), "--out", str(tmp_path / "new"), *QUIET]) == 2
    *lines, last = capsys.readouterr().err.splitlines()
    assert len(lines) == len(BAD) + 1
    assert "6 of 13" in last
    assert "--skip-invalid" in last
    for name, line in zip([*BAD, "gone"], lines, strict=True):
        assert f"{name}." in line
    assert not (tmp_path / "new").exists()


def test_many_files_bad_alike_share_a_line_and_can_be_left_out(tmp_path, capsys):
    for number in range(9):
        mask = np.zeros((64, 64, 64), np.uint8)
        mask[8:-8, 8:-8, 8:-8] = number % 2
        path = tmp_path / "two words" / f"p{number}" / "segmentations" / "heart.nii.gz"
        path.parent.mkdir(parents=True)
        nibabel.save(nibabel.Nifti1Image(mask, np.eye(4)), path)
    arguments = [str(tmp_path / "two words"), "--label", "heart", "--out", str(tmp_path / "new"), *QUIET]
    assert main(["run", *arguments]) == 2
    *lines, last = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "5 of 9" in last
    assert "--skip-invalid" in last


def test_suggested_commands_can_be_pasted_where_names_have_spaces(tmp_path, capsys):
    for number in range(3):
        for name in ("liver", "left kidney"):
            path = tmp_path / "two words" / f"p{number}" / "segmentations" / f"{name}.nii.gz"
            path.parent.mkdir(parents=True, exist_ok=True)
            nibabel.save(nibabel.Nifti1Image(np.ones((9, 9, 9), np.uint8), np.eye(4)), path)
    folder = tmp_path / "two words"
    assert main(["run", str(folder), "--out", str(tmp_path / "new"), *QUIET]) == 2
    suggested = capsys.readouterr().err.partition("homolog run ")[2].partition(" …")[0]
    assert shlex.split(suggested) == [str(folder), "--label", "left kidney"]


def test_bad_files_can_be_left_out_and_what_grooming_changed_is_told(mixed, project, capsys):
    grooming = ["--alignment", "center", "--mesh-edge", "2", "--device", "cpu"]
    arguments = [
        "--particles",
        "16",
        "--split-iterations",
        "5",
        "--anneal-iterations",
        "5",
        *grooming,
        *QUIET,
    ]
    assert main(["run", str(mixed), "--out", str(project.folder), *arguments, "--skip-invalid"]) == 0
    lines = capsys.readouterr().err.splitlines()
    left_out = [line for line in lines if "skipped" in line]
    assert [f"{name}." in line for name, line in zip(BAD, left_out, strict=True)] == [True] * len(BAD)
    assert read_result(project).names == ("a", "b", "border", "c", "d", "nan", "pieces")
    note = next(line for line in lines if line.startswith("homolog: note: pieces: "))
    assert "largest of 2 separate pieces" in note
    main(["info", str(project.folder)])
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note")]
    assert any("border:" in note for note in notes)
    assert any("pieces:" in note for note in notes)
    assert not any(f" {name}:" in note for note in notes for name in "abcd")


def test_more_particles_are_added_to_the_result_and_said_to_be(project, capsys):
    before = read_result(project)
    assert main(["run", str(project.folder), "--particles", "80", *QUIET]) == 0
    assert "adding 32 particles to the 48" in capsys.readouterr().err
    assert read_result(project).world.shape == (4, 80, 3)
    assert main(["run", str(project.folder), "--particles", "90", "--restart", *QUIET]) == 0
    said = capsys.readouterr().err
    assert "adding" not in said
    assert "4 subjects x 80 particles" in said
    assert read_result(project).world.shape == (4, 90, 3)
    assert read_result(project).names == before.names


def test_new_subjects_are_fitted_to_the_result(project, scans, tmp_path, capsys):
    before = read_result(project)
    shutil.move(scans / "b.nrrd", tmp_path / "e.nrrd")
    shutil.copy(tmp_path / "e.nrrd", scans / "b.nrrd")
    assert main(["run", str(project.folder), "--fit", str(tmp_path / "e.nrrd"), *QUIET]) == 0
    after = read_result(project)
    assert after.names == (*before.names, "e")
    np.testing.assert_array_equal(after.local[:4], before.local)
    assert "5 subjects x 48 particles" in capsys.readouterr().out
    moved = np.linalg.norm(after.local[4] - before.local[1], axis=1)
    assert np.median(moved) < 1.0  # the same segmentation: particles are 4 mm apart


def test_before_all_is_computed_anew_the_fit_of_new_files_alone_is_offered(
    project, scans, capsys, monkeypatch
):
    class Stopped(Run):
        def execute(self, *_):
            raise Cancelled

    monkeypatch.setattr("homolog.run.Run", Stopped)
    new = shutil.copy(scans / "b.nrrd", scans / "e.nrrd")
    again = ["run", str(scans), "--out", str(project.folder), *SHORT, *QUIET]
    assert main(again) == 130
    offer = f"to keep it and only add the 1 new: homolog run {project.folder} --fit {new}\n"
    assert offer in capsys.readouterr().err
    for other in (["--smoothing", "0.2"], ["--restart"]):
        main([*again, *other])
        said = capsys.readouterr().err
        assert "will replace the result" in said
        assert "--fit" not in said


def test_a_fit_needs_no_landmarks_as_its_particles_are_those_of_the_result(project, scans, tmp_path):
    new = shutil.copy(scans / "b.nrrd", tmp_path / "e.nrrd")
    write_markups(tmp_path / "e.mrk.json", np.zeros((1, 3)))
    assert main(["run", str(project.folder), "--landmarks", "--fit", str(new), *QUIET]) == 0
    assert project.read().subjects[-1].landmarks == "../e.mrk.json"


def test_a_fit_that_was_refused_can_be_asked_for_again(project, scans, tmp_path, capsys):
    new, good = shutil.copy(scans / "b.nrrd", tmp_path / "e.nrrd"), (scans / "a.nrrd").read_bytes()
    fit = ["run", str(project.folder), "--fit", str(new), *QUIET]
    shutil.copy(scans / "b.nrrd", scans / "a.nrrd")
    assert main(fit) == 2
    assert "a: the surface is not" in capsys.readouterr().err
    (scans / "a.nrrd").write_bytes(good)
    assert main(fit) == 0
    assert read_result(project).names[-1] == "e"


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (["--fit", "nothing.nrrd"], "is not a segmentation or mesh"),
        (["--fit", "scans/a.nrrd"], "already has 48 particles"),
        (["--fit", "other/a.nrrd"], "several subjects are named a"),
        (["--fit", "scans/a.nrrd", "--resume"], "--out or --resume"),
    ],
)
def test_files_that_cannot_be_fitted_are_named(project, message, said, capsys, monkeypatch):
    monkeypatch.chdir(project.folder.parent)
    shutil.copytree("scans", "other")
    if "--resume" in message:
        project.write(project.read().model_copy(update={"unfinished": True}))
    assert main(["run", str(project.folder), *message, *QUIET]) == 2
    assert said in capsys.readouterr().err
