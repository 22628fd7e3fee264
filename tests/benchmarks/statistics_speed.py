"""Times of the statistics at the sizes of a study.

    python tests/benchmarks/statistics_speed.py [--large]

34 subjects x 1024 particles, 10 000 permutations; with --large also the shape model of 5000 subjects.
Prints a table in Markdown with wall and processor seconds.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from homolog.statistics.design import covariate_columns, group_design
from homolog.statistics.discriminant import discriminant
from homolog.statistics.mode_test import mode_test
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.pointwise_test import pointwise_test
from homolog.statistics.shape_model import ShapeModel


def timed(name: str, work: Callable[[], object]) -> None:
    wall, processor = time.perf_counter(), time.process_time()
    work()
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    print(f"| {name} | {wall:.2f} | {processor:.2f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true")
    arguments = parser.parse_args()
    generator = np.random.default_rng(0)
    scores = generator.normal(size=(34, 6)) * [8.0, 5.0, 4.0, 3.0, 2.0, 1.5]
    shapes = 0.2 * np.tensordot(scores, generator.normal(size=(6, 1024, 3)), axes=1)
    shapes += 0.3 * generator.normal(size=shapes.shape)
    groups = ["a"] * 16 + ["b"] * 18
    age = covariate_columns({"age": generator.normal(size=34).tolist(), "sex": ["m", "f"] * 17})
    two, allowed = group_design(groups, ["a", "b"]), group_design(groups, ["a", "b"], age)
    three = group_design(np.resize(["a", "b", "c"], 34).tolist(), ["a", "b", "c"])
    print("| 34 subjects x 1024 particles, 10 000 permutations | wall (s) | processor (s) |\n|---|---|---|")
    timed("shape model", lambda: ShapeModel().fit(shapes))
    timed("parallel analysis, 200 data sets", lambda: parallel_analysis(shapes))
    timed("whole shape, two groups (with parallel analysis)", lambda: mode_test(shapes, two))
    timed("pointwise tests with largest statistic, two groups", lambda: pointwise_test(shapes, two))
    timed("whole shape, two covariates (modes chosen in each)", lambda: mode_test(shapes, allowed))
    timed("pointwise tests, two covariates", lambda: pointwise_test(shapes, allowed))
    timed("whole shape, three groups", lambda: mode_test(shapes, three))
    timed("pointwise tests, three groups", lambda: pointwise_test(shapes, three))
    timed(
        "discriminant, 20 x 10 folds, 1000 bootstraps, 499 permutations",
        lambda: discriminant(shapes, np.arange(34) > 15, 4),
    )
    if arguments.large:
        large = generator.normal(size=(5000, 1024, 3))
        timed("shape model of 5000 subjects", lambda: ShapeModel().fit(large))


if __name__ == "__main__":
    main()
