"""Whether the power that `homolog plan` predicts from a pilot is that of simulated studies.

    python tests/benchmarks/plan_power.py [--pilots 20] [--studies 1000] [--jobs 2] [--out FILE]

Shapes are those of statistics_validity.py: particles on a sphere of 30 mm with correlated noise. A bump is
planned from pilots of 20, 40 and 80 subjects without an effect; the power of its two tests (whole shape,
place) is then counted in studies that are drawn from the population itself. Prints, for each number of
subjects per group, the counted power, and mean and root mean square of predicted minus counted power over
the pilots, in percentage points, and for a place how often the 90 % interval holds the counted power.
"""

import argparse
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from statistics_validity import SPHERE, drawn

from homolog.comparison.plan import PlanSettings, bump, plan_study
from homolog.statistics.design import group_design
from homolog.statistics.procrustes import Alignment, aligned
from homolog.statistics.randomization import Randomization, shape_test
from homolog.threads import blas_threads

NUMBERS = (8, 15, 30)
EFFECTS = ((1.5, 15.0), (2.0, 10.0), (1.0, 25.0))
"""Height and width of a bump [mm]."""
PILOTS = (20, 40, 80)
PARTICLE, DRAWS, BLOCK = 40, 199, 25
NORMALS = SPHERE / 30.0

Task = tuple[int, int, int, int]


def settings_of(effect: int, studies: int) -> PlanSettings:
    height, width = EFFECTS[effect]
    return PlanSettings(
        effect=height,
        width=width,
        particle=PARTICLE,
        per_group=NUMBERS,
        studies=studies,
        permutations=DRAWS,
        alignment=Alignment.SHAPE,
    )


def predicted(task: Task) -> np.ndarray:
    """Return the power that one pilot predicts and its interval, (3, numbers, 2)."""
    effect, subjects, pilot, studies = task
    shapes = SPHERE + drawn(np.random.default_rng([3, subjects, pilot]), np.ones(subjects))
    with blas_threads(1):
        plan = plan_study(shapes, ["a"] * subjects, NORMALS, settings_of(effect, studies))
    powers = [[(row.whole, np.nan, np.nan), (row.place, *row.place_range)] for row in plan.rows]
    return np.moveaxis(np.array(powers), 2, 0)


def counted(task: Task) -> np.ndarray:
    """Return how many of a block of studies find the effect, in the whole shape and at its place."""
    effect, number, first, last = task
    height, width = EFFECTS[effect]
    displaced = bump(SPHERE, NORMALS, PARTICLE, height, width)
    near = np.linalg.norm(displaced, axis=1) >= 0.5 * height
    design = group_design(["a"] * number + ["b"] * number, ["a", "b"])
    found = np.zeros(2)
    with blas_threads(1):
        for study in range(first, last):
            shapes = SPHERE + drawn(np.random.default_rng([4, effect, number, study]), np.ones(2 * number))
            shapes[number:] += displaced
            shapes = aligned(shapes, Alignment.SHAPE)
            rows = shapes.reshape(len(shapes), -1)
            places = Randomization(design, rows, draws=DRAWS, seed=study).surface(shapes).p_fwe
            found += shape_test(shapes, design, draws=DRAWS, seed=study).p <= 0.05, places[near].min() <= 0.05
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pilots", type=int, default=20, help="of each size")
    parser.add_argument("--studies", type=int, default=1000, help="of each effect and number, counted")
    parser.add_argument("--simulated", type=int, default=200, help="studies that a plan simulates")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, help="file of the table, written besides")
    options = parser.parse_args()
    blocks = [
        (effect, number, start, min(start + BLOCK, options.studies))
        for effect in range(len(EFFECTS))
        for number in NUMBERS
        for start in range(0, options.studies, BLOCK)
    ]
    plans = [
        (effect, subjects, pilot, options.simulated)
        for effect in range(len(EFFECTS))
        for subjects in PILOTS
        for pilot in range(options.pilots)
    ]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        hits, powers = list(pool.map(counted, blocks)), list(pool.map(predicted, plans))
    heads = " | ".join(f"{subjects} subjects" for subjects in PILOTS)
    lines = [f"| bump | per group | test | power | {heads} |", "|---" * (4 + len(PILOTS)) + "|"]
    for effect, (height, width) in enumerate(EFFECTS):
        for row, number in enumerate(NUMBERS):
            own = [hit for hit, task in zip(hits, blocks, strict=True) if task[:2] == (effect, number)]
            for column, test in enumerate(("whole shape", "place")):
                truth = 100.0 * sum(own)[column] / options.studies
                cells = []
                for subjects in PILOTS:
                    kept = zip(powers, plans, strict=True)
                    own_powers = [p[:, row, column] for p, task in kept if task[:2] == (effect, subjects)]
                    value, low, high = 100.0 * np.array(own_powers).T
                    off, held = value - truth, 100.0 * np.mean((low <= truth) & (truth <= high))
                    root = np.sqrt(np.mean(np.square(off)))
                    of_place = f", {held:.0f} %" if test == "place" else ""
                    cells.append(f"{np.mean(off):+.1f} ± {root:.1f}{of_place}")
                bump_text = f"{height:g} mm, {width:g} mm wide"
                lines.append(f"| {bump_text} | {number} | {test} | {truth:.1f} | {' | '.join(cells)} |")
    print("\n".join(lines))
    if options.out is not None:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
