"""Type I error rate and power of every reported test, by simulation, also where assumptions fail.

    python tests/benchmarks/statistics_validity.py FILE [--repeats 1000] [--workers 16] [--only WORD ...]
    python tests/benchmarks/statistics_validity.py FILE --summary

Shapes are particles on a sphere of 30 mm with noise that is correlated over the surface (correlation length
15 mm, 1 mm) and white (0.1 mm). Each test is asked of shapes without an effect; it should call 5 % of the
repeats significant. A quarter as many repeats have an effect (power). Five modes, 199 permutations (all of
them if `homolog analyze` takes all by default, as for groups of 4 and 8), of the discriminant's accuracy and
AUC 19: at 0.05 as valid as more, with less power. The cautions that a reader gets are noted too: that groups
differ in dispersion, that sizes are skewed, that subjects lie far from the rest.

FILE gets a line of JSON for each block of repeats; the same command goes on where an earlier one ended, also
with more repeats. A repeat has its own seed, so that blocks are the same in any order and on any number of
workers. The summary is the tables of docs/benchmarks.md and docs/notes/statistics.md in Markdown, and tests
outside 4 to 6 %, with their rate in the studies that raise no caution. A repeat of all 24 studies, power
included, takes 3 processor seconds, most of them for the five of small groups: 1000 repeats 50 minutes on one
core, four on sixteen. Needs numpy, scipy and threadpoolctl.
"""

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from zlib import crc32

import numpy as np
from scipy import stats
from scipy.spatial.distance import cdist

from homolog import __version__
from homolog.statistics.assumptions import dispersion_test, outliers_by, relative_distances, size_skewness
from homolog.statistics.cautions import dispersion_caution, outlier_caution, size_caution
from homolog.statistics.design import (
    Design,
    covariate_columns,
    group_design,
    paired_design,
    regression_design,
)
from homolog.statistics.discriminant import discriminant
from homolog.statistics.effects import size_effect
from homolog.statistics.mode_test import ModeStatistic
from homolog.statistics.permutation import null_distribution, permutation_count, permutation_p_value
from homolog.statistics.pointwise_test import PointwiseStatistic
from homolog.statistics.statistics import observed_design
from homolog.threads import blas_threads

PARTICLES = 128
PERMUTATIONS = 199
DEFAULT_PERMUTATIONS = 10_000
CLASSIFICATIONS = 19
MODES = 5
ALPHA = 0.05
TESTS = ("F", "whole shape, permutation", "particles, family-wise", "size", "dispersion")
DISCRIMINANT = ("accuracy", "AUC")
PARTS = ("tests", "discriminant")
CAUTIONS = ("dispersion", "size", "outliers")
BLOCK = 25
CHUNK = 200
EFFECT = 0.3


def _sphere() -> np.ndarray:
    index = np.arange(PARTICLES)
    height = 1.0 - (2.0 * index + 1.0) / PARTICLES
    turn = np.pi * (1.0 + 5**0.5) * index
    radius = np.sqrt(1.0 - height**2)
    return 30.0 * np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])


SPHERE = _sphere()


class Shapes:
    """Shapes whose noise is correlated over the surface; a seed has one pattern of effects."""

    def __init__(self, seed: int, *draw: int) -> None:
        squared = cdist(SPHERE, SPHERE, "sqeuclidean")
        self.root = np.linalg.cholesky(np.exp(-squared / (2 * 15.0**2)) + 1e-8 * np.eye(PARTICLES))
        self.pattern = self.root @ np.random.default_rng(seed).normal(size=(PARTICLES, 3))
        self.generator = np.random.default_rng([seed, *draw])

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
    "two groups, 4 + 8": groups(4, 8),
    "4 + 8, dispersion doubled in the smaller": groups(4, 8, doubled="a"),
    "4 + 8, dispersion doubled in the larger": groups(4, 8, doubled="b"),
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


def two_groups(study: str) -> bool:
    """Return whether a study has a discriminant."""
    return not study.startswith(("three", "regression", "pairs"))


def size_of(data: np.ndarray) -> np.ndarray:
    """Return a size that is linear in the shapes: it does not grow with the noise, and pairs have it too."""
    return (data * SPHERE).sum(axis=2).mean(axis=1) / 30.0


def permutations_of(design: Design) -> int:
    """Return the number to request: the default if that takes all permutations, else fewer."""
    return DEFAULT_PERMUTATIONS if permutation_count(design, DEFAULT_PERMUTATIONS)[1] else PERMUTATIONS


def cautioned(data: np.ndarray, design: Design, members: dict, seed: int) -> tuple[float | None, list[int]]:
    """Return p of the test of dispersion, and which cautions are given, as 0 and 1."""
    counts = {name: int(own.sum()) for name, own in members.items()}
    drawn = {"permutations": permutations_of(design), "seed": seed}
    spread = dispersion_test(data, design, MODES, members, **drawn)
    sentences = (
        dispersion_caution(spread, counts),
        size_caution(size_skewness(size_of(data), data, design, members), counts),
        outlier_caution(outliers_by(relative_distances(data, design, list(members.values()))), counts),
    )
    return None if spread is None else spread.p, [int(bool(sentence)) for sentence in sentences]


def classified(data: np.ndarray, design: Design, members: dict, seed: int) -> list[float | None]:
    """Return p of accuracy and AUC of the discriminant between two groups."""
    covariates = design.covariates if design.covariates.shape[1] else None
    chosen = {"bootstraps": 0, "permutations": CLASSIFICATIONS, "seed": seed, "repeats": 1}
    result = discriminant(data, members["b"], MODES, covariates=covariates, **chosen)
    return [result.accuracy.p, result.auc.p]


def p_values(data: np.ndarray, design: Design, members: dict, seed: int) -> list[float | None]:
    """Return p of each test but that of dispersion."""
    residuals = design.residuals(data.reshape(len(data), -1))
    whole = ModeStatistic(residuals, design, MODES)
    local = PointwiseStatistic(residuals.reshape(data.shape), design)
    requested = permutations_of(design)
    count = permutation_count(design, requested)[0]
    original = observed_design(design)

    def p_of(statistic: Callable, *, means: bool) -> float:
        drawn = {"chunk": CHUNK, "seed": seed, "means": means}
        null = null_distribution(statistic, design, requested, **drawn)
        return float(permutation_p_value(statistic(original), null, count)[0])

    alike = () if design.covariates.shape[1] else tuple(members.values())
    result = size_effect(size_of(data), design, alike, permutations=requested, seed=seed + 1)
    return [
        float(np.exp(whole.log_p(original)[0])),
        p_of(whole.studentized, means=whole.restores_mean),
        p_of(lambda some: local.studentized(some).max(axis=1), means=local.restores_mean),
        1.0 if result is None else result.p,
    ]


def block(part: str, study: str, effect: float, seed: int, first: int) -> dict:
    """Return what the tests, or the discriminant, and cautions say of some repeats."""
    begun = process_time()
    p, cautions = [], []
    with blas_threads(0):
        for repeat in range(first, first + BLOCK):
            shapes = Shapes(seed, crc32(study.encode()), repeat, int(effect > 0.0))
            data, design, members = STUDIES[study](shapes)
            if effect:
                data = data + effect * design.columns[:, :1, None] * shapes.pattern
            permuted = int(shapes.generator.integers(2**31))
            dispersion, given = cautioned(data, design, members, permuted + 2)
            if part == "tests":
                row = [*p_values(data, design, members, permuted), dispersion]
            else:
                row = classified(data, design, members, permuted + 3)
            p.append([None if value is None else round(value, 5) for value in row])
            cautions.append(given)
    return {
        **{"version": __version__, "permutations": PERMUTATIONS},
        **{"part": part, "study": study, "effect": effect, "seed": seed, "first": first},
        **{"p": p, "cautions": cautions, "seconds": round(process_time() - begun, 2)},
    }


def key_of(result: dict) -> tuple:
    return tuple(result[name] for name in ("part", "study", "effect", "seed", "first"))


def stored(file: Path) -> dict[tuple, dict]:
    """Return the blocks of a file; a last line that was cut off is left out, and cut off."""
    if not file.exists():
        return {}
    whole, _, _ = file.read_text(encoding="utf-8").rpartition("\n")
    file.write_text(whole + "\n" if whole else "", encoding="utf-8")
    blocks = [json.loads(line) for line in whole.splitlines()]
    others = {item["version"] for item in blocks} - {__version__}
    if others:
        sys.exit(f"{file}: blocks of version {', '.join(sorted(others))}; name another file")
    return {key_of(item): item for item in blocks}


def compute(
    file: Path, repeats: int, workers: int, only: Sequence[str], seed: int, parts: Sequence[str]
) -> None:
    """Compute the blocks that the file does not have yet, some repeats of all studies before further ones."""
    done = stored(file)
    wanted = [
        (part, study, effect, seed, first)
        for part in parts
        for effect, count in ((0.0, repeats), (EFFECT, max(repeats // 4, BLOCK)))
        for first in range(0, count, BLOCK)
        for study in STUDIES
        if any(word in study for word in only) and (part == "tests" or two_groups(study))
    ]
    missing = [key for key in wanted if key not in done]
    with (
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
        file.open("a", encoding="utf-8") as lines,
    ):
        tasks = [pool.submit(block, *key) for key in missing]
        for number, task in enumerate(as_completed(tasks), start=1):
            lines.write(json.dumps(task.result()) + "\n")
            lines.flush()
            sys.stderr.write(f"\r{number} of {len(missing)} blocks ")
    sys.stderr.write("\n")


def summary(file: Path) -> None:
    """Print the tables of a file."""
    blocks = stored(file).values()
    print(f"Processor seconds: {sum(item['seconds'] for item in blocks):.0f}\n")
    cautions_of = f"cautions: {', '.join(CAUTIONS)}"
    main = _Table(["study", *TESTS[:4], cautions_of, f"power: {TESTS[0]}", "whole shape", "particles"])
    further = _Table(["study", TESTS[4], *DISCRIMINANT, "power: accuracy", "AUC"])
    outside = []
    for study in STUDIES:
        whole = [_collected(blocks, study, part, effect=False) for part in PARTS]
        strong = [_collected(blocks, study, part, effect=True)[0] for part in PARTS]
        if not any(len(p) for p, _ in whole):
            continue
        rates, powers = _rates(whole[0][0], len(TESTS)), _rates(strong[0], len(TESTS))
        cautions = next(given for p, given in whole if len(p))
        given = ", ".join(f"{100.0 * item:.0f}" for item in cautions.mean(axis=0))
        main.add(
            study, [_cell(item, 1) for item in rates[:4]], [given], [_cell(item, 0) for item in powers[:3]]
        )
        further.add(
            study,
            [_bounded(whole[0][0], 4), *(_bounded(whole[1][0], item) for item in range(2))],
            [_cell(item, 0) for item in _rates(strong[1], len(DISCRIMINANT))],
        )
        for (p, cautions), tests in zip(whole, (TESTS, DISCRIMINANT), strict=True):
            for test, column in zip(tests, p.T, strict=False):
                if test != "F" and not (test == "dispersion" and re.search("doubled|grows", study)):
                    outside += _beyond(f"{study}, {test}", column, cautions.any(axis=1))
    print(main, further, sep="\n\n")
    print("\nOutside 4 to 6 %, with 95 % intervals:\n", *outside, sep="\n")


class _Table:
    """A table in Markdown."""

    def __init__(self, columns: Sequence[str]) -> None:
        self.lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]

    def add(self, study: str, *cells: Sequence[str]) -> None:
        self.lines.append(f"| {' | '.join([study, *(cell for some in cells for cell in some)])} |")

    def __str__(self) -> str:
        return "\n".join(self.lines)


def _bounded(p: np.ndarray, column: int) -> str:
    """Return the cell of a test with its interval."""
    there = len(p) and np.isfinite(p[:, column]).all()
    return _share(p[:, column] <= ALPHA) if there else "–"


def _rates(p: np.ndarray, tests: int) -> list[float]:
    """Return the percentage of studies that each test calls significant; nan for tests that there are not."""
    if not len(p):
        return [np.nan] * tests
    return [float(100.0 * (row <= ALPHA).mean()) if np.isfinite(row).all() else np.nan for row in p.T]


def _cell(rate: float, digits: int) -> str:
    return f"{rate:.{digits}f}" if np.isfinite(rate) else "–"


def _beyond(name: str, p: np.ndarray, cautioned: np.ndarray) -> list[str]:
    """Return a line on a test whose rate is outside of 4 to 6 %."""
    calls = p <= ALPHA
    if not np.isfinite(p).all() or 0.04 <= calls.mean() <= 0.06:
        return []
    rest = calls[~cautioned]
    return [
        f"- {name}: {_share(calls)} % of {len(calls)}; a caution in {100.0 * cautioned.mean():.0f} %, of the "
        f"other {len(rest)} {_share(rest)} %"
    ]


def _share(calls: np.ndarray) -> str:
    """Return the percentage of studies called significant with Wilson's interval."""
    if not len(calls):
        return "–"
    low, high = stats.binomtest(int(calls.sum()), len(calls)).proportion_ci(method="wilson")
    return f"{100.0 * calls.mean():.1f} ({100.0 * low:.1f} to {100.0 * high:.1f})"


def _collected(
    blocks: Iterable[dict], study: str, part: str, *, effect: bool
) -> tuple[np.ndarray, np.ndarray]:
    chosen = [
        item
        for item in blocks
        if (item["part"], item["study"], bool(item["effect"])) == (part, study, effect)
    ]
    return np.array([row for item in chosen for row in item["p"]], np.float64), np.array(
        [row for item in chosen for row in item["cautions"]]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, help="of results, one line of JSON a block")
    parser.add_argument("--repeats", type=int, default=1000, help=f"a multiple of {BLOCK}")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument(
        "--only", nargs="+", default=[""], help="studies with one of these words in their name"
    )
    parser.add_argument("--part", choices=PARTS, help="only these; all by default")
    parser.add_argument("--seed", type=int, default=1, help="of shapes and permutations")
    parser.add_argument("--summary", action="store_true", help="print the tables of the file")
    options = parser.parse_args()
    if not options.summary:
        parts = [options.part] if options.part else PARTS
        compute(options.file, options.repeats, options.workers, options.only, options.seed, parts)
    summary(options.file)


if __name__ == "__main__":
    main()
