"""False alarms and power of every reported test, by simulation.

    python tests/benchmarks/statistics_validity.py [--repeats 1000] [--json FILE]

Shapes are particles on a sphere of 30 mm with noise that is correlated over the surface (correlation length
15 mm, 1 mm) and white (0.1 mm); age changes the shape and is related to nothing else, or, for the covariate
test, to the group as well. Under the null every test should call 5 % of the repeats significant; the band
is where 95 % of counts fall if it does. Prints tables in Markdown.
"""

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.spatial.distance import cdist

from homolog.analysis.covariates import covariate_columns
from homolog.analysis.design import group_design, paired_design, regression_design
from homolog.analysis.local_map import local_map
from homolog.analysis.mode_test import mode_test

PARTICLES = 128
COHORTS = ((9, 12), (18, 18), (13, 23))
PERMUTATIONS = 199
ALPHA = 0.05


class Shapes:
    """Shapes whose noise is correlated over the surface."""

    def __init__(self, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        index = np.arange(PARTICLES)
        height = 1.0 - (2.0 * index + 1.0) / PARTICLES
        turn = np.pi * (1.0 + 5**0.5) * index
        radius = np.sqrt(1.0 - height**2)
        self.sphere = 30.0 * np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])
        squared = cdist(self.sphere, self.sphere, "sqeuclidean")
        self.root = np.linalg.cholesky(np.exp(-squared / (2 * 15.0**2)) + 1e-8 * np.eye(PARTICLES))
        self.age_effect = self.root @ self.generator.normal(size=(PARTICLES, 3))

    def noise(self, subjects: int) -> np.ndarray:
        smooth = self.root @ self.generator.normal(size=(subjects, PARTICLES, 3))
        return smooth + 0.1 * self.generator.normal(size=smooth.shape)

    def drawn(self, subjects: int, age: np.ndarray) -> np.ndarray:
        return self.sphere + self.noise(subjects) + 0.7 * age[:, None, None] * self.age_effect


def false_alarms(counts: tuple[int, int], repeats: int, seed: int) -> Counter:
    """Count, for each test, the repeats that it calls significant."""
    shapes, alarms = Shapes(seed), Counter()
    subjects = sum(counts)
    two = ["a"] * counts[0] + ["b"] * counts[1]
    three = np.resize(["a", "b", "c"], subjects).tolist()
    for repeat in range(repeats):
        age = shapes.generator.normal(size=subjects)
        data = shapes.drawn(subjects, age)
        related = age + 0.5 * (np.array(two) == "b")
        confounded = shapes.drawn(subjects, related)
        column = covariate_columns({"age": related.tolist()})
        pairs = shapes.noise(subjects) - shapes.noise(subjects)
        studies = {
            "two groups": (data, group_design(two, ["a", "b"])),
            "two groups, age allowed for": (confounded, group_design(two, ["a", "b"], column)),
            "three groups": (data, group_design(three, ["a", "b", "c"])),
            "continuous variable": (data, regression_design(shapes.generator.normal(size=subjects))),
            "pairs": (pairs, paired_design(subjects)),
        }
        for name, (particles, design) in studies.items():
            whole = mode_test(particles, design, permutations=PERMUTATIONS, seed=repeat)
            alarms[name, "whole shape, F"] += whole.p <= ALPHA
            alarms[name, "whole shape, permutation"] += whole.p_permutation <= ALPHA
            local = local_map(particles, design, permutations=PERMUTATIONS, seed=repeat)
            alarms[name, "any particle, family-wise"] += local.p_family.min() <= ALPHA
            alarms[name, "any particle, FDR"] += local.q.min() <= ALPHA
            alarms[name, "any particle, uncorrected"] += local.p.min() <= ALPHA
        sys.stderr.write(f"\r{counts} {repeat + 1}/{repeats}")
    return alarms


def power(repeats: int, seed: int) -> list[tuple[str, int, int]]:
    """Count the repeats in which a bump of the first particles is found, by each correction."""
    shapes, rows = Shapes(seed), []
    bump = np.exp(-cdist(shapes.sphere, shapes.sphere[:1], "sqeuclidean") / (2 * 10.0**2))
    for height in (0.8, 1.2, 1.6, 2.0):
        family = bonferroni = 0
        for repeat in range(repeats):
            data = shapes.sphere + shapes.noise(36)
            data[18:] += height * bump * shapes.sphere[:1] / 30.0
            found = local_map(
                data, group_design(["a"] * 18 + ["b"] * 18, ["a", "b"]), permutations=499, seed=repeat
            )
            family += found.p_family.min() <= ALPHA
            bonferroni += found.p.min() * PARTICLES <= ALPHA
        rows.append((f"bump of {height} mm", family, bonferroni))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=1000)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    repeats = arguments.repeats
    low, high = stats.binom.interval(0.95, repeats, ALPHA) / np.array(repeats) * 100
    results = {counts: false_alarms(counts, repeats, seed) for seed, counts in enumerate(COHORTS)}
    print(
        f"\nFalse alarms in % of {repeats} repeats; band of a test that holds 5 %: {low:.1f} to {high:.1f}\n"
    )
    titles = [f"{first} + {second}" for first, second in COHORTS]
    print("| study | test |", " | ".join(titles), "|\n|---|---|", "---|" * len(titles), sep="")
    for key in results[COHORTS[0]]:
        values = " | ".join(f"{100 * results[counts][key] / repeats:.1f}" for counts in COHORTS)
        print(f"| {key[0]} | {key[1]} | {values} |")
    found = power(max(repeats // 5, 10), seed=9)
    print(f"\nPower in %, 18 + 18, {max(repeats // 5, 10)} repeats\n")
    print("| effect | permutation maximum | Bonferroni |\n|---|---|---|")
    for name, *hits in found:
        print(f"| {name} | " + " | ".join(f"{100 * hit / max(repeats // 5, 10):.0f}" for hit in hits) + " |")
    if arguments.json:
        flat = {f"{n}": {" / ".join(key): value for key, value in one.items()} for n, one in results.items()}
        arguments.json.write_text(json.dumps({"false_alarms": flat, "power": found}, default=int, indent=1))


if __name__ == "__main__":
    main()
