import csv
import json
from functools import partial

import pytest

from homolog.settings import OptimizeSettings
from homolog_app.cli import main
from homolog_app.cli.demo import SHAPES, ComparisonRow, table_text


@pytest.fixture(scope="module", autouse=True)
def soon_ended():
    """Let runs end after few iterations."""
    with pytest.MonkeyPatch.context() as patch:
        short = partial(OptimizeSettings, split_iterations=5, anneal_iterations=20, settle_iterations=20)
        patch.setattr("homolog_app.cli.demo.OptimizeSettings", short)
        yield


@pytest.fixture(scope="module")
def small_demo(tmp_path_factory, soon_ended):
    """A demo with four beans and few particles; the subjects' pictures are left out."""
    out = tmp_path_factory.mktemp("demo") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SHAPES, "beans", 4)
        patch.setattr("homolog_app.pictures.figures.draw_figures", lambda project, tick: None)
        lines: list[str] = []
        patch.setattr("sys.stdout.write", lines.append)
        code = main(["demo", "--beans", "--out", str(out), "--particles", "8", "--progress", "json"])
    return code, out, "".join(lines)


def test_the_demo_leaves_both_projects_the_cohort_and_the_comparison(small_demo):
    code, out, _ = small_demo
    assert code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "cohort",
        "comparison.csv",
        "comparison.png",
        "original",
        "proposed",
    ]
    records = [json.loads((out / name / "project.json").read_text()) for name in ("original", "proposed")]
    assert [record["result"]["settings"]["optimize"]["method"] for record in records] == [
        "euclidean",
        "geodesic-normals",
    ]
    assert all(record["result"]["particles"] == 8 for record in records)


def test_the_demo_prints_the_comparison_with_seed_and_paper(small_demo):
    _, out, text = small_demo
    assert "Coffee beans: 4 shapes, seed 5" in text
    leak = next(line for line in text.splitlines() if "leakage" in line)
    assert leak.endswith("16 % / 4 %")
    assert str(out) in text


def test_the_table_on_the_screen_is_the_one_in_the_file(small_demo):
    _, out, text = small_demo
    with (out / "comparison.csv").open(newline="") as stream:
        rows = {row["figure"]: row for row in csv.DictReader(stream)}
    leak = next(line for line in text.splitlines() if "leakage" in line)
    assert f"{float(rows['leak']['proposed']):.2%}".replace("%", " %") in leak
    assert rows["leak"]["paper_original"] == "0.16"
    assert rows["ground_truth_r2"]["paper_original"] == ""
    assert 0.0 < float(rows["ground_truth_r2"]["proposed"]) <= 1.0


def test_progress_runs_once_from_start_to_end(small_demo):
    *_, text = small_demo
    events = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
    fractions = [event["fraction"] for event in events]
    assert fractions == sorted(fractions)
    assert fractions[0] < 0.05
    assert len(fractions) > 20
    assert any("original method" in event["message"] for event in events)
    assert any("proposed method" in event["message"] for event in events)


def test_vertebrae_are_compared_with_their_known_correspondence(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(SHAPES, "vertebrae", 4)
    out = tmp_path / "out"
    assert main(["demo", "--out", str(out), "--particles", "24"]) == 0
    with (out / "comparison.csv").open(newline="") as stream:
        rows = {row["figure"]: row for row in csv.DictReader(stream)}
    assert 0.0 < float(rows["error_mean"]["proposed"]) < float(rows["error_p95"]["proposed"])
    assert (out / "comparison.png").stat().st_size > 20_000
    assert "in the paper" not in capsys.readouterr().out


def test_a_folder_with_other_files_is_left_alone(tmp_path, capsys):
    (tmp_path / "thesis.txt").write_text("years of work")
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "contains other files" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_too_few_particles_are_refused_before_anything_is_written(tmp_path, capsys):
    assert main(["demo", "--out", str(tmp_path / "out"), "--particles", "2"]) == 2
    assert "--particles 2" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_columns_of_the_table_line_up():
    rows = [
        ComparisonRow("leakage", "leak", ".2%", {"original": 0.1234, "proposed": 0.04}, {"original": 0.16}),
        ComparisonRow("iterations", "iterations", ".0f", {"original": 1000.0, "proposed": 7.0}, {}),
    ]
    head, leak, iterations = table_text(rows).splitlines()
    assert leak.index("12.34 %") + len("12.34 %") == head.index("original") + len("original")
    assert len(iterations) == head.index("proposed") + len("proposed")
