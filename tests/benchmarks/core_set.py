"""A core set and fits against the joint optimization of the same cohort.

    python tests/benchmarks/core_set.py FOLDER --beans 100 --core-set 24
    python tests/benchmarks/core_set.py FOLDER --cohort $HOMOLOG_DATA/lv_acdc_dev --core-set 14

Prints a table in Markdown: the largest angles between the subspaces of the first mode, the first two, and the
modes above chance to those of the joint optimization, and of another seed's; variance that is linear in
the true parameters (beans); compactness and generalization in the modes above chance; errors against the
dense true correspondence (beans, and folders with a folder ``truth``); processor seconds of the main process.
A core set can't be expected to be nearer to one seed than the seeds are to each other.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import pyvista
from dense_truth import bean_mesh, truth_errors

from homolog.arrays import FloatArray
from homolog.beans.evaluate import evaluate
from homolog.beans.files import write_beans
from homolog.beans.generate import Bean, draw_beans
from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.io.results import Result, read_result
from homolog.run import Run
from homolog.settings import Alignment, GroomSettings, OptimizeSettings, Procrustes, RunSettings
from homolog.statistics.evaluation import generalization
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.procrustes import align


def scores(particles: FloatArray, modes: int) -> FloatArray:
    """Return standardized scores in the first modes, which do not depend on the order of the particles."""
    shapes = align(particles, scaling=False)
    rows = (shapes - shapes.mean(axis=0)).reshape(len(shapes), -1)
    left: FloatArray = np.linalg.svd(rows, full_matrices=False)[0][:, :modes]
    return left


def angle(first: Result, second: Result, modes: int) -> float:
    cosines = np.linalg.svd(scores(first.world, modes).T @ scores(second.world, modes))[1]
    return float(np.degrees(np.arccos(np.clip(cosines.min(), -1.0, 1.0))))


def compactness(particles: FloatArray, modes: int) -> float:
    """Return the share of the variance in the first modes [%]."""
    shapes = align(particles, scaling=False)
    variances = np.linalg.svd((shapes - shapes.mean(axis=0)).reshape(len(shapes), -1), compute_uv=False) ** 2
    return float(100.0 * variances[:modes].sum() / variances.sum())


def truth_of(result: Result, folder: Path, beans: list[Bean]) -> str:
    """Return mean and 95th percentile of the errors against the dense truth [mm]; empty if none is known."""
    files = [folder / "truth" / f"{name}.ply" for name in result.names]
    if beans:
        meshes = [bean_mesh(bean) for bean in beans]
    elif all(file.is_file() for file in files):
        meshes = [pyvista.read(file) for file in files]
    else:
        return ""
    errors = truth_errors(meshes, result.local)
    return f"{errors.mean():.3f}, {np.percentile(errors, 95):.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--beans", type=int)
    source.add_argument("--cohort", type=Path)
    parser.add_argument("--core-set", type=int, required=True)
    parser.add_argument("--particles", type=int, default=128)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--files-aligned", action="store_true", help="keep the poses and sizes of the files")
    arguments = parser.parse_args()
    cohort_folder = arguments.cohort
    beans = draw_beans(arguments.beans, 5) if arguments.beans else []
    if beans:
        cohort_folder = arguments.folder / f"beans{arguments.beans}"
        if not cohort_folder.exists():
            write_beans(cohort_folder, beans, 5)
    cohort = read_cohort(cohort_folder)
    results: dict[str, Result] = {}
    seconds: dict[str, float] = {}
    ways = [
        ("jointly", None, 0),
        ("jointly, seed 1", None, 1),
        (f"core set of {arguments.core_set}", arguments.core_set, 0),
    ]
    for title, core, seed in ways:
        name = f"{cohort_folder.name}-{arguments.particles}-{core}-{seed}"
        project = ProjectFolder(arguments.folder / name)
        optimize = OptimizeSettings(particles=arguments.particles, core_set=core, seed=seed)
        groom = GroomSettings()
        if arguments.files_aligned:
            groom = groom.model_copy(update={"alignment": Alignment.NONE})
            optimize = optimize.model_copy(update={"procrustes": Procrustes.FORM})
        settings = RunSettings(groom=groom, optimize=optimize, workers=arguments.workers)
        began = time.process_time()
        Run(project, cohort, settings, skip_bad=True).execute()
        seconds[title] = time.process_time() - began
        print(f"{title}: {seconds[title]:.0f} s", flush=True)
        results[title] = read_result(project)
    joint, other = results["jointly"], results["jointly, seed 1"]
    modes = max(parallel_analysis(align(joint.world, scaling=False)).n_retained, 1)
    sizes = sorted({1, 2, modes})
    print(
        "| placed | s | angles to it | to the other seed | linear % | compactness % | generalization mm "
        "| error mm, 95 % |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for title, result in results.items():
        apart = [", ".join(f"{angle(result, item, size):.1f}°" for size in sizes) for item in (joint, other)]
        linear = f"{100.0 * evaluate(result.local, beans).ground_truth_r2:.2f}" if beans else ""
        error = generalization(result.world)[modes - 1]
        share = compactness(result.world, modes)
        numbers = f"| {linear} | {share:.2f} | {error:.3f} | {truth_of(result, cohort_folder, beans)} |"
        print(f"| {title} | {seconds[title]:.0f} |", " | ".join(apart), numbers, flush=True)
    print("Angles of the first", ", ".join(map(str, sizes)), "modes.")


if __name__ == "__main__":
    main()
