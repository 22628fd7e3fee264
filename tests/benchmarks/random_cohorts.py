"""Whole runs of random cohorts of known correspondence, default settings.

    python tests/benchmarks/random_cohorts.py [--cohorts 60] [--first 0] [--subjects 8] [--particles 128]
                                              [--from-truth]

A cohort is one random solid deformed in several ways (bent, twisted, a process grown, a wall thinned, size
changed threefold, stretched), written as meshes or as label maps. Printed is a row a cohort: why the run
ended, what was left out, and how far particles are from those that the known correspondence carries there,
in spacings: the share of pairs below half a spacing, the mean and the 95th percentile. With --from-truth a
second run of each cohort starts with the particles of the first shape, carried to the others by the known
correspondence: where it ends with the same objective and the same errors, the shapes themselves do not tell
where the material went.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

from cohort import carried, carried_errors, random_cohort, write_cohort

from homolog.cohort import read_cohort
from homolog.correspondence import InitialParticles, Shape, load_kernels, optimize
from homolog.device import choose_device, describe_device
from homolog.errors import HomologError
from homolog.grooming import Problem, groom_cohort
from homolog.registration import align_cohort
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
    parser.add_argument("--from-truth", action="store_true", help="a second run that starts from the truth")
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
            outcomes = list(attempts(cohort, Path(folder), options.particles, device, options.from_truth))
        for number, (ended, errors) in enumerate(outcomes):
            below = float(np.mean(errors < 0.5))
            good += number == 0 and below >= WANTED and ended.startswith("converged")
            name = "from the truth" if number else cohort.family
            print(
                f"| {seed} | {name} | {cohort.kind} | {ended} | {100.0 * below:.1f} % | {errors.mean():.2f} "
                f"| {np.percentile(errors, 95):.2f} | {time.perf_counter() - begun:.0f} |",
                flush=True,
            )
    print(
        f"{good} of {options.cohorts} converged with {100 * WANTED:.0f} % of the pairs below half a spacing"
    )


def attempts(cohort, folder, particles, device, from_truth):
    """Yield why each run ended, with its objective or what was refused, and the errors."""
    settings = RunSettings(optimize=OptimizeSettings(particles=particles))
    problems: list[Problem] = []
    read = read_cohort(folder)
    try:
        groomed = groom_cohort(read, settings.groom, left_out=problems)
        if problems:
            yield f"refused {len(problems)}: {problems[0].message}", np.full(1, np.inf)
            return
        groomed, alignments = align_cohort(read, groomed, settings.groom)
        shapes = [
            Shape(subject.name, subject.field, subject.mesh, subject.coarse_mesh, alignment)
            for subject, alignment in zip(groomed, alignments, strict=True)
        ]
        initial = None
        for _ in range(1 + from_truth):
            optimized = optimize(shapes, settings.placing, device=device, initial=initial)
            objective = float(optimized.energies[-1, 1:].sum())
            local = np.asarray(optimized.local)
            yield f"{optimized.reason.value}, {objective:.4f}", carried_errors(cohort, local)
            initial = InitialParticles(carried(cohort.meshes, 0, local[0]))
    except HomologError as error:
        yield f"{type(error).__name__}: {error}", np.full(1, np.inf)


if __name__ == "__main__":
    main()
