"""How often 95 % intervals of effects contain the truth, by simulation.

    python tests/benchmarks/statistics_intervals.py [--repeats 1000]

Prints tables in Markdown: explained variance (omega squared) and distance of three and four groups of normal
data, whose means differ in all modes; ratio of the dispersions of two groups of normal and of exponential
data, equal and doubled in the second; area under the curve (AUC) of normal scores, and cross-validated AUC of
the discriminant of two groups of normal shapes, whose truth is its mean. Takes 3 minutes of processor time.
"""

import argparse
from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from homolog.statistics.assumptions import dispersion_test
from homolog.statistics.design import group_design
from homolog.statistics.discriminant import discriminant
from homolog.statistics.effects import Effect, distance_of_several, explained_variance
from homolog.statistics.held_out import auc_bounds

Draw = Callable[[tuple[int, ...]], np.ndarray]


def covered(effect: Effect | None, truth: float) -> bool:
    """Return whether an interval contains the truth."""
    return effect is not None and effect.low <= truth <= effect.high


def coverage_of_groups(
    counts: Sequence[int], modes: int, apart: float, repeats: int, seed: int
) -> tuple[float, float]:
    """Return which share of the intervals, of explained variance and of distance, contain the truth [%]."""
    generator = np.random.default_rng(seed)
    groups, subjects = len(counts), sum(counts)
    labels = np.repeat(np.arange(groups), counts)
    means = apart * generator.normal(size=(groups, modes))
    means -= np.average(means, axis=0, weights=counts)
    between = (means.T * np.array(counts)) @ means / subjects
    columns = groups - 1
    root = 1.0
    if min(modes, columns) > 1:
        root = float(np.sqrt((modes**2 * columns**2 - 4) / (modes**2 + columns**2 - 5)))
    truths = 1.0 - np.linalg.det(np.eye(modes) + between) ** (-1.0 / root), np.sqrt(np.trace(between))
    inside = np.zeros(2)
    for _ in range(repeats):
        scores = generator.normal(size=(subjects, modes)) + means[labels]
        own = np.array([scores[labels == group].mean(axis=0) for group in range(groups)])
        rest, whole = scores - own[labels], scores - scores.mean(axis=0)
        within, total = rest.T @ rest, whole.T @ whole
        wilks = float(np.linalg.det(within) / np.linalg.det(total))
        lawley = float(np.trace(np.linalg.solve(within, total - within)))
        dof = subjects - groups
        inside += (
            covered(explained_variance(wilks, modes, columns, dof, subjects), truths[0]),
            covered(distance_of_several(lawley, modes, columns, dof, subjects), truths[1]),
        )
    return tuple((100.0 * inside / repeats).tolist())


def coverage_of_ratio(counts: tuple[int, int], modes: int, ratio: float, draw: Draw, repeats: int) -> float:
    """Return which share of the intervals of the ratio of two dispersions contain the truth [%]."""
    labels = np.repeat(["a", "b"], counts)
    design = group_design(labels.tolist(), ["a", "b"])
    members = {name: labels == name for name in "ab"}
    factor = np.where(labels == "b", ratio, 1.0)[:, None, None] / np.arange(1, 3 * modes + 1).reshape(-1, 3)
    inside = 0
    for _ in range(repeats):
        shapes = draw((len(labels), modes, 3)) * factor
        result = dispersion_test(shapes, design, 3 * modes, members, permutations=1)
        inside += result is not None and covered(result.effect, ratio)
    return 100.0 * inside / repeats


def coverage_of_scores(counts: tuple[int, int], auc: float, repeats: int) -> float:
    """Return which share of the intervals of the AUC of normal scores contain the truth [%]."""
    generator = np.random.default_rng(3)
    apart, second = np.sqrt(2.0) * stats.norm.ppf(auc), np.repeat([False, True], counts)
    inside = 0
    for _ in range(repeats):
        low, high = generator.normal(size=counts[0]), generator.normal(apart, size=counts[1])
        bounds = auc_bounds(float((high[:, None] > low).mean()), second)
        inside += bounds[0] <= auc <= bounds[1]
    return 100.0 * inside / repeats


def coverage_of_discriminant(counts: tuple[int, int], apart: float, repeats: int) -> tuple[float, float]:
    """Return the mean cross-validated AUC, and which share of its intervals contain that [%]."""
    generator = np.random.default_rng(4)
    second = np.repeat([False, True], counts)
    found = []
    for _ in range(repeats):
        shapes = generator.normal(size=(len(second), 4, 3)) / np.arange(1, 13).reshape(4, 3)
        shapes[second, 0, 0] += apart
        found.append(discriminant(shapes, second, 3, bootstraps=1, permutations=0).auc)
    truth = float(np.mean([item.value for item in found]))
    return truth, 100.0 * float(np.mean([covered(item, truth) for item in found]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=1000)
    repeats = parser.parse_args().repeats
    print("| groups | modes | omega squared | distance |\n|---|---|---|---|")
    for counts, modes, apart in (
        ((10, 12, 12), 4, 1.0),
        ((8, 14, 20), 5, 0.6),
        ((10, 12, 12), 2, 0.3),
        ((20, 20, 20, 20), 6, 0.5),
    ):
        share, distance = coverage_of_groups(counts, modes, apart, repeats, 1)
        print(f"| {' + '.join(map(str, counts))} | {modes} | {share:.1f} | {distance:.1f} |")
    generator = np.random.default_rng(2)
    draws: dict[str, Draw] = {
        "normal": lambda size: generator.normal(size=size),
        "exponential": lambda size: generator.exponential(size=size) - 1.0,
    }
    print("\n| groups | data | equal dispersion | doubled |\n|---|---|---|---|")
    for counts in ((4, 8), (5, 6), (8, 34), (21, 21)):
        for kind, draw in draws.items():
            cells = (coverage_of_ratio(counts, 1, ratio, draw, repeats) for ratio in (1.0, 2.0))
            print(
                f"| {' + '.join(map(str, counts))} | {kind} | {' | '.join(f'{cell:.1f}' for cell in cells)} |"
            )
    print("\n| groups | AUC of scores | coverage |\n|---|---|---|")
    for counts in ((10, 12), (8, 34)):
        for auc in (0.6, 0.8, 0.95, 0.99):
            print(
                f"| {' + '.join(map(str, counts))} | {auc} | {coverage_of_scores(counts, auc, repeats):.1f} |"
            )
    print("\n| groups | mean cross-validated AUC | coverage |\n|---|---|---|")
    for counts in ((10, 12), (8, 34)):
        for apart in (0.0, 1.5, 3.0):
            truth, inside = coverage_of_discriminant(counts, apart, repeats)
            print(f"| {' + '.join(map(str, counts))} | {truth:.2f} | {inside:.1f} |")


if __name__ == "__main__":
    main()
