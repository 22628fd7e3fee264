"""A core set and fits against the joint optimization of the same cohort.

    python tests/benchmarks/core_set.py FOLDER --beans 100 --core-set 24
    python tests/benchmarks/core_set.py FOLDER --cohort $HOMOLOG_DATA/lv_acdc_dev --core-set 14

Prints a table in Markdown: the largest angles between the subspaces of the first mode, the first two, and the
modes above chance to those of the joint optimization, and of another seed's; variance that is linear in
the true parameters (beans); generalization in the modes above chance; processor seconds of the main process.
A core set can't be expected to be nearer to one seed than the seeds are to each other.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from homolog.analysis.evaluation import generalization
from homolog.analysis.parallel import parallel_analysis
from homolog.analysis.procrustes import align
from homolog.arrays import FloatArray
from homolog.beans.evaluate import evaluate
from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans
from homolog.cohort import read_cohort
from homolog.files.project import ProjectFolder
from homolog.files.results import Result, read_result
from homolog.run import Run
from homolog.settings import OptimizeSettings, RunSettings


def scores(particles: FloatArray, modes: int) -> FloatArray:
    """Return standardized scores in the first modes, which do not depend on the order of the particles."""
    shapes = align(particles, scaling=False)
    rows = (shapes - shapes.mean(axis=0)).reshape(len(shapes), -1)
    left: FloatArray = np.linalg.svd(rows, full_matrices=False)[0][:, :modes]
    return left


def angle(first: Result, second: Result, modes: int) -> float:
    cosines = np.linalg.svd(scores(first.world, modes).T @ scores(second.world, modes))[1]
    return float(np.degrees(np.arccos(np.clip(cosines.min(), -1.0, 1.0))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--beans", type=int)
    source.add_argument("--cohort", type=Path)
    parser.add_argument("--core-set", type=int, required=True)
    parser.add_argument("--particles", type=int, default=128)
    parser.add_argument("--workers", type=int)
    arguments = parser.parse_args()
    cohort_folder = arguments.cohort
    beans = draw_beans(arguments.beans, 5) if arguments.beans else []
    if beans:
        cohort_folder = arguments.folder / f"beans{arguments.beans}"
        if not cohort_folder.exists():
            write_beans(cohort_folder, beans, 5)
    cohort = read_cohort(cohort_folder)
    results = {}
    print("| placed | s | angles to it | to the other seed | linear % | generalization mm |")
    print("|---|---|---|---|---|---|")
    ways = [
        ("jointly, seed 1", None, 1),
        ("jointly", None, 0),
        (f"core set of {arguments.core_set}", arguments.core_set, 0),
    ]
    for title, core, seed in ways:
        name = f"{cohort_folder.name}-{arguments.particles}-{core}-{seed}"
        project = ProjectFolder(arguments.folder / name)
        optimize = OptimizeSettings(particles=arguments.particles, core_set=core, seed=seed)
        settings = RunSettings(optimize=optimize, workers=arguments.workers)
        began = time.process_time()
        Run(project, cohort, settings, skip_bad=True).execute()
        seconds = time.process_time() - began
        results[title] = result = read_result(project)
        if title == "jointly, seed 1":
            continue
        joint, other = results["jointly"], results["jointly, seed 1"]
        modes = max(parallel_analysis(align(joint.world, scaling=False)).n_retained, 1)
        linear = f"{100.0 * evaluate(result.local, beans).ground_truth_r2:.2f}" if beans else ""
        error = generalization(result.world)[modes - 1]
        sizes = sorted({1, 2, modes})
        apart = [", ".join(f"{angle(result, item, size):.1f}°" for size in sizes) for item in (joint, other)]
        print(f"| {title} | {seconds:.0f} |", " | ".join(apart), f"| {linear} | {error:.3f} |", flush=True)
    print("Angles of the first", ", ".join(map(str, sizes)), "modes.")


if __name__ == "__main__":
    main()
