"""A project of thousands of subjects: write one, and measure how it is opened and analysed.

    python tests/benchmarks/large_project.py make PROJECT --subjects 5000 --particles 1024
    python tests/benchmarks/large_project.py measure PROJECT [--only opening check ...]

The subjects are beans (eight, optimized jointly once), each stretched along the three axes by random factors
of 3 %, surface and particles alike, so that particles stay on their surface and correspond. Every second one
belongs to the second group, whose members are 2 % longer. `measure` runs each step in a process of its own
and prints a table of processor seconds, wall seconds and peak memory: of the step and all processes that it
starts, memory of the largest of these. Linux only.
"""

import argparse
import ctypes
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans
from homolog.cohort import Cohort, Subject, read_cohort
from homolog.geometry import inverse_matrices, transform_points
from homolog.inspection import judge
from homolog.io.arrays import read_arrays
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, read_surface, surface_file
from homolog.run import Run
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.scenes.loaded_result import LoadedResult, write_from_memory

BEANS, VARIATION, LONGER = 8, 0.03, 1.02


class Stretched(Mapping[str, tuple[TriangleMesh, TriangleMesh]]):
    """The subjects' surfaces, made when they are asked for."""

    def __init__(self, names, meshes, maps):
        self._places, self._meshes, self._maps = (
            {name: place for place, name in enumerate(names)},
            meshes,
            maps,
        )

    def __getitem__(self, name):
        place = self._places[name]
        mesh = self._meshes[place % BEANS].placed(self._maps[place])
        return mesh, mesh

    def __iter__(self):
        return iter(self._places)

    def __len__(self):
        return len(self._places)


def make(folder, subjects, particles):
    """Write the project."""
    with tempfile.TemporaryDirectory() as place:
        scans = Path(place) / "beans"
        write_beans(scans, draw_beans(BEANS, 0), 0)
        base = ProjectFolder(Path(place) / "project")
        groom, optimize = GroomSettings(), OptimizeSettings(particles=particles, seed=0)
        Run(base, read_cohort(scans), RunSettings(groom=groom, optimize=optimize, device="cpu")).execute()
        result, record = read_result(base), base.read().result
        meshes = [read_surface(base, subject) for subject in record.subjects]
    generator = np.random.default_rng(0)
    factors = 1.0 + VARIATION * generator.normal(size=(subjects, 3))
    factors[1::2, 0] *= LONGER
    names = [f"s{number:05d}" for number in range(subjects)]
    origins = np.arange(subjects) % BEANS
    stretch = np.zeros((subjects, 4, 4))
    stretch[:, range(4), range(4)] = np.column_stack([factors, np.ones(subjects)])
    alignments = result.alignments[origins]
    maps = inverse_matrices(alignments) @ stretch @ alignments  # in local coordinates
    local = transform_points(maps, result.local[origins])
    world = transform_points(alignments, local)
    project = ProjectFolder(folder)
    cohort = Cohort(
        tuple(
            Subject(
                name, surface_file(project, name), "b" if place % 2 else "a", {"age": f"{40 + place % 41}"}
            )
            for place, name in enumerate(names)
        ),
        folder,
    )
    chosen = [
        record.subjects[origin].model_copy(
            update={"name": name, "file": name, "group": subject.group, "columns": dict(subject.columns)}
        )
        for origin, name, subject in zip(origins, names, cohort.subjects, strict=True)
    ]
    record = record.model_copy(update={"subjects": chosen})
    new = replace(
        result,
        names=tuple(names),
        groups=tuple(item.group for item in cohort.subjects),
        columns=tuple(item.columns for item in cohort.subjects),
        world=world,
        local=local,
        alignments=alignments,
        voxels=(),
    )
    loaded = LoadedResult(new, Stretched(names, meshes, maps), np.zeros((0, 4)), (), "", record, judge(world))
    os.fsync = lambda _: None  # only this copy could be lost
    with project.locked():
        project.groomed.mkdir(parents=True)
        write_from_memory(project, loaded, cohort)
        smoothing = project.model / "smoothing.npz"
        smoothed = np.count_nonzero(read_arrays(smoothing)["smoothing"]) if smoothing.is_file() else 0
        written = record.model_copy(update={"smoothed_particles": smoothed})
        project.write(project.read().model_copy(update={"result": written}))


OPENING = """
import sys
from pathlib import Path
from homolog.io.project import ProjectFolder
from homolog_app.scenes.loaded_result import load_result
loaded = load_result(ProjectFolder(Path(sys.argv[1])))
"""
PAGE = OPENING + "[loaded.surfaces[name] for name in loaded.result.names[:16]]"
MODEL = f"""{OPENING}
from homolog_app.scenes.model_shape import fit_model_shape
fit_model_shape('', loaded.method, loaded.result)
"""
STEPS = {
    "opening": [sys.executable, "-c", OPENING, "PROJECT"],
    "opening and 16 surfaces": [sys.executable, "-c", PAGE, "PROJECT"],
    "model": [sys.executable, "-c", MODEL, "PROJECT"],
    **{
        name: [sys.executable, "-m", "homolog_app", *command.split()]
        for name, command in {
            "info": "info PROJECT",
            "table": "export table PROJECT --out OUT",
            "analyze": "analyze PROJECT",
            "check": "check PROJECT",
            "meshes": "export meshes PROJECT --no-subjects --out OUT",
        }.items()
    },
}


def measure(project, only):
    """Print the table."""
    ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER: workers of a step are waited for here
    print("| step | processor (s) | wall (s) | peak memory (GB) |\n|---|---|---|---|")
    for name in only or STEPS:
        with tempfile.TemporaryDirectory() as place:
            known = {"PROJECT": str(project), "OUT": f"{place}/out"}
            command = [known.get(word, word) for word in STEPS[name]]
            began = time.perf_counter()
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            _, code, used = os.wait4(child.pid, 0)
            wall = time.perf_counter() - began
            every = [used, *remaining()]
        spent, peak = sum(item.ru_utime + item.ru_stime for item in every), max(i.ru_maxrss for i in every)
        note = f" (ended with {os.waitstatus_to_exitcode(code)})" if code else ""
        print(f"| {name}{note} | {spent:.1f} | {wall:.1f} | {peak / 1e6:.2f} |", flush=True)


def remaining():
    """Yield the use of processes that a step has left behind, once they have ended."""
    with suppress(ChildProcessError):
        while True:
            yield os.wait3(0)[2]


def main():
    """Run as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["make", "measure"])
    parser.add_argument("project", type=Path)
    parser.add_argument("--subjects", type=int, default=5000)
    parser.add_argument("--particles", type=int, default=256)
    parser.add_argument("--only", nargs="+", choices=list(STEPS))
    arguments = parser.parse_args()
    if arguments.what == "make":
        make(arguments.project, arguments.subjects, arguments.particles)
        print(f"{resource.getrusage(resource.RUSAGE_SELF).ru_utime:.0f} s of processor time")
    else:
        measure(arguments.project, arguments.only)


if __name__ == "__main__":
    main()
