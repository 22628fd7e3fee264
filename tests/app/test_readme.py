"""What the README says can be done from Python."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOTS = os.pathsep.join(str(ROOT / one) for one in ("core", "app", "resources"))


def test_the_readme_example_makes_a_project_and_prints_three_shares_and_a_shape(ellipsoids, tmp_path):
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    example = example.replace("SEGMENTATIONS", ellipsoids.as_posix()).replace("256", "32")
    (tmp_path / "example.py").write_text(example, "utf-8")
    done = subprocess.run(
        [sys.executable, "example.py"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": ROOTS},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"\[0\.\d+ +0\.\d+ +0\.\d+ *\] \(32, 3\)", done.stdout.strip())
    assert (tmp_path / "PROJECT" / "project.json").is_file()
