"""Ellipsoids whose radii change with time, for core_set.py.

    python tests/benchmarks/ellipsoids_4d.py FOLDER [--subjects 50 --times 8 --seed 5]
    python tests/benchmarks/core_set.py OTHER --cohort FOLDER --core-set 60 --particles 64 --files-aligned

They imitate the synthetic data of J. Adams et al., "Learning spatiotemporal statistical shape models for
non-linear dynamic anatomies" (2023), whose files are not used: one radius is fixed, the second follows a
linear or a quadratic trend and the third a cycle; amplitude, phase and base radii differ between subjects.
Each mesh has vertices of its own; ``truth/`` has surfaces with corresponding vertices.
"""

import argparse
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray

_FIXED_MM = 40.0
_SPREAD = 4  # subdivisions of the icosahedron: 2562 vertices


def radii(subjects: int, times: int, seed: int) -> FloatArray:
    """Return the radii [mm] of all subjects and times, shape (subjects, times, 3), largest first."""
    random = np.random.default_rng(seed)
    at = np.linspace(0.0, 1.0, times)
    base = random.uniform([26.0, 15.0], [30.0, 18.0], (subjects, 2))
    amplitude = random.uniform([2.0, 1.0], [5.0, 3.0], (subjects, 2))
    phase = random.uniform(0.0, 0.25, (subjects, 1))
    trend = np.where(np.arange(subjects)[:, None] % 2, at, 4.0 * at * (1.0 - at))
    second = base[:, :1] + amplitude[:, :1] * trend
    third = base[:, 1:] + amplitude[:, 1:] * np.cos(2.0 * np.pi * (at + phase))
    return np.stack([np.full_like(second, _FIXED_MM), second, third], axis=-1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--subjects", type=int, default=50)
    parser.add_argument("--times", type=int, default=8)
    parser.add_argument("--seed", type=int, default=5)
    arguments = parser.parse_args()
    truth = arguments.folder / "truth"
    truth.mkdir(parents=True)
    sphere = pyvista.Icosphere(radius=1.0, nsub=_SPREAD)
    turns = Rotation.random(arguments.subjects * arguments.times, random_state=arguments.seed)
    every = radii(arguments.subjects, arguments.times, arguments.seed).reshape(-1, 3)
    for number, (axes, turn) in enumerate(zip(every, turns, strict=True)):
        subject, time = divmod(number, arguments.times)
        name = f"ellipsoid_{subject + 1:02d}_t{time + 1}"
        for folder, points in ((truth, sphere.points), (arguments.folder, turn.apply(sphere.points))):
            pyvista.PolyData.from_regular_faces(points * axes, sphere.regular_faces).save(
                folder / f"{name}.ply"
            )


if __name__ == "__main__":
    main()
