"""What the README says can be done from Python."""

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

ROOT = Path(__file__).parents[2]
SHORT = "32, spacing=1.0, mesh_edge=2.0, anneal_iterations=20, settle_iterations=20"
ROOTS = os.pathsep.join(str(ROOT / item) for item in ("core", "app", "resources"))


README = (ROOT / "README.md").read_text("utf-8")
DEMO = Path(os.environ.get("HOMOLOG_DEMO", ROOT / "docs/images/demo.csv"))
"""Table of a demo: the one that .ci/bare has just run, or that of the README's picture."""


def figures(pattern):
    """Return the numbers that the README states in a phrase."""
    (found,) = re.findall(pattern, " ".join(README.split()))
    return [float(number) for number in found]


def test_the_errors_of_the_demo_are_those_of_the_readme():
    with DEMO.open(newline="") as stream:
        (row,) = [row for row in csv.DictReader(stream) if row["figure"] == "error_mean"]
    *stated, range_mm = figures(
        r"([\d.]+) mm on average with Euclidean .*? ([\d.]+) mm with the default .*? at most ([\d.]+) mm"
    )
    assert [float(row["original"]), float(row["proposed"])] == pytest.approx(stated, abs=range_mm)


def test_what_differs_in_the_hearts_is_that_of_the_readme():
    with (ROOT / "docs/images/hearts.csv").open(newline="") as stream:
        cpu, cuda = csv.DictReader(stream)
    *shares, p = figures(
        r"([\d.]+) % of the surface differs \(([\d.]+) % with a run on a GPU.*?\(p = ([\d.]+)\)"
    )
    assert [float(row["surface"]) for row in (cpu, cuda)] == pytest.approx(shares, abs=0.5)
    assert [float(row["p"]) for row in (cpu, cuda)] == pytest.approx([p, p], abs=0.0051)


def test_the_readme_example_prints_shares_and_a_p_value_and_makes_a_project(ellipsoids, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.apply_scale([8.5, 7.0, 5.0]).export(tmp_path / "e.stl")
    files = [*(ellipsoids / f"{name}.nrrd" for name in "abcd"), tmp_path / "e.stl"]
    rows = [f"{path.stem},{path},{group}" for path, group in zip(files, "xyxyx", strict=True)]
    (tmp_path / "cohort.csv").write_text("\n".join(["name,path,group", *rows]))
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    (tmp_path / "example.py").write_text(example.replace("256", SHORT), "utf-8")
    done = subprocess.run(
        [sys.executable, "example.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": ROOTS},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"\[0\.\d+ +0\.\d+ +0\.\d+ *\]\ny - x [01]\.\d+ [01]\.\d+", done.stdout.strip())
    assert {"mode_1.ply", "PROJECT"} <= {path.name for path in tmp_path.iterdir()}
