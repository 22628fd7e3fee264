"""Type I error rate and power of the default tests, by simulation, also where assumptions fail.

    python tests/benchmarks/statistics_validity.py [--repeats 1000] [--jobs 2] [--only WORD ...] [--seed N]
        [--out FILE]

Shapes are particles on a sphere of 30 mm with noise that is correlated over the surface (correlation length
15 mm, 1 mm) and white (0.1 mm). Each test is asked of shapes without an effect: it should call 5 % of the
repeats significant. A quarter as many have an effect (power; in small samples a larger one). *Plain*
is the usual Procrustes permutation of subjects, for comparison. Between are how often a caution on
covariances is given, and how often the 95 % interval of size contains the truth. 199 randomizations, 128
particles, five modes.

A repeat has its own seed, so that results are the same on any number of jobs. It prints the table of
docs/statistics.md in Markdown: 1000 repeats take some 25 minutes of two cores, or one of 64.
"""

import argparse
import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from zlib import crc32

import numpy as np
from scipy.spatial.distance import cdist

from homolog.statistics.assumptions import dispersion_test
from homolog.statistics.design import Hypothesis, group_design, make_design, paired_design, regression_design
from homolog.statistics.effects import effect_bounds
from homolog.statistics.randomization import Randomization, p_values
from homolog.threads import blas_threads

PARTICLES, DRAWS, MODES, ALPHA = 128, 199, 5, 0.05
EFFECT, LARGE = 0.3, 0.4
TESTS = ("whole shape", "modes", "particles", "size", "plain")
BLOCK = 25

Study = tuple[np.ndarray, Hypothesis, dict[str, np.ndarray]]


def _sphere() -> np.ndarray:
    index = np.arange(PARTICLES)
    height = 1.0 - (2.0 * index + 1.0) / PARTICLES
    turn = np.pi * (1.0 + 5**0.5) * index
    radius = np.sqrt(1.0 - height**2)
    return 30.0 * np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])


SPHERE = _sphere()
ROOT = np.linalg.cholesky(
    np.exp(-cdist(SPHERE, SPHERE, "sqeuclidean") / (2 * 15.0**2)) + 1e-8 * np.eye(PARTICLES)
)
PATTERN = ROOT @ np.random.default_rng(1).normal(size=(PARTICLES, 3))


def drawn(generator: np.random.Generator, spread: np.ndarray, *, tails: bool = False) -> np.ndarray:
    """Draw deviations for each spread (M,) or (M, N) [mm]; with the tails of Student's t of 3 degrees."""
    size = (len(spread), PARTICLES, 3)
    noise = ROOT @ generator.normal(size=size)
    if tails:
        noise /= np.sqrt(generator.chisquare(3, size=(len(spread), 1, 1)))
    noise += 0.1 * generator.normal(size=size)
    return noise * spread.reshape(len(spread), -1, 1)


def _labels(counts: tuple[int, ...]) -> list[str]:
    return [name for name, count in zip("abc", counts, strict=False) for _ in range(count)]


def groups(
    generator: np.random.Generator,
    *counts: int,
    doubled: str = "",
    pattern: bool = False,
    tails: bool = False,
) -> Study:
    """Draw groups; one may scatter twice as much, or all the same amount in other halves of the surface."""
    labels = _labels(counts)
    order = sorted(set(labels))
    members = {name: np.array(labels) == name for name in order}
    spread = np.where(np.array(labels) == doubled, 2.0, 1.0)[:, None] * np.ones(PARTICLES)
    if pattern:
        upper = np.where(SPHERE[:, 2] > 0.0, 1.8, 0.2)
        spread = np.sqrt(np.where(members["a"][:, None], upper, 2.0 - upper))
    return drawn(generator, spread, tails=tails), group_design(labels, order), members


def regression(
    generator: np.random.Generator, count: int, *, grows: bool = False, skewed: bool = False
) -> Study:
    values = generator.exponential(size=count) if skewed else generator.normal(size=count)
    return drawn(generator, np.exp(0.4 * values * grows)), regression_design(values), {}


def pairs(generator: np.random.Generator, count: int) -> Study:
    ones = np.ones(count)
    return drawn(generator, ones) - drawn(generator, ones), paired_design(count), {}


def adjusted(generator: np.random.Generator, *counts: int, term: str, doubled: str = "") -> Study:
    """Draw two groups whose ages differ and matter, and test a term of the model."""
    labels = _labels(counts)
    second = np.array(labels) == "b"
    age = generator.normal(size=len(labels)) + 0.8 * second
    table = {"group": labels, "age": age.tolist()}
    design = make_design("~ group * age" if ":" in term else "~ group + age", table)
    data = drawn(generator, np.where(np.array(labels) == doubled, 2.0, 1.0))
    return data + 0.7 * age[:, None, None] * PATTERN, design.hypothesis(term), {}


def visits(generator: np.random.Generator, subjects: int, *, term: str) -> Study:
    """Draw three visits of subjects of two groups, whose own shapes and changes differ."""
    second = np.arange(subjects) >= subjects // 3
    table = {
        "group": np.repeat(np.where(second, "b", "a"), 3).tolist(),
        "time": np.tile([0.0, 1.0, 2.0], subjects).tolist(),
    }
    who = np.repeat(np.arange(subjects), 3).astype(str).tolist()
    formula = "~ group * time" if ":" in term else "~ group + time"
    own, change = (np.repeat(drawn(generator, np.ones(subjects)), 3, axis=0) for _ in range(2))
    data = drawn(generator, np.ones(3 * subjects)) + 1.5 * own
    data += 0.5 * change * np.array(table["time"])[:, None, None]
    return data, make_design(formula, table, subject=who).hypothesis(term), {}


def strata(generator: np.random.Generator, *counts: int) -> Study:
    """Draw two groups at three sites, which differ in shape and in the share of the groups."""
    labels = _labels(counts)
    site = generator.integers(0, 3, size=len(labels))
    site[: counts[0] : 2] = 0
    design = make_design("~ group", {"group": labels}, strata=[str(item) for item in site])
    data = drawn(generator, np.ones(len(labels))) + site[:, None, None] * PATTERN
    return data, design.hypothesis("group"), {}


STUDIES: dict[str, Callable[[np.random.Generator], Study]] = {
    "two groups, 21 + 21": lambda g: groups(g, 21, 21),
    "8 + 34": lambda g: groups(g, 8, 34),
    "8 + 34, dispersion doubled in the smaller": lambda g: groups(g, 8, 34, doubled="a"),
    "8 + 34, dispersion doubled in the larger": lambda g: groups(g, 8, 34, doubled="b"),
    "12 + 30, equal dispersion in another pattern": lambda g: groups(g, 12, 30, pattern=True),
    "12 + 30, tails of t3": lambda g: groups(g, 12, 30, tails=True),
    "three groups, 8 + 14 + 20": lambda g: groups(g, 8, 14, 20),
    "8 + 14 + 20, doubled in the smallest": lambda g: groups(g, 8, 14, 20, doubled="a"),
    "regression, 42": lambda g: regression(g, 42),
    "42, skewed variable, growing dispersion": lambda g: regression(g, 42, grows=True, skewed=True),
    "fifteen pairs": lambda g: pairs(g, 15),
    "12 + 30, confounded covariate, adjusted": lambda g: adjusted(g, 12, 30, term="group"),
    "interaction, 12 + 30": lambda g: adjusted(g, 12, 30, term="group:age"),
    "interaction, 12 + 30, doubled in the smaller": lambda g: adjusted(
        g, 12, 30, term="group:age", doubled="a"
    ),
    "15 subjects with 3 visits: group": lambda g: visits(g, 15, term="group"),
    "15 subjects with 3 visits: time": lambda g: visits(g, 15, term="time"),
    "15 subjects with 3 visits: change by group": lambda g: visits(g, 15, term="group:time"),
    "16 + 26 within three sites (strata)": lambda g: strata(g, 16, 26),
    "small: regression, 6": lambda g: regression(g, 6),
    "small: regression, 8": lambda g: regression(g, 8),
    "small: regression, 12": lambda g: regression(g, 12),
    "small: 3 + 3": lambda g: groups(g, 3, 3),
    "small: 4 + 4": lambda g: groups(g, 4, 4),
    "small: 6 + 6": lambda g: groups(g, 6, 6),
    "small: 4 + 8, doubled in the smaller": lambda g: groups(g, 4, 8, doubled="a"),
    "small: 4 + 8, doubled in the larger": lambda g: groups(g, 4, 8, doubled="b"),
}


def plain(rows: np.ndarray, hypothesis: Hypothesis, seed: int) -> float:
    """Return p of the permutation of subjects, of F on all coordinates; of pairs that of signs."""
    generator = np.random.default_rng(seed)
    rest = hypothesis.residuals(rows)
    rest = rest @ rest.T
    null = []
    for draw in range(DRAWS + 1):
        tested = hypothesis.tested
        if draw and hypothesis.nuisance.shape[1]:
            tested = tested[generator.permutation(len(tested))]
        elif draw:
            tested = tested * generator.choice([-1.0, 1.0], size=(len(tested), 1))
        basis = np.linalg.qr(hypothesis.residuals(tested))[0]
        null.append(np.trace(basis.T @ rest @ basis))
    return float(p_values(np.array(null[0]), np.array(null[1:])))


def measured(study: str, effect: float, repeat: int, root: int) -> list[float]:
    """Return p of each test, whether a caution is given, and whether the interval of size holds the truth."""
    generator = np.random.default_rng([root, crc32(study.encode()), repeat, int(effect > 0.0)])
    data, hypothesis, members = STUDIES[study](generator)
    unit = hypothesis.columns[:, :1]
    if study.startswith("small"):
        unit = unit / np.abs(unit).mean() / 2.0  # the same effect for groups and along a number
    data = data + effect * unit[:, :, None] * PATTERN
    seed = int(generator.integers(2**31))
    rows = data.reshape(len(data), -1)
    residuals = hypothesis.residuals(rows)
    scores = np.linalg.svd(residuals, full_matrices=False)[0][:, : min(MODES, hypothesis.error_dof - 1)]
    size = (data * SPHERE).sum(axis=2).mean(axis=1)[:, None] / 30.0
    draw = Randomization(hypothesis, rows, draws=DRAWS, seed=seed)
    p = [draw.ratio(rows).p, draw.ratio(scores).p]
    p.append(float(draw.surface(data).p_fwe.min()) if hypothesis.error_dof > 3 else np.nan)
    p += [draw.ratio(size).p, plain(rows, hypothesis, seed)]
    spread = dispersion_test(
        data, hypothesis, min(MODES, scores.shape[1]), members, permutations=99, seed=seed
    )
    covered = np.nan
    if hypothesis.tested.shape[1] == 1 and not effect:
        _, low, high = effect_bounds(size, hypothesis, tuple(members.values()))
        covered = float(low[0] <= 0.0 <= high[0])
    return [*p, np.nan if spread is None else float(spread.p <= ALPHA), covered]


def block(task: tuple[str, float, int, int, int]) -> list[list[float]]:
    """Return the results of some repeats of a study."""
    study, effect, first, last, root = task
    with blas_threads(1):
        return [measured(study, effect, repeat, root) for repeat in range(first, last)]


def _alone() -> None:
    """Keep a job to one core, so that it starts no threads."""
    if hasattr(os, "sched_setaffinity"):
        own = sorted(os.sched_getaffinity(0))
        (number,) = multiprocessing.current_process()._identity
        os.sched_setaffinity(0, {own[number % len(own)]})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--only", nargs="+", default=[""], help="studies with one of these words")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path, help="file of the table, written besides")
    options = parser.parse_args()
    studies = [study for study in STUDIES if any(word in study for word in options.only)]
    tasks = []
    for study in studies:
        for effect in (0.0, LARGE if study.startswith("small") else EFFECT):
            count = options.repeats if not effect else max(options.repeats // 4, BLOCK)
            tasks += [(study, effect, k, min(k + BLOCK, count), options.seed) for k in range(0, count, BLOCK)]
    lines = [
        f"| study | {' | '.join(TESTS)} | caution | interval | power: {' | '.join(TESTS)} |",
        "|---" * (2 * len(TESTS) + 3) + "|",
    ]
    found: dict[tuple[str, bool], list[list[float]]] = {}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context, initializer=_alone) as pool:
        for (study, effect, *_), rows in zip(tasks, pool.map(block, tasks), strict=True):
            found.setdefault((study, effect > 0.0), []).extend(rows)
    for study in studies:
        cells = []
        for has_effect in (False, True):
            own = np.array(found[study, has_effect])
            tests = own[:, : len(TESTS)]
            rates = np.where(np.isnan(tests).any(axis=0), np.nan, 100.0 * (tests <= ALPHA).mean(axis=0))
            cells += [*rates, *(100.0 * own[:, len(TESTS) :].mean(axis=0) if not has_effect else [])]
        shown = ("–" if np.isnan(cell) else f"{cell:.1f}" for cell in cells)
        lines.append(f"| {study} | {' | '.join(shown)} |")
    print("\n".join(lines))
    if options.out is not None:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
