"""Structures of a cohort by name: ``homolog labels``, ``homolog run --label NAME`` and ``homolog batch``."""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
import SimpleITK

from homolog.io.project import ProjectFolder
from homolog.settings import GroomSettings, RunSettings
from homolog_app.cli import main
from homolog_app.cli.options import with_all_options

QUICK = ["--particles", "16", "--method", "euclidean", "--mesh-edge", "3", "--settle-iterations", "10"]
QUICK += ["--split-iterations", "5", "--anneal-iterations", "10", "--alignment", "center", "--mirror", "off"]
QUIET = ["--progress", "none", "--no-figures", "--device", "cpu", "--workers", "1"]
OVAL, ROUND, RARE, BROKEN = 1, 2, 3, 4


def brain(axes, *, rare, clipped):
    """Return labels of an ellipsoid, a ball in two pieces, sometimes a third, and one of few voxels."""
    grid = np.indices((26, 22, 40))
    values = np.zeros((26, 22, 40), np.uint8)
    inside = (
        sum(((item - at) / half) ** 2 for item, at, half in zip(grid, (12, 10, 10), axes, strict=True)) <= 1
    )
    values[inside] = OVAL
    low = 36 if clipped else 30
    values[
        sum((item - at) ** 2 for item, at in zip(grid, (12, 10, low), strict=True)) <= axes[0] ** 2 / 2
    ] = ROUND
    values[1:3, 1:3, 36:39] = ROUND
    if rare:
        values[20:24, 17:21, 1:5] = RARE
    values[0, 0, 0] = BROKEN
    return values


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """Return a folder of four label maps with a table of their names; not to be written to."""
    folder = tmp_path_factory.mktemp("brains") / "scans"
    folder.mkdir()
    for name, axes in (("a", (9, 7, 6)), ("b", (10, 7, 5)), ("c", (8, 7.5, 6)), ("d", (9.5, 6, 6.5))):
        values = brain(axes, rare=name in "ab", clipped=name == "d")
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values.T), folder / f"{name}.nii.gz")
    names = {OVAL: "Left-Oval", ROUND: "Round_Body", RARE: "Rare", BROKEN: "Tiny"}
    (folder / "names.json").write_text(json.dumps({str(value): name for value, name in names.items()}))
    return folder


@pytest.fixture(scope="module")
def finished(scans, tmp_path_factory):
    """Return the exit code and the folder of a batch of all structures; not to be written to."""
    out = tmp_path_factory.mktemp("batch") / "out"
    arguments = ["batch", str(scans), "--labels", "all", "--out", str(out), *QUICK, *QUIET]
    return main(arguments), out


def test_labels_lists_names_numbers_subjects_volumes_and_the_border(scans, capsys):
    assert main(["labels", str(scans), "--progress", "none"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {line.split()[0]: line.split()[1:] for line in lines[1:]}
    assert set(rows) == {"Left-Oval", "Round_Body", "Rare", "Tiny"}
    assert rows["Rare"] == ["3", "2/4", "0.064", "0.064", "0.064", "-"]
    assert (rows["Round_Body"][:2], rows["Round_Body"][-1]) == (["2", "4/4"], "1")
    assert main(["labels", str(scans), "--progress", "none", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)["structures"]
    assert [item["at_border"] for item in result] == [[], ["d"], [], ["a", "b", "c", "d"]]


def test_run_takes_a_structure_by_name(scans, tmp_path):
    arguments = ["run", str(scans), "--label", "oval-left", "--out", str(tmp_path / "p"), *QUICK, *QUIET]
    assert main(arguments) == 0
    record = ProjectFolder(tmp_path / "p").read()
    assert (record.settings.groom.label, record.settings.groom.segment) == (None, "oval-left")
    assert len(record.result.subjects) == 4


@pytest.mark.parametrize(
    ("before", "given", "expected"),
    [
        ((None, None), {"label": "oval-left"}, (None, "oval-left")),
        ((None, None), {"label": "3"}, (3, None)),
        ((None, "oval"), {"label": "3"}, (3, None)),
        ((3, None), {"label": "3rd-Ventricle"}, (None, "3rd-Ventricle")),
        ((None, "oval"), {"label": "auto"}, (None, None)),
        ((None, None), {"label": "3", "segment": "oval"}, (3, "oval")),
        ((3, None), {"segment": "oval"}, (3, "oval")),
        ((3, "oval"), {}, (3, "oval")),
    ],
)
def test_what_is_given_as_label_replaces_the_structure_chosen_before(before, given, expected):
    settings = RunSettings(groom=GroomSettings(label=before[0], segment=before[1]))
    groom = with_all_options(settings, argparse.Namespace(**given)).groom
    assert (groom.label, groom.segment) == expected


def test_a_new_subject_with_a_mask_for_each_structure_is_fitted_by_its_folder(tmp_path, capsys):
    mask = (np.square(np.indices((22, 22, 22)) - 11).sum(axis=0) <= 60).astype(np.uint8)
    for number, name in enumerate(("a", "b", "c", "new")):
        place = tmp_path / ("later" if name == "new" else "scans") / name / "segmentations"
        place.mkdir(parents=True)
        wider = np.where(np.roll(mask, number, axis=0) + mask > 0, 1, 0).astype(np.uint8)
        for structure, values in (("liver", wider), ("spleen", mask)):
            SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), place / f"{structure}.nii.gz")
    project, new = tmp_path / "p", tmp_path / "later" / "new"
    arguments = ["run", str(tmp_path / "scans"), "--label", "LIVER", "--out", str(project)]
    assert main([*arguments, *QUICK, *QUIET]) == 0
    assert main(["run", str(project), "--fit", str(new), *QUIET]) == 0
    assert [subject.name for subject in ProjectFolder(project).read().result.subjects] == [
        "a",
        "b",
        "c",
        "new",
    ]


def test_run_refuses_an_unknown_name_with_near_ones(scans, tmp_path, capsys):
    assert main(["run", str(scans), "--label", "oval", "--out", str(tmp_path / "p"), *QUIET]) == 2
    assert "similar names: Left-Oval" in capsys.readouterr().err


def test_structures_in_one_folder_are_run_by_name_and_listed_without(tmp_path, capsys):
    image, ball = np.zeros((18, 18, 18), np.uint8), np.indices((18, 18, 18)) - 9
    image[(ball**2).sum(axis=0) < 40] = 1
    for name in ("p1_liver", "p1_spleen", "p2_liver", "p2_spleen", "p3_liver", "p3_spleen"):
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(image), tmp_path / f"{name}.nii.gz")
    run = ["run", str(tmp_path), "--out", str(tmp_path / "project"), *QUIET, *QUICK]
    assert main(run) == 2
    assert '--pattern "{subject}_{structure}.nii.gz"  3 subjects, 2 structures\n' in capsys.readouterr().err
    run += ["--pattern", "{subject}_{structure}.nii.gz"]
    assert main(run) == 2
    message = capsys.readouterr().err
    assert "liver (3), spleen (3)" in message
    assert f"homolog run {tmp_path} --pattern '{{subject}}_{{structure}}.nii.gz' --label liver" in message
    assert main([*run, "--label", "liver"]) == 0
    out = tmp_path / "project"
    assert [subject.name for subject in ProjectFolder(out).read().result.subjects] == ["p1", "p2", "p3"]


def test_a_batch_makes_a_project_for_each_structure_and_goes_on_past_those_that_fail(finished):
    code, out = finished
    assert code == 1  # one failed
    record = json.loads((out / "batch.json").read_text())["structures"]
    assert {name: item["state"] for name, item in record.items()} == {
        "Left-Oval": "finished",
        "Round_Body": "finished",
        "Rare": "too few subjects",
        "Tiny": "failed",
    }
    assert "2 subjects have it" in record["Rare"]["message"]
    assert record["Rare"]["absent"] == ["c", "d"]
    assert len(ProjectFolder(out / "Left-Oval").read().result.subjects) == 4
    assert not (out / "Rare").exists()


def test_the_index_lists_structures_and_what_is_to_be_said_of_subjects(finished):
    _, out = finished
    page = (out / "index.html").read_text(encoding="utf-8")
    for text in (
        'href="Left-Oval/"',
        "<td>absent</td>",
        "may be cut off",
        "2 pieces, the largest kept",
        "Tiny",
    ):
        assert text in page
    assert "converged</td>" in page
    table = (out / "volumes.csv").read_text().splitlines()
    assert table[0] == "name,Left-Oval [ml],Round_Body [ml],Rare [ml],Tiny [ml]"
    assert table[3].endswith(",,0.001")


def test_structures_whose_masks_are_all_empty_are_reported_and_not_fatal(tmp_path, capsys):
    values = brain((9, 7, 6), rare=False, clipped=False)
    for name in "ab":
        folder = tmp_path / "scans" / name / "segmentations"
        folder.mkdir(parents=True)
        for structure, mask in (("liver", values == OVAL), ("spleen", values * 0)):
            image = SimpleITK.GetImageFromArray(mask.T.astype(np.uint8))
            SimpleITK.WriteImage(image, folder / f"{structure}.nii.gz")
    arguments = [
        "batch",
        str(tmp_path / "scans"),
        "--out",
        str(tmp_path / "out"),
        "--min-subjects",
        "2",
        *QUICK,
    ]
    assert main([*arguments, *QUIET]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["spleen: empty: the masks of all subjects are empty", "liver: finished (2 subjects)"]
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "2 structures: 1 finished, 1 empty" in page
    assert "the masks of all subjects are empty" in page
    assert main(["labels", str(tmp_path / "scans"), "--progress", "none"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].split()[:3] == ["spleen", "-", "0/2"]
    assert main([*arguments, *QUIET, "--labels", "spleen"]) == 2
    assert "empty: spleen" in capsys.readouterr().err


def test_a_batch_that_is_run_again_keeps_what_is_finished(finished, scans, tmp_path, capsys):
    out = shutil.copytree(finished[1], tmp_path / "out")
    arguments = ["batch", str(scans), "--out", str(out), *QUICK, *QUIET]
    before = (out / "Left-Oval" / "project.json").stat().st_mtime_ns
    assert main([*arguments, "--labels", "left oval,round body"]) == 0
    assert "Left-Oval: finished before" in capsys.readouterr().out
    assert (out / "Left-Oval" / "project.json").stat().st_mtime_ns == before
    assert main([*arguments, "--labels", "left oval", "--seed", "3"]) == 0
    assert ProjectFolder(out / "Left-Oval").read().result.settings.optimize.seed == 3
    assert set(json.loads((out / "batch.json").read_text())["structures"]) >= {"Left-Oval", "Round_Body"}


def test_a_batch_that_is_cancelled_goes_on_where_it_was(scans, tmp_path):
    out = tmp_path / "out"
    arguments = ["batch", str(scans), "--labels", "left oval,round body", "--out", str(out), "--no-figures"]
    arguments += [*QUICK, "--device", "cpu", "--workers", "1"]
    process = subprocess.Popen(
        [sys.executable, "-m", "homolog_app", *arguments, "--progress", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    for line in process.stdout:
        if "Round_Body" in line and "message" in line:
            break
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, "same command" in said, "Traceback" in said) == (130, True, False)
    first = (out / "Left-Oval" / "project.json").stat().st_mtime_ns
    assert main([*arguments, "--progress", "none"]) == 0
    assert (out / "Left-Oval" / "project.json").stat().st_mtime_ns == first
    assert ProjectFolder(out / "Round_Body").read().result is not None


def test_a_folder_with_other_files_is_no_place_for_a_batch(scans, tmp_path, capsys):
    (tmp_path / "letter.txt").write_text("dear")
    assert main(["batch", str(scans), "--out", str(tmp_path), *QUIET]) == 2
    assert "contains other files" in capsys.readouterr().err


def test_an_unknown_name_ends_a_batch_before_it_begins(scans, tmp_path, capsys):
    assert main(["batch", str(scans), "--labels", "oval,rare", "--out", str(tmp_path / "o"), *QUIET]) == 2
    assert "'oval'; similar names: Left-Oval" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()
