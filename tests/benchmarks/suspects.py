"""How many planted faults the inspection finds, and how many suspects a good result has.

    python tests/benchmarks/suspects.py PROJECT [PROJECT ...] [--repeats 20] [--seed 0]

Each project needs a result. Its own suspects count as false alarms, though some are true. Then faults are
planted one at a time, each on a subject drawn at random, and the list is made again:

swap        two particles drawn at random are exchanged;
neighbours  two neighbours are exchanged;
shift       a particle is put three spacings away;
wall        eight neighbours are put onto the opposite wall (of the thinnest places only);
hole        all particles within two spacings of a place are put onto its rim.

A fault is found if a suspect that the project did not have names one of its particles on its subject; it is
`first` if that heads the list. Precision is the share of new suspects on the fault's particles or within two
rings of neighbours.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import FloatArray, IntArray
from homolog.geodesics import distances_from
from homolog.inspection import Inspection, assess, inspect, locate_particles
from homolog.io.meshes import read_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, surface_file

Plant = Callable[[Inspection, int, np.random.Generator], tuple[FloatArray, IntArray]]


def main() -> None:
    """Print a table for each project."""
    parser = argparse.ArgumentParser()
    parser.add_argument("projects", type=Path, nargs="+")
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for folder in arguments.projects:
        project = ProjectFolder(folder)
        result, record = read_result(project), project.read().result
        meshes = [read_mesh(surface_file(project, subject.file)) for subject in record.subjects]
        began, cpu = time.perf_counter(), time.process_time()
        actual = inspect(result.local, meshes, result.alignments, names=result.names)
        spent = f"{time.perf_counter() - began:.1f} s, {time.process_time() - cpu:.1f} CPU s"
        print(f"{folder}: {len(meshes)} x {result.local.shape[1]}, {spent}, {len(actual.suspects)} suspects")
        for name, plant in PLANTS.items():
            random = np.random.default_rng(arguments.seed)
            rows = np.array([_trial(actual, plant, random) for _ in range(arguments.repeats)])
            recall, first, right, new = rows.sum(axis=0)
            print(
                f"  {name:<11} found {recall:.0f} of {len(rows)}, first {first:.0f}, "
                f"precision {right / max(new, 1):.2f} ({right:.0f} of {new:.0f})"
            )
            sys.stdout.flush()


def _trial(before: Inspection, plant: Plant, random: np.random.Generator) -> tuple[bool, bool, int, int]:
    places = before.located
    m = int(random.integers(len(places.meshes)))
    points, moved = plant(before, m, random)
    single = locate_particles(
        points[None], places.meshes[m : m + 1], places.alignments[m : m + 1], names=["planted"]
    )
    after = assess(places.with_subject(m, single))
    known = {(s.kind, s.subject, tuple(s.particles)) for s in before.suspects}
    new = [s for s in after.suspects if (s.kind, s.subject, tuple(s.particles)) not in known]
    exact = [s for s in new if s.subject == m and np.isin(s.particles, moved).any()]
    near = before.consensus.ring(before.consensus.ring(moved))
    right = [s for s in new if s.subject == m and np.isin(s.particles, near).any()]
    first = bool(exact) and after.suspects[0] in exact
    return bool(exact), first, len(right), len(new)


def _swap(result: Inspection, m: int, random: np.random.Generator) -> tuple[FloatArray, IntArray]:
    pair = random.choice(result.located.local.shape[1], 2, replace=False)
    return _exchanged(result, m, pair)


def _neighbours(result: Inspection, m: int, random: np.random.Generator) -> tuple[FloatArray, IntArray]:
    i = int(random.integers(result.located.local.shape[1]))
    return _exchanged(result, m, np.array([i, random.choice(result.consensus.neighbours[i, :5])]))


def _exchanged(result: Inspection, m: int, pair: IntArray) -> tuple[FloatArray, IntArray]:
    points = result.located.local[m].copy()
    points[pair] = points[pair[::-1]]
    return points, pair


def _shift(result: Inspection, m: int, random: np.random.Generator) -> tuple[FloatArray, IntArray]:
    points, mesh, spacing = (
        result.located.local[m].copy(),
        result.located.meshes[m],
        result.located.spacing[m],
    )
    i = int(random.integers(len(points)))
    away = _distances(result, m, i)
    points[i] = mesh.vertices[random.choice(np.flatnonzero(np.abs(away - 3.0 * spacing) < 0.5 * spacing))]
    return points, np.array([i])


def _wall(result: Inspection, m: int, random: np.random.Generator) -> tuple[FloatArray, IntArray]:
    points, mesh = result.located.local[m].copy(), result.located.meshes[m]
    own = np.linalg.inv(result.located.alignments[m, :3, :3]) @ result.located.normals[m].T
    normals = (own / np.linalg.norm(own, axis=0)).T
    far = 1.0 * np.ptp(mesh.vertices)  # of a normal that is not opposite, so that the nearest is one that is
    tree = cKDTree(np.hstack([mesh.vertices, far * mesh.vertex_normals]))
    opposite = mesh.vertices[tree.query(np.hstack([points, -far * normals]))[1]]
    thickness = np.linalg.norm(opposite - points, axis=1)
    seed = random.choice(np.argsort(thickness)[: max(8, len(points) // 10)])
    patch = np.concatenate([[seed], result.consensus.neighbours[seed, :7]])
    points[patch] = opposite[patch]
    return points, patch


def _hole(result: Inspection, m: int, random: np.random.Generator) -> tuple[FloatArray, IntArray]:
    points, mesh, spacing = (
        result.located.local[m].copy(),
        result.located.meshes[m],
        result.located.spacing[m],
    )
    away = _distances(result, m, int(random.integers(len(points))))
    corners = mesh.faces[result.located.faces[m]]
    inside = np.flatnonzero(away[corners].min(axis=1) < 2.0 * spacing)
    rim = np.flatnonzero(np.abs(away - 2.2 * spacing) < 0.3 * spacing)
    nearest = cKDTree(mesh.vertices[rim]).query(points[inside])[1]
    points[inside] = mesh.vertices[rim[nearest]]
    near = np.flatnonzero(away[corners].min(axis=1) < 3.5 * spacing)
    return points, near


def _distances(result: Inspection, m: int, particle: int) -> FloatArray:
    mesh = result.located.meshes[m]
    return distances_from(mesh, [int(mesh.faces[result.located.faces[m, particle], 0])]).astype(np.float64)


PLANTS: dict[str, Plant] = {
    "swap": _swap,
    "neighbours": _neighbours,
    "shift": _shift,
    "wall": _wall,
    "hole": _hole,
}


if __name__ == "__main__":
    main()
