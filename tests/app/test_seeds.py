"""Answers of several correspondences of one cohort, and between what they lie."""

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import SimpleITK

from homolog.cohort import Cohort, Subject
from homolog.comparison.seeds import SeedAnswer, read_spread, spread_text, write_spread
from homolog.io.project import ProjectFolder
from homolog.run import Run
from homolog.statistics.effects import Effect
from homolog_app.cli import main

QUICK = ["--permutations", "99", "--alignment", "form", "--progress", "none"]


@pytest.fixture
def project(short_settings, tmp_path):
    """A project of six ellipsoids in two groups."""
    grid = np.stack(np.meshgrid(*[np.arange(-11.0, 12.0)] * 3, indexing="ij"))
    subjects = []
    for index, axes in enumerate(((9, 7, 6), (10, 7, 5), (8, 7.5, 6), (9.5, 6, 6.5), (9, 6, 6), (10, 8, 6))):
        inside = (np.square(grid) / np.square(axes)[:, None, None, None]).sum(axis=0) <= 1.0
        path = tmp_path / f"e{index}.nrrd"
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(inside.astype(np.uint8).T), path)
        subjects.append(Subject(path.stem, path, "ab"[index % 2]))
    project = ProjectFolder(tmp_path / "project")
    Run(project, Cohort(tuple(subjects), tmp_path), short_settings).execute()
    return project


def read_rows(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.usefixtures("without_figures")
def test_other_seeds_are_run_once_and_their_answers_reported(project, capsys):
    question = ["analyze", str(project.folder), *QUICK, "--seeds", "2"]
    assert main(question) == 0
    assert "over 2 seeds" in capsys.readouterr().out
    rows = read_rows(project.folder / "analysis" / "groups_group_a_b" / "seeds.csv")
    own = project.read().result.settings.optimize.seed
    assert [int(row["seed_of_correspondence"]) for row in rows] == [own, own + 1]
    again = ProjectFolder(project.folder / "seeds" / f"seed_{own + 1}")
    assert again.read().result.settings.optimize.seed == own + 1
    before = again.read().result.finished
    assert main(question) == 0
    assert again.read().result.finished == before

    capsys.readouterr()
    later = ["analyze", str(project.folder), *QUICK, "--between", "b", "a"]
    assert main(later) == 0
    assert "over 2 seeds" in capsys.readouterr().out
    assert main(["analyze", str(project.folder), *QUICK, "--formula", "~ group"]) == 0
    assert "group: b - a: over 2 seeds" in capsys.readouterr().out
    assert main(["report", str(project.folder), "--progress", "none"]) == 0
    page = (project.folder / "report" / "report.html").read_text("utf-8")
    assert "over 2 seeds" in page[: page.index("Sample")]
    assert "--seeds 5" not in page
    assert "homolog check finds" in page
    assert "wall thickness" not in page  # of solid shapes
    volumes = [float(row["volume_ml"]) for row in read_rows(project.folder / "report" / "measures.csv")]
    assert volumes[0] == pytest.approx(4.0 / 3.0 * np.pi * 9 * 7 * 6 / 1000.0, rel=0.1)
    rows = read_rows(project.folder / "report" / "correspondence.csv")
    assert [row["name"] for row in rows] == [f"e{index}" for index in range(6)]
    for row in rows:
        assert float(row["off_surface_mm"]) < 0.3
        assert 0.0 < float(row["unevenness_percent"]) < 60.0
        assert float(row["surface_mean_mm"]) < float(row["surface_p95_mm"]) < 1.5
        assert 1.0 < float(row["farthest_mm"]) < 9.0

    seeds = project.folder / "analysis" / "groups_group_a_b" / "seeds.csv"
    assert float(read_rows(seeds)[0]["p_permutation_corrected"]) < 1.0
    assert main([*question[:-2], "--seeds", "1"]) == 0
    assert seeds.is_file()


ANSWER = SeedAnswer(
    "b - a",
    0,
    0.011,
    Effect(1.3, 0.4, 2.2, level=0.9),
    6,
    4.7,
    Effect(0.8, 0.6, 0.9, 0.02),
    Effect(0.9, 0.7, 1.0, 0.01),
    Effect(0.5, -0.1, 1.1, 0.1),
    999,
    "abc",
)


def answer_of(p):
    """Return a stand-in for an answer with this p."""
    return SimpleNamespace(comparisons=[SimpleNamespace(title=ANSWER.comparison, p_adjusted=p)])


def test_the_spread_is_between_the_smallest_and_the_largest(tmp_path):
    answers = [ANSWER, replace(ANSWER, seed=1, p=0.08, percent=3.1, distance=None)]
    write_spread(tmp_path, answers)
    assert read_spread(tmp_path, "abc", answer_of(ANSWER.p)) == answers
    assert read_spread(tmp_path, "another result", answer_of(ANSWER.p)) == []
    assert read_spread(tmp_path, "abc", answer_of(0.5)) == []  # of other settings or data
    (text,) = spread_text(answers)
    assert "p = 0.011 to 0.080 (1 of 2 significant)" in text
    assert "3.1 to 4.7 % of the surface" in text
    assert "balanced accuracy 80 %" in text  # of both seeds


def test_answers_that_version_0_2_wrote_are_read(tmp_path):
    write_spread(tmp_path, [ANSWER])
    table = tmp_path / "seeds.csv"
    (row,) = read_rows(table)
    kept = {
        name: cell
        for name, cell in row.items()
        if not name.endswith(("_90", "_95", "auc_p_permutation_corrected"))
    }
    names = [name.replace("p_fwe", "p_family") for name in kept]
    table.write_text(f"{','.join(names)}\n{','.join(kept.values())}\n", "utf-8")
    (answer,) = read_spread(tmp_path, "abc", answer_of(ANSWER.p))
    assert (answer.distance.value, answer.auc.value, answer.auc.p) == (1.3, 0.9, None)
    assert np.isnan(answer.distance.low)
