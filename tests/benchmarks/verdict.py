"""Verdicts on permuted and on sound cohorts: ``python tests/benchmarks/verdict.py PROJECT … [--draws 100]``.

Each draw takes a random half or more of the subjects (five at least) and a random two thirds or more of the
particles. It is judged as it is, and after each of three permutations: particles of each subject in any
order; each exchanged with a random neighbour; each permuted among the subjects. The table counts the words.
Draws differ in seed, so that limits are tried on cohorts that they were not computed from.
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.inspection import Word, judge, read_verdict
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result


def drawn(world: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Return some subjects and particles."""
    subjects, particles = world.shape[:2]
    count = generator.integers(min(subjects, max(5, -(-subjects // 2))), subjects + 1)
    number = generator.integers(-(-2 * particles // 3), particles + 1)
    chosen = generator.choice(subjects, count, replace=False)
    return world[chosen][:, generator.choice(particles, number, replace=False)]


def in_any_order(shapes: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Permute the particles of each subject."""
    return np.array([own[generator.permutation(len(own))] for own in shapes])


def exchanged(shapes: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Exchange each particle with one of its six neighbours or itself, on each subject."""
    result = []
    for own in shapes:
        near, order = KDTree(own).query(own, 7)[1], np.arange(len(own))
        for index in generator.permutation(len(own)):
            other = generator.choice(near[index])
            order[[index, other]] = order[[other, index]]
        result.append(own[order])
    return np.array(result)


def among_subjects(shapes: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Permute each particle among the subjects."""
    order = generator.permuted(np.tile(np.arange(len(shapes)), (shapes.shape[1], 1)), axis=1).T
    return np.take_along_axis(shapes, order[..., None], axis=0)


KINDS = {
    "as it is": lambda shapes, _: shapes,
    "any order": in_any_order,
    "neighbours": exchanged,
    "subjects": among_subjects,
}


def main() -> None:
    """Print the words of all projects and draws."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("projects", nargs="+", type=Path)
    parser.add_argument("--draws", type=int, default=100, help="draws of each kind and project")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for path in arguments.projects:
        project = ProjectFolder(path)
        world = read_result(project).world
        print(f"{path.name}: {world.shape[0]} x {world.shape[1]}\n  {read_verdict(project, world).line}")
        for kind, permuted in KINDS.items():
            words = Counter[str]()
            for draw in range(arguments.draws):
                generator = np.random.default_rng((arguments.seed, draw))
                words[judge(permuted(drawn(world, generator), generator), seed=draw).word] += 1
            print(f"  {kind:<11}", ", ".join(f"{words[word]} {word}" for word in Word), flush=True)


if __name__ == "__main__":
    main()
