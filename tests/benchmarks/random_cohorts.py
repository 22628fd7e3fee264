"""Whole runs of random cohorts of known correspondence, default settings.

    python tests/benchmarks/random_cohorts.py [--cohorts 60] [--first 0] [--subjects 8] [--particles 128]

A cohort is one random solid deformed in several ways (bent, twisted, a process grown, a wall thinned, size
changed threefold, stretched), written as meshes or as label maps. Printed is a row a cohort: why the run
ended, what was left out, and how far particles are from those that the known correspondence carries there, in
spacings: the share of pairs below half a spacing, the mean and the 95th percentile.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

from cohort import carried_errors, random_cohort, write_cohort

from homolog.cohort import read_cohort
from homolog.correspondence import Shape, load_kernels, optimize
from homolog.device import choose_device, describe_device
from homolog.errors import HomologError
from homolog.grooming import Problem, align_cohort, groom_cohort
from homolog.settings import OptimizeSettings, RunSettings

WANTED = 0.95
"""Of the pairs: so many are to be closer than half a spacing."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cohorts", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--subjects", type=int, default=8)
    parser.add_argument("--particles", type=int, default=128)
    parser.add_argument("--device", default="auto")
    options = parser.parse_args()
    device = choose_device(options.device)
    load_kernels(device)
    print(describe_device(device))
    print("| cohort | family | files | ended | below half a spacing | mean | 95 % | s |")
    print("|---|---|---|---|---|---|---|---|")
    good = 0
    for seed in range(options.first, options.first + options.cohorts):
        begun = time.perf_counter()
        cohort = random_cohort(seed, options.subjects)
        with tempfile.TemporaryDirectory(prefix="homolog-cohort-") as folder:
            write_cohort(cohort, Path(folder))
            ended, errors = attempt(cohort, Path(folder), options.particles, device)
        below = float(np.mean(errors < 0.5))
        good += below >= WANTED and ended == "converged"
        print(
            f"| {seed} | {cohort.family} | {cohort.kind} | {ended} | {100.0 * below:.1f} % "
            f"| {errors.mean():.2f} | {np.percentile(errors, 95):.2f} | {time.perf_counter() - begun:.0f} |",
            flush=True,
        )
    print(
        f"{good} of {options.cohorts} converged with {100 * WANTED:.0f} % of the pairs below half a spacing"
    )


def attempt(cohort, folder, particles, device):
    """Return why a run ended, with the notes on subjects that do not belong, and the errors."""
    settings = RunSettings(optimize=OptimizeSettings(particles=particles))
    problems: list[Problem] = []
    read = read_cohort(folder)
    try:
        groomed = groom_cohort(read, settings.groom, left_out=problems)
        if problems:
            return f"refused {len(problems)}: {problems[0].message}", np.full(1, np.inf)
        groomed, alignments = align_cohort(read, groomed, settings.groom)
        shapes = [
            Shape(subject.name, subject.field, subject.mesh, subject.coarse_mesh, alignment)
            for subject, alignment in zip(groomed, alignments, strict=True)
        ]
        found = optimize(shapes, settings.placing, device=device)
    except HomologError as error:
        return f"{type(error).__name__}: {error}", np.full(1, np.inf)
    return found.reason.value, carried_errors(cohort, np.asarray(found.local))


if __name__ == "__main__":
    main()
