"""Files that lie otherwise than the others: how many end turned, and how many of these without a word.

    python tests/benchmarks/turned_files.py [--cases 200] [--seed 0] [PROJECT ...]

A case is a cohort of asymmetric shapes, each jittered by up to 15°, of which any number is turned in its
file: by 90 or 180° about an axis, as LPS and RAS files are against each other. Cohorts are ellipsoids with
bumps, the invented and random anatomies of `tests/anatomy`, and the groomed subjects of given projects, as
their alignments put them. Printed is a row a case: how many files are turned, how many shapes end turned
against most others, how many of these have no note, and how many other shapes have one.
"""

import argparse
import sys
import zlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))
sys.path.insert(0, str(Path(__file__).parent))

import invented as solids
import invented_anatomies
from cohort import random_cohort

from homolog.geometry import rotation_of
from homolog.grooming.cache import read_groomed
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.registration import register
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified

JITTER, TURNED = 15.0, 45.0  # degrees
INVENTED = [name for name, kind in invented_anatomies.COHORTS.items() if not kind.dirty]


def aligned(meshes) -> list[TriangleMesh]:
    """Return meshes of corresponding vertices, rotated alike."""
    arms = [np.array(mesh.vertices[::10] - mesh.vertices.mean(axis=0)) for mesh in meshes]
    turns = [Rotation.align_vectors(arms[0], own)[0].as_matrix() for own in arms]
    return [
        TriangleMesh(mesh.vertices @ turn.T, mesh.faces) for mesh, turn in zip(meshes, turns, strict=True)
    ]


def bodies(rng) -> list[TriangleMesh]:
    """Return ellipsoids with three bumps, each of its own size, of which one grows."""
    import trimesh

    sphere = trimesh.creation.icosphere(4)
    axes, faces = np.array([20.0, 13.0, 9.0]) * rng.uniform(0.9, 1.1, 3), np.array(sphere.faces, np.int32)
    places = rng.normal(size=(3, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    meshes = []
    for growth in np.linspace(2.0, 7.0, 8):
        out = np.array(sphere.vertices)
        heights = np.array([growth, 5.0, 3.0]) * np.exp(rng.normal(scale=0.1, size=3))
        bumps = np.exp(-np.square(np.linalg.norm(out[:, None] - places, axis=2) / 0.35) / 2.0) @ heights
        own = axes * np.exp(rng.normal(scale=0.04, size=3))
        meshes.append(TriangleMesh(out * own + out * bumps[:, None], faces))
    return meshes


def invented(name, rng) -> list[TriangleMesh]:
    meshes = []
    for subject, mesh in invented_anatomies.subjects(invented_anatomies.COHORTS[name], rng):
        is_left = subject.endswith("_L")
        meshes.append(
            solids.flipped(TriangleMesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces)) if is_left else mesh
        )
    return aligned(meshes)


def of_project(folder: Path) -> list[TriangleMesh]:
    project = ProjectFolder(folder)
    result = read_result(project)
    pairs = zip(result.names, result.alignments, strict=True)
    return [read_groomed(project.groomed, name).coarse_mesh.placed(pose) for name, pose in pairs]


def case(meshes, rng):
    """Return subjects whose files are turned, and the rotations of all files."""
    turned = rng.permutation(len(meshes))[: rng.integers(1, len(meshes))]
    common = rng.integers(3), np.deg2rad(rng.choice([90.0, 180.0, 180.0, 270.0]))
    subjects, rotations = [], []
    for number, mesh in enumerate(meshes):
        axis = rng.normal(size=3)
        lies = Rotation.from_rotvec(np.deg2rad(rng.uniform(0.0, JITTER)) * axis / np.linalg.norm(axis))
        if number in turned:
            lies = Rotation.from_rotvec(common[1] * np.eye(3)[common[0]]) * lies
        rotations.append(lies)
        own = TriangleMesh(mesh.vertices @ lies.as_matrix().T, mesh.faces)
        subjects.append(SimpleNamespace(name=f"s{number}", coarse_mesh=own))
    return subjects, rotations, len(turned)


def turned_against_most(alignments, rotations) -> np.ndarray:
    """Return which shapes end turned against most others."""
    lies = [
        Rotation.from_matrix(rotation_of(pose)) * own for pose, own in zip(alignments, rotations, strict=True)
    ]
    angles = np.degrees([[(one * other.inv()).magnitude() for one in lies] for other in lies])
    return angles[np.argmax((angles < TURNED).sum(axis=1))] > TURNED


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("projects", nargs="*", type=Path)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    @cache
    def of_invented(name: str) -> list[TriangleMesh]:
        rng = np.random.default_rng([options.seed, zlib.crc32(name.encode())])
        return [simplified(mesh, 1500) for mesh in invented(name, rng)]

    @cache
    def of_random(number: int) -> list[TriangleMesh]:
        return [simplified(mesh, 1500) for mesh in aligned(random_cohort(number).meshes)]

    sources: list[tuple[str, Callable]] = [
        *[(name, partial(lambda rng, name: of_invented(name), name=name)) for name in INVENTED],
        *[(f"random {k}", partial(lambda rng, k: of_random(k), k=k)) for k in range(8)],
        *[
            (folder.name, partial(lambda rng, folder: of_project(folder), folder=folder))
            for folder in options.projects
        ],
    ]
    silent_cases = 0
    print("| cohort | files turned | end turned | without a word | others named |\n|---|---|---|---|---|")
    for number in range(options.cases):
        rng = np.random.default_rng([options.seed, number])
        name, make = ("bodies", bodies) if number % 2 else sources[rng.integers(len(sources))]
        subjects, rotations, count = case(make(rng), rng)
        found = register(subjects, GroomSettings())
        ends = turned_against_most(found.alignments, rotations)
        named = np.array([note is not None for note in found.notes])
        silent_cases += bool((ends & ~named).any())
        print(
            f"| {name} | {count} | {ends.sum()} | {(ends & ~named).sum()} | {(named & ~ends).sum()} |",
            flush=True,
        )
    print(f"{silent_cases} of {options.cases} cases end with a shape turned without a word")


if __name__ == "__main__":
    main()
