"""A core set and fits against the joint optimization of the same cohort.

    python tests/benchmarks/core_set.py FOLDER --beans 100 --core-set 24
    python tests/benchmarks/core_set.py FOLDER --cohort $HOMOLOG_DATA/lv_acdc_dev --core-set 14

Prints a table in Markdown: the largest angle between the subspaces of the modes above chance (of the joint
optimization), variance that is linear in the true parameters (beans), generalization, and seconds.
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
    print("| placed | s | angle | linear % | generalization mm |\n|---|---|---|---|---|")
    for title, core in (("jointly", None), (f"core set of {arguments.core_set}", arguments.core_set)):
        project = ProjectFolder(arguments.folder / f"{cohort_folder.name}-{arguments.particles}-{core}")
        settings = RunSettings(
            optimize=OptimizeSettings(particles=arguments.particles, core_set=core), workers=arguments.workers
        )
        began = time.perf_counter()
        Run(project, cohort, settings, skip_bad=True).execute()
        seconds = time.perf_counter() - began
        results[title] = result = read_result(project)
        joint = results["jointly"]
        modes = max(parallel_analysis(align(joint.world, scaling=False)).n_retained, 1)
        linear = f"{100.0 * evaluate(result.local, beans).ground_truth_r2:.2f}" if beans else ""
        error = generalization(result.world)[modes - 1]
        apart = f"{angle(result, joint, modes):.1f}° of {modes} modes"
        print(f"| {title} | {seconds:.0f} | {apart} | {linear} | {error:.3f} |", flush=True)


if __name__ == "__main__":
    main()
