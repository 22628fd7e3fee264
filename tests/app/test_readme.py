"""What the README says can be done from Python."""

import os
import re
import subprocess
import sys
from pathlib import Path

import trimesh

ROOT = Path(__file__).parents[2]
SHORT = "32, spacing=1.0, mesh_edge=2.0, anneal_iterations=20, settle_iterations=20"
ROOTS = os.pathsep.join(str(ROOT / item) for item in ("core", "app", "resources"))


def test_the_readme_example_prints_shares_and_a_p_value_and_makes_a_project(ellipsoids, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.apply_scale([8.5, 7.0, 5.0]).export(tmp_path / "e.stl")
    files = [*(ellipsoids / f"{name}.nrrd" for name in "abcd"), tmp_path / "e.stl"]
    rows = [f"{path.stem},{path},{group}" for path, group in zip(files, "xyxyx", strict=True)]
    (tmp_path / "cohort.csv").write_text("\n".join(["name,path,group", *rows]))
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
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
