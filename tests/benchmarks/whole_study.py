"""Processor seconds of each step of whole runs on groomed sample hearts, pictures and reading included.

    python tests/benchmarks/whole_study.py FOLDER --sizes 28x256 28x1024 [--device cpu]

Makes FOLDER/heartsN (`homolog sample`) and grooms it once. Each size is then a run in a process of its
own, with the kernels in Warp's cache. Prints a table of wall and processor seconds per step, each step's
share of the processor time and the largest memory in it, the objective reached, iterations, and how far the
estimate of the remaining time was off on the way. ``--no-pictures`` leaves out the pictures, for machines
without pyvista.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import psutil


class StepTimes:
    """Wall and processor seconds and memory between the steps that a run reports, and its estimates."""

    def __init__(self):
        self.seconds = defaultdict(lambda: [0.0, 0.0, 0.0])
        self.estimates = []
        self.step, self.processor, self.wall = "imports", 0.0, time.perf_counter() - time.process_time()

    def enter(self, step):
        processor, wall = _processor_seconds(), time.perf_counter()
        spent = self.seconds[self.step]
        spent[0] += processor - self.processor
        spent[1] += wall - self.wall
        self.step, self.processor, self.wall = step, processor, wall
        self._look()

    def _look(self):
        """Note the memory that is held now [GB]."""
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        spent = self.seconds[self.step]
        spent[2] = max(spent[2], pages * resource.getpagesize() / 1024**3)

    def observe(self, status):
        message = status.message
        self.estimates.append((time.perf_counter(), status.eta_s))
        self._look()
        if "kernels" in message:
            step = "kernels"
        elif "first particles" in message or "most typical" in message:
            step = "first particles"
        elif status.phase in ("splitting", "optimizing") and message.startswith(("mesh of", "geodesic")):
            step = "geodesics of many particles"
        elif ": " in message and status.phase in ("splitting", "optimizing"):
            step = message.split(",")[0]
        else:
            step = str(status.phase)
        if step != self.step:
            self.enter(step)

    def estimate_errors(self):
        """Return by how many percent the time left was over-estimated, from a third of the run on."""
        start, end = self.estimates[0][0], self.estimates[-1][0]
        errors = defaultdict(list)
        for when, estimate in self.estimates:
            done = (when - start) / (end - start)
            if estimate is not None and 1 / 3 <= done < 0.95:
                errors[f"{int(10 * done) / 10:.1f}"].append(100.0 * (estimate / (end - when) - 1.0))
        return {tenth: (min(parts), max(parts)) for tenth, parts in errors.items()}


def _processor_seconds():
    ended = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    running = [child.cpu_times() for child in psutil.Process().children(recursive=True)]  # one draws pictures
    return sum(item.ru_utime + item.ru_stime for item in ended) + sum(t.user + t.system for t in running)


def one_run(folder, particles, device, pictures):
    """Run a groomed project, draw its pictures if wanted and read it again; print the times as JSON."""
    times = StepTimes()
    from homolog.io.project import ProjectFolder
    from homolog.io.results import read_modes, read_result, read_surfaces
    from homolog.run import Run

    project = ProjectFolder(folder)
    record = project.read()
    settings = record.settings.model_copy(
        update={
            "optimize": record.settings.optimize.model_copy(update={"particles": particles}),
            "device": device,
        }
    )
    times.enter("reading")
    Run(project, project.cohort(), settings).execute(times.observe)
    if pictures:
        times.enter("pictures")
        from homolog_app.pictures.figures import draw_figures

        draw_figures(project)
    times.enter("opening")
    result = read_result(project)
    read_surfaces(project)
    read_modes(project, result.mean_surface)
    times.enter("end")
    record = project.read().result
    energies = result_energies(project)
    print(
        json.dumps(
            {
                "seconds": times.seconds,
                "estimates": times.estimate_errors(),
                "iterations": record.iterations,
                "objective": energies,
                "memory_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2,
            }
        )
    )


def result_energies(project):
    """Return the objective at the end of the run."""
    last = (project.folder / "energies.csv").read_text().splitlines()[-1]
    return sum(float(value) for value in last.split(",")[1:])


def groomed_project(folder, subjects):
    """Return a project of sample hearts that has been groomed, made if it is not there."""
    cohort, project = folder / f"hearts{subjects}", folder / f"groomed{subjects}"
    program = [sys.executable, "-m", "homolog_app"]
    if not cohort.exists():
        sample = ["sample", "hearts", "--subjects", str(subjects), "--progress", "none"]
        subprocess.run([*program, *sample, "--out", cohort], check=True, stdout=subprocess.DEVNULL)
    if not (project / "project.json").exists():
        quick = ["--particles", "32", "--anneal-iterations", "5", "--settle-iterations", "5"]
        subprocess.run(
            [*program, "run", cohort, "--out", project, *quick, "--no-figures", "--progress", "none"],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    return project


def reset(project):
    """Give a project the default settings, so that each size starts from them."""
    path = project / "project.json"
    content = json.loads(path.read_text())
    content["settings"]["optimize"] = {}
    path.write_text(json.dumps(content))


def report(size, result):
    seconds = result["seconds"]
    whole = [sum(item[k] for item in seconds.values()) for k in (0, 1)]
    print(
        f"\n{size}: {result['iterations']} iterations, objective {result['objective']:.5f}, "
        f"{result['memory_gb']:.2f} GB\n| step | processor s | % | wall s | GB |\n|---|---|---|---|---|"
    )
    for step, (processor, wall, memory) in seconds.items():
        print(f"| {step} | {processor:.2f} | {100 * processor / whole[0]:.1f} | {wall:.2f} | {memory:.2f} |")
    print(f"| whole | {whole[0]:.2f} | 100 | {whole[1]:.2f} | {result['memory_gb']:.2f} |\n")
    print("| run done | time left over-estimated by (%) |\n|---|---|")
    for done, (least, most) in result["estimates"].items():
        print(f"| {done} | {least:+.0f} to {most:+.0f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sizes", nargs="+", default=["28x256", "28x1024"])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--keep", action="store_true", help="keep the projects that were run")
    parser.add_argument("--no-pictures", dest="pictures", action="store_false")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        one_run(options.folder, options.one, options.device, options.pictures)
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    for size in options.sizes:
        subjects, particles = map(int, size.split("x"))
        project = options.folder / f"run{size}"
        shutil.rmtree(project, ignore_errors=True)
        shutil.copytree(groomed_project(options.folder, subjects), project)
        reset(project)
        command = [sys.executable, __file__, project, "--one", str(particles), "--device", options.device]
        command += [] if options.pictures else ["--no-pictures"]
        result = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        report(size, json.loads(result.stdout.splitlines()[-1]))
        if not options.keep:
            shutil.rmtree(project)


if __name__ == "__main__":
    main()
