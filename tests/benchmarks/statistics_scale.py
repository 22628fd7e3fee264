"""Time and memory of the statistics of large cohorts.

    python tests/benchmarks/statistics_scale.py [--sizes 1000 3000 10000] [--particles 1024]
        [--permutations 10000] [--only NAME ...]

Two groups of synthetic subjects with eight modes and noise. Every step runs in a process of its own. Prints
a table in Markdown with wall and processor seconds, and the peak memory beyond that of the particles.
"""

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable

import numpy as np

from homolog.arrays import FloatArray
from homolog.statistics.assumptions import dispersion_test
from homolog.statistics.comparison import Options
from homolog.statistics.design import covariate_columns, group_design
from homolog.statistics.discriminant import discriminant
from homolog.statistics.mode_test import mode_test
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.pointwise_test import pointwise_test
from homolog.statistics.procrustes import align
from homolog.statistics.shape_model import ShapeModel
from homolog.statistics.studies import compare_two_groups

MODES = 8


def cohort(size: int, particles: int) -> tuple[FloatArray, FloatArray, list[str]]:
    """Return particles (M, N, 3), ages (M,) and groups, the second of which is larger by half a deviation."""
    generator = np.random.default_rng(0)
    groups = ["a" if index % 5 < 2 else "b" for index in range(size)]
    scores = generator.normal(size=(size, MODES)) * [8.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.2, 1.0]
    scores[:, 2] += 0.5 * (np.array(groups) == "b")
    shapes = generator.normal(size=(size, particles, 3), scale=0.3)
    mean = 30.0 * generator.normal(size=(particles, 3))
    modes = 0.2 * generator.normal(size=(MODES, particles, 3))
    for start in range(0, size, 500):
        rows = slice(start, start + 500)
        shapes[rows] += mean
        shapes[rows] += np.tensordot(scores[rows], modes, axes=1)
    return shapes, 60.0 + 10.0 * generator.normal(size=size), groups


def steps(size: int, particles: int, permutations: int) -> dict[str, Callable[[], object]]:
    """Return the steps by name; the data are made once."""
    shapes, age, groups = cohort(size, particles)
    design = group_design(groups, ["a", "b"])
    adjusted = group_design(groups, ["a", "b"], covariate_columns({"age": age.tolist()}))
    second = np.array(groups) == "b"
    members = {name: np.array(groups) == name for name in "ab"}
    drawn = {"permutations": permutations}
    return {
        "Procrustes alignment": lambda: align(shapes, scaling=False),
        "shape model": lambda: ShapeModel().fit(shapes),
        "parallel analysis": lambda: parallel_analysis(shapes),
        "whole shape, given modes": lambda: mode_test(shapes, design, modes=MODES, **drawn),
        "particles": lambda: pointwise_test(shapes, design, members=tuple(members.values()), **drawn),
        "dispersion": lambda: dispersion_test(shapes, design, MODES, members, **drawn),
        "discriminant": lambda: discriminant(shapes, second, MODES),
        "whole shape, a covariate": lambda: mode_test(shapes, adjusted, modes=MODES, **drawn),
        "particles, a covariate": lambda: pointwise_test(shapes, adjusted, **drawn),
        "whole comparison": lambda: compare_two_groups(
            shapes, groups, ("a", "b"), options=Options(permutations=permutations)
        ),
    }


def measure(name: str, size: int, particles: int, permutations: int) -> None:
    work = steps(size, particles, permutations)[name]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, processor = time.perf_counter(), time.process_time()
    work()
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e6
    print(f"| {size} | {name} | {wall:.1f} | {processor:.1f} | {peak:.2f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[1000, 3000, 10000])
    parser.add_argument("--particles", type=int, default=1024)
    parser.add_argument("--permutations", type=int, default=10_000)
    parser.add_argument("--only", nargs="+", help="steps, by name")
    arguments = parser.parse_args()
    names = arguments.only or list(steps(20, 16, 10))
    print("| subjects | step | wall (s) | processor (s) | memory (GB) |\n|---|---|---|---|---|")
    for size in arguments.sizes:
        for name in names:
            given = (name, size, arguments.particles, arguments.permutations)
            process = multiprocessing.get_context("spawn").Process(target=measure, args=given)
            process.start()
            process.join()
            if process.exitcode:
                print(f"| {size} | {name} | ended with {process.exitcode} | | |", flush=True)


if __name__ == "__main__":
    main()
