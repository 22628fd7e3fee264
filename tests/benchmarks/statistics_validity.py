"""Type I error rate and power of every reported test, by simulation, also where assumptions fail.

    python tests/benchmarks/statistics_validity.py [--repeats 1000] [--only WORD] [--seed 1] [--cautions]

Shapes are particles on a sphere of 30 mm with noise that is correlated over the surface (correlation length
15 mm, 1 mm) and white (0.1 mm). Each test is asked of shapes without an effect; it should call 5 % of the
repeats significant. Five modes, 199 permutations. Repeats are counted in which a caution is given: that
groups differ in dispersion, that sizes are skewed, that subjects lie far from the rest. Prints tables in
Markdown; with --cautions only these are counted.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable

import numpy as np
from scipy import stats
from scipy.spatial.distance import cdist

from homolog.analysis.cautions import dispersion_caution, outlier_caution, size_caution
from homolog.analysis.covariates import covariate_columns
from homolog.analysis.design import Design, group_design, paired_design, regression_design
from homolog.analysis.dispersion import dispersion_test
from homolog.analysis.effects import size_effect
from homolog.analysis.mode_test import ModeStatistic
from homolog.analysis.outliers import outliers_in_groups
from homolog.analysis.permutation import draw_permutations, permutation_p_value
from homolog.analysis.pointwise_test import PointwiseStatistic
from homolog.analysis.skewness import size_skewness
from homolog.analysis.studentized import observed_design
from homolog.threads import on_one_thread

PARTICLES = 128
PERMUTATIONS = 199
MODES = 5
ALPHA = 0.05
CAUTIONS = ("caution: dispersion", "caution: skewed size", "caution: outliers")
TESTS = ("F", "permutation", "local, family-wise", "size", *CAUTIONS)


def _sphere() -> np.ndarray:
    index = np.arange(PARTICLES)
    height = 1.0 - (2.0 * index + 1.0) / PARTICLES
    turn = np.pi * (1.0 + 5**0.5) * index
    radius = np.sqrt(1.0 - height**2)
    return 30.0 * np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])


SPHERE = _sphere()


class Shapes:
    """Shapes whose noise is correlated over the surface."""

    def __init__(self, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        squared = cdist(SPHERE, SPHERE, "sqeuclidean")
        self.root = np.linalg.cholesky(np.exp(-squared / (2 * 15.0**2)) + 1e-8 * np.eye(PARTICLES))
        self.pattern = self.root @ self.generator.normal(size=(PARTICLES, 3))

    def drawn(self, spread: np.ndarray, kind: str = "normal") -> np.ndarray:
        """Draw a shape for each spread [mm]."""
        size = (len(spread), PARTICLES, 3)
        draw = self.generator.normal(size=size)
        if kind == "skewed":
            draw = self.generator.exponential(size=size) - 1.0
        noise = self.root @ draw
        if kind == "skewed":
            noise = noise + 0.8 * (self.generator.exponential(size=(len(spread), 1, 1)) - 1.0) * self.pattern
        if kind == "outliers":
            noise *= np.where(self.generator.random(len(spread)) < 0.05, 4.0, 1.0)[:, None, None]
        white = 0.1 * self.generator.normal(size=size)
        return SPHERE + spread[:, None, None] * (noise + white)


def _counted(*counts: int) -> list[str]:
    return [name for name, count in zip("abc", counts, strict=False) for _ in range(count)]


def _spread(labels: list[str], doubled: str = "") -> np.ndarray:
    return np.where(np.array(labels) == doubled, 2.0, 1.0)


def groups(*counts: int, doubled: str = "", kind: str = "normal", related: bool = False) -> Callable:
    labels = _counted(*counts)
    order = sorted(set(labels))
    members = {item: np.array(labels) == item for item in order}

    def make(shapes: Shapes) -> tuple[np.ndarray, Design, dict]:
        data, column = shapes.drawn(_spread(labels, doubled), kind), None
        if related:
            age = shapes.generator.normal(size=len(labels)) + 0.5 * (np.array(labels) == "b")
            data = data + 0.7 * age[:, None, None] * shapes.pattern
            column = covariate_columns({"age": age.tolist()})
        return data, group_design(labels, order, column), members

    return make


def regression(count: int, grows: bool = False, skewed: bool = False) -> Callable:
    def make(shapes: Shapes) -> tuple[np.ndarray, Design, dict]:
        values = shapes.generator.normal(size=count)
        if skewed:
            values = shapes.generator.exponential(size=count)
        spread = np.exp(0.4 * values) if grows else np.ones(count)
        return shapes.drawn(spread), regression_design(values), {}

    return make


def pairs(count: int, kind: str = "normal") -> Callable:
    def make(shapes: Shapes) -> tuple[np.ndarray, Design, dict]:
        ones = np.ones(count)
        return shapes.drawn(ones, kind) - shapes.drawn(ones, kind), paired_design(count), {}

    return make


STUDIES = {
    "two groups, 21 + 21": groups(21, 21),
    "two groups, 8 + 34": groups(8, 34),
    "8 + 34, dispersion doubled in the smaller": groups(8, 34, doubled="a"),
    "8 + 34, dispersion doubled in the larger": groups(8, 34, doubled="b"),
    "12 + 30, dispersion doubled in the smaller": groups(12, 30, doubled="a"),
    "21 + 21, dispersion doubled in one": groups(21, 21, doubled="a"),
    "two groups, 5 + 6": groups(5, 6),
    "5 + 6, dispersion doubled in the smaller": groups(5, 6, doubled="a"),
    "8 + 34, skewed": groups(8, 34, kind="skewed"),
    "8 + 34, skewed, dispersion doubled in the smaller": groups(8, 34, doubled="a", kind="skewed"),
    "8 + 34, outliers (one in twenty, 4 x)": groups(8, 34, kind="outliers"),
    "three groups, 8 + 14 + 20": groups(8, 14, 20),
    "three groups, dispersion doubled in the smallest": groups(8, 14, 20, doubled="a"),
    "three groups, dispersion doubled in the largest": groups(8, 14, 20, doubled="c"),
    "12 + 30, adjusted for age": groups(12, 30, related=True),
    "12 + 30, adjusted for age, dispersion doubled in the smaller": groups(12, 30, doubled="a", related=True),
    "regression, 42": regression(42),
    "regression, 42, skewed variable": regression(42, skewed=True),
    "regression, 42, dispersion grows with the variable": regression(42, grows=True),
    "pairs, 15": pairs(15),
    "pairs, 15, skewed": pairs(15, "skewed"),
}


def size_of(data: np.ndarray) -> np.ndarray:
    """Return a size that is linear in the shapes: it does not grow with the noise, and pairs have it too."""
    return (data * SPHERE).sum(axis=2).mean(axis=1) / 30.0


@on_one_thread
def cautioned(data: np.ndarray, design: Design, members: dict, seed: int) -> list[bool]:
    """Say which cautions are given."""
    counts = {name: int(own.sum()) for name, own in members.items()}
    spread = dispersion_test(data, design, MODES, members, permutations=PERMUTATIONS, seed=seed + 2)
    return [
        bool(dispersion_caution(spread, counts)),
        bool(size_caution(size_skewness(size_of(data), design, members), counts)),
        bool(outlier_caution(outliers_in_groups(data, design, list(members.values())))),
    ]


@on_one_thread
def called(data: np.ndarray, design: Design, members: dict, seed: int) -> list[bool]:
    """Say which tests call these shapes significant, and which cautions are given."""
    residuals = design.residuals(data.reshape(len(data), -1))
    whole = ModeStatistic(residuals, design, MODES, None)
    local = PointwiseStatistic(residuals.reshape(data.shape), design)
    ratios, largest = [], []
    for some in draw_permutations(design, PERMUTATIONS, chunk=PERMUTATIONS, seed=seed):
        ratios.append(whole.studentized(some))
        largest.append(local.studentized(some).max(axis=1))
    original = observed_design(design)
    alike = () if design.covariates.shape[1] else tuple(members.values())
    found = size_effect(size_of(data), design, alike, permutations=PERMUTATIONS, seed=seed + 1)
    p = [
        float(np.exp(whole.log_p(original)[0])),
        float(permutation_p_value(whole.studentized(original), np.concatenate(ratios))[0]),
        float(permutation_p_value(local.studentized(original).max(), np.concatenate(largest))),
        1.0 if found is None else found.p,
    ]
    return [*(item <= ALPHA for item in p), *cautioned(data, design, members, seed)]


def rates(
    make: Callable, repeats: int, seed: int, first: int, effect: float = 0.0, asked: Callable = called
) -> list[float]:
    """Return how often each test calls something in per cent; permutations have seeds from the first on."""
    tests = TESTS if asked is called else CAUTIONS
    shapes, counts = Shapes(seed), Counter()
    for repeat in range(repeats):
        data, design, members = make(shapes)
        if effect:
            data = data + effect * design.columns[:, :1, None] * shapes.pattern
        counts.update(
            test for test, yes in zip(tests, asked(data, design, members, first + repeat), strict=True) if yes
        )
        if repeat % 50 == 0:
            sys.stderr.write(f"\r{repeat}/{repeats} ")
    return [100.0 * counts[test] / repeats for test in tests]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=1000)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=1, help="of shapes and permutations")
    parser.add_argument("--cautions", action="store_true")
    arguments = parser.parse_args()
    first = 7919 + 1_000_000 * (arguments.seed - 1)
    asked = cautioned if arguments.cautions else called
    tests = CAUTIONS if arguments.cautions else TESTS
    repeats = arguments.repeats
    low, high = stats.binom.interval(0.95, repeats, ALPHA) / np.array(repeats) * 100
    print(f"Type I error rate in % of {repeats} repeats; 95 % of counts at 5 %: {low:.1f} to {high:.1f}\n")
    print("| study |", " | ".join(tests), "|\n|---|", "---|" * len(tests), sep="")
    for name, make in STUDIES.items():
        if arguments.only in name:
            found = rates(make, repeats, seed=arguments.seed, first=first, asked=asked)
            print(f"| {name} |", " | ".join(f"{item:.1f}" for item in found), "|", flush=True)
    if arguments.cautions:
        return
    fewer = max(repeats // 4, 10)
    print(f"\nPower in %, effect of 0.3 x a smooth pattern of 1 mm, {fewer} repeats\n")
    print("| study |", " | ".join(TESTS[:3]), "|\n|---|---|---|---|", sep="")
    for name, make in STUDIES.items():
        if arguments.only in name:
            found = rates(make, fewer, seed=arguments.seed + 1, first=first, effect=0.3)[:3]
            print(f"| {name} |", " | ".join(f"{item:.0f}" for item in found), "|", flush=True)


if __name__ == "__main__":
    main()
