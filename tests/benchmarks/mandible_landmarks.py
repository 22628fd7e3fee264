"""Expert landmarks carried between all pairs of mouse mandibles, by the correspondence and by similarity ICP.

    python tests/benchmarks/mandible_landmarks.py --particles 1024 --device cpu

A landmark goes from one mandible to another by thin plates through the particles, or as the nearest surface
point after similarity ICP. HOMOLOG_DATA names the folder of the real cohorts.
"""

import argparse
import csv
import os
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from homolog.cohort import read_cohort
from homolog.correspondence import Shape, optimize
from homolog.device import choose_device
from homolog.geometry import transform_points
from homolog.grooming import groom_cohort
from homolog.registration import align
from homolog.registration.icp import oriented_points, registered
from homolog.settings import OptimizeSettings, RunSettings
from homolog.statistics.thin_plate import landmark_errors
from homolog.surfaces.closest import closest_points

DATA = Path(os.environ.get("HOMOLOG_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
FOLDER = DATA / "zoo" / "mandible_mouse"


def expert_landmarks(names):
    """Return every mandible's landmarks in the frame of its file, (M, 17, 3)."""
    with (FOLDER / "landmarks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return np.array(
        [[[float(row[axis]) for axis in "xyz"] for row in rows if row["id"] == name] for name in names]
    )


def icp_errors(shapes, landmarks):
    """Return errors (M, M, L) of the nearest surface points after similarity ICP of every pair."""
    clouds = [oriented_points(shape.coarse_mesh) for shape in shapes]
    units = [cloud.scaled(1.0 / cloud.size) for cloud in clouds]
    snaps = [partial(closest_points, shape.mesh) for shape in shapes]
    errors = np.full((len(shapes), *landmarks.shape[:2]), np.nan)
    for i, source in enumerate(units):
        for j, target in enumerate(units):
            if i != j:
                pose = registered(source, target).pose
                here = (landmarks[i] - clouds[i].centre) / clouds[i].size
                there = transform_points(pose, here) * clouds[j].size + clouds[j].centre
                errors[i, j] = np.linalg.norm(snaps[j](there) - landmarks[j], axis=1)
    return errors


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--particles", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--icp", action="store_true", help="also print what similarity ICP reaches")
    arguments = parser.parse_args()
    settings = RunSettings(optimize=OptimizeSettings(particles=arguments.particles, seed=arguments.seed))
    groomed = groom_cohort(read_cohort(FOLDER / "labels"), settings.groom)
    alignments = align(groomed, settings.groom)
    shapes = [
        Shape(item.name, item.field, item.mesh, item.coarse_mesh, alignment)
        for item, alignment in zip(groomed, alignments, strict=True)
    ]
    landmarks = expert_landmarks([shape.name for shape in shapes])
    if arguments.icp:
        print(
            f"similarity ICP, nearest points: {np.nanmean(icp_errors(shapes, landmarks)):.4f} mm", flush=True
        )
    start = time.perf_counter()
    result = optimize(shapes, settings.placing, device=choose_device(arguments.device))
    errors = landmark_errors(
        result.local, landmarks, [partial(closest_points, shape.mesh) for shape in shapes]
    )
    print(
        f"{arguments.particles} particles, seed {arguments.seed}: {np.nanmean(errors):.4f} mm, by landmark "
        f"{np.round(np.nanmean(errors, axis=(0, 1)), 3).tolist()}; {result.iterations} iterations, "
        f"{result.reason.value}, {time.perf_counter() - start:.0f} s"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
