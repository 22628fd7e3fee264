import os
import subprocess
import sys
from collections import Counter

from homolog.io.markups import write_markups
from homolog.io.meshes import write_mesh
from homolog.surfaces.mesh import TriangleMesh

RUN = """
import os, sys
from pathlib import Path
from homolog.cohort import read_cohort
from homolog.grooming import check_cohort
from homolog.io.project import ProjectFolder
from homolog.run import Run
from homolog.settings import RunSettings

folder, settings, log, what = Path(sys.argv[1]), RunSettings.model_validate_json(sys.argv[2]), *sys.argv[3:]

def hear(event, arguments):
    if event == "open" and str(arguments[0]).startswith(str(folder / "scans")):
        line = f"{os.getpid()} {arguments[0]}\\n".encode()
        os.write(out, line)

out = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
if __name__ != "__main__":  # in a worker, which imports this file
    sys.addaudithook(hear)
else:
    cohort = read_cohort(folder / "scans")  # looks at the beginning of each file
    sys.addaudithook(hear)
    if what == "check":
        check_cohort(cohort, settings.groom)
    else:
        Run(ProjectFolder(folder / "project"), cohort, settings).execute()
    print(os.getpid())
"""


def test_a_run_opens_each_input_as_often_as_a_check_does_and_only_in_workers(egg, short_settings, tmp_path):
    (tmp_path / "scans").mkdir()
    for number in range(3):
        mesh = TriangleMesh(egg.vertices * [1.0, 1.0 + 0.1 * number, 1.0], egg.faces)
        write_mesh(tmp_path / "scans" / f"s{number}.ply", mesh)
        write_markups(tmp_path / "scans" / f"s{number}.mrk.json", mesh.vertices[:4], "abcd")
    (tmp_path / "program.py").write_text(RUN)
    with_landmarks = {"optimize": short_settings.optimize.model_copy(update={"landmarks": True})}
    settings = short_settings.model_copy(update=with_landmarks).model_dump_json()
    opened = {}
    for what in ("check", "run"):
        log = tmp_path / what
        command = [sys.executable, "program.py", str(tmp_path), settings, str(log), what]
        ended = subprocess.run(
            command,
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.returncode == 0, ended.stderr
        lines = [line.split(" ", 1) for line in log.read_text().splitlines()]
        assert ended.stdout.strip() not in {process for process, _ in lines}
        opened[what] = Counter(path for _, path in lines)
    assert len(opened["check"]) == 6
    assert opened["run"] == opened["check"]
