"""A run with a core set of many subjects that are copies of a few, with simulated fits.

    python tests/benchmarks/simulated_study.py FOLDER --subjects 1000 5000 --particles 256 [--memory 2]

The subjects' files are links to those of twelve beans, which have been groomed and registered once. A fit
returns the particles of its bean with noise. Everything else is what a run does: it reads each file and
surface, aligns, chooses the core set and optimizes it, makes ensembles, compares poses, and writes fits,
model and result. Each size runs in a process of its own; prints processor seconds and peak memory of that
process by phase. Linux only.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import homolog.run.subject_fits as subject_fits
from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans
from homolog.cohort import Cohort, Subject, read_cohort
from homolog.correspondence.ensemble import ShapeState
from homolog.geometry import inverse_matrices, transform_points
from homolog.io.project import ProjectFolder
from homolog.run import Run
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings

BEANS, NOISE = 12, 0.01
GROOM = GroomSettings(mesh_edge=4.0)


def bean_of(name: str) -> int:
    return int(name[1:]) % BEANS


def simulated_fit(job: subject_fits._Job) -> ShapeState:
    """Return the particles of the subject's bean, or its own of the pass before, with noise."""
    ensemble = subject_fits._read_ensemble(job.ensemble, job.ensemble.stat().st_mtime)
    random = np.random.default_rng([int(job.name[1:]), job.local is not None])
    if job.local is not None:
        aligned, placement = transform_points(job.placement, job.local), job.placement
    else:
        template = [bean_of(name) for name in job.templates].index(bean_of(job.name))
        aligned, placement = ensemble.templates[template].astype(float), ensemble.placements[template]
    aligned = aligned + random.normal(scale=NOISE, size=aligned.shape)
    normals = ensemble.normals + random.normal(scale=NOISE, size=aligned.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ShapeState(
        local=transform_points(inverse_matrices(placement), aligned),
        aligned=aligned.astype(np.float32),
        normals=normals.astype(np.float32),
        openings=ensemble.openings.astype(np.float32),
        placement=placement,
    )


def prepare(folder: Path) -> ProjectFolder:
    """Groom the beans, and return the project that contains them."""
    scans, project = folder / "beans", ProjectFolder(folder / "groomed beans")
    if not project.exists:
        write_beans(scans, draw_beans(BEANS, 0), 0)
        optimize = OptimizeSettings(particles=8, split_iterations=5, anneal_iterations=5, settle_iterations=5)
        Run(project, read_cohort(scans), RunSettings(groom=GROOM, optimize=optimize, device="cpu")).execute()
    return project


def run(folder: Path, subjects: int, particles: int, memory: float | None) -> None:
    """Run a study of this size, and print a row for each phase."""
    beans = ProjectFolder(folder / "groomed beans")
    files = sorted((folder / "beans").glob("*.nrrd"))
    archives = sorted(beans.groomed.glob("*.npz"))
    project = ProjectFolder(folder / f"{subjects}")
    project.groomed.mkdir(parents=True)
    members = []
    for number in range(subjects):
        name = f"s{number:06d}"
        path = project.folder.parent / f"links {subjects}" / f"{name}.nrrd"
        path.parent.mkdir(exist_ok=True)
        os.link(files[bean_of(name)], path)
        os.link(archives[bean_of(name)], project.groomed / f"{name}.npz")
        members.append(Subject(name, path))
    subject_fits._fitted = simulated_fit
    optimize = OptimizeSettings(particles=particles, core_set=BEANS)
    settings = RunSettings(groom=GROOM, optimize=optimize, device="cpu", memory=memory)
    phase, began, wall = "", time.process_time(), time.monotonic()

    def observe(status) -> None:
        nonlocal phase, began, wall
        now = "" if status.reason else str(status.phase)
        if now != phase:
            if phase:
                lines = Path("/proc/self/status").read_text().splitlines()
                peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
                seconds = f"{time.process_time() - began:.1f} | {time.monotonic() - wall:.1f}"
                print(f"| {subjects} | {phase} | {seconds} | {peak / 1e6:.2f} |", flush=True)
            Path("/proc/self/clear_refs").write_text("5")  # begin a new peak
            phase, began, wall = now, time.process_time(), time.monotonic()

    Run(project, Cohort(tuple(members), folder), settings).execute(observe)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--subjects", type=int, nargs="+", default=[1000])
    parser.add_argument("--particles", type=int, default=256)
    parser.add_argument("--memory", type=float)
    parser.add_argument("--here", action="store_true", help="the one size in this process")
    options = parser.parse_args()
    if options.here:
        run(options.folder, options.subjects[0], options.particles, options.memory)
        return
    prepare(options.folder)
    print("| subjects | phase | processor s | wall s | peak GB |\n|---|---|---|---|---|", flush=True)
    more = [] if options.memory is None else ["--memory", str(options.memory)]
    for subjects in options.subjects:
        sized = ["--subjects", str(subjects), "--particles", str(options.particles), *more]
        subprocess.run([sys.executable, __file__, str(options.folder), "--here", *sized], check=True)


if __name__ == "__main__":
    main()
