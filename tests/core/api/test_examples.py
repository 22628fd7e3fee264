"""The examples of the documentation run, and print what they promise."""

import re
import runpy
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs" / "examples"


@pytest.fixture
def example(tmp_path, monkeypatch, capsys):
    """Return a function that runs an example in an empty folder and returns what it prints."""
    monkeypatch.chdir(tmp_path)

    def run(name, *arguments):
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_meshes_in_memory_become_a_model_a_surface_and_a_project(example, tmp_path):
    printed = example("meshes_to_model.py")
    shares = re.search(r"each mode: \[([\d.]+)", printed)
    lengths = sorted(map(float, re.findall(r"SD: ([\d.]+) mm long", printed)))
    assert float(shares[1]) > 0.9
    assert lengths == pytest.approx([13.8, 19.0, 24.2], abs=0.7)  # 16 to 22 mm, with an SD of 2.6 mm
    assert {"mode_1_plus_2sd.ply", "model.npz", "PROJECT"} == {path.name for path in tmp_path.iterdir()}


def test_the_groups_differ_at_the_bump_alone(example):
    printed = example("two_groups.py")
    assert "patient - control: form p = 0.001, shape p = 0.001" in printed
    assert re.search(r"particles that differ: \[0 1 2 3 4\]", printed)
    assert "balanced accuracy" in printed


def test_geodesic_distances_on_a_sphere_are_arcs(example):
    printed = example("geodesics.py")
    assert "2562 vertices" in printed
    assert float(re.search(r"sphere: ([\d.]+)%", printed)[1]) < 0.1


def test_a_project_is_opened(example, finished_run):
    printed = example("open_project.py", finished_run.folder)
    assert "4 subjects, 48 particles, geodesic-normals" in printed
    assert re.search(r"a: group None, 1\.\d\d ml", printed)


def test_a_control_is_compared_with_all_controls(
    example, finished_run, ellipsoids, small_references, tmp_path
):
    with small_references():
        printed = example("one_patient.py", finished_run.folder, ellipsoids / "a.nrrd")
    values = re.search(r"largest \|z\| ([\d.]+), limit ([\d.]+)", printed)
    assert float(values[1]) < float(values[2])
    assert (tmp_path / "reference.npz").is_file()


def test_type_checkers_look_at_every_example():
    with (ROOT / "pyproject.toml").open("rb") as stream:
        checked = tomllib.load(stream)["tool"]["mypy"]["modules"]
    assert sorted(checked) == sorted(path.stem for path in EXAMPLES.glob("*.py"))


def test_every_example_is_run():
    tested = set(re.findall(r'example\("(\w+\.py)"', Path(__file__).read_text("utf-8")))
    assert tested == {path.name for path in EXAMPLES.glob("*.py")}
