"""How near to the surface, how even and how well spread the particles of fitted shapes are.

    python tests/benchmarks/fitted_spleens.py [FOLDER] [--particles 1024]

FOLDER contains meshes or segmentations (by default the four test spleens of Point2SSM++ in the folder that
HOMOLOG_DATA names). Each shape is left out: the others are optimized jointly, and it is fitted to their
ensemble, as `homolog patient` places particles. Prints a table in Markdown: mean distance of the particles
from the groomed surface; standard deviation over mean of the distance to the nearest other particle; largest
distance of a vertex of the groomed surface from the nearest particle; processor seconds of the fit.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.cohort import read_cohort
from homolog.correspondence import Shape, optimize
from homolog.correspondence.launcher import load_kernels
from homolog.correspondence.shape_fit import first_particles, fit_shape_from, nearest_template
from homolog.grooming import groom_cohort
from homolog.registration import align_cohort
from homolog.run.core_set import first_placement, joint_ensemble
from homolog.settings import OptimizeSettings, RunSettings
from homolog.surfaces.closest import distances_to


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", default=Path(os.environ.get("HOMOLOG_DATA", "."), "zoo", "spleen")
    )
    parser.add_argument("--particles", type=int, default=1024)
    arguments = parser.parse_args()
    load_kernels("cpu")
    cohort = read_cohort(arguments.folder)
    settings = RunSettings(optimize=OptimizeSettings(particles=arguments.particles))
    subjects, alignments = align_cohort(cohort, groom_cohort(cohort, settings.groom), settings.groom)
    shapes = [
        Shape(item.name, item.field, item.mesh, item.coarse_mesh, alignment)
        for item, alignment in zip(subjects, alignments, strict=True)
    ]
    print("| shape | from the surface (mm) | spacing varies by | farthest vertex (mm) | fit s |")
    print("|---|---|---|---|---|")
    rows = []
    for shape in shapes:
        joint = [other for other in shapes if other is not shape]
        rows.append(measured(shape, joint, settings.placing))
        print(line(shape.name, rows[-1]), flush=True)
    print(line("mean", np.mean(rows, axis=0)))


def line(name: str, row: np.ndarray) -> str:
    return f"| {name} | {row[0]:.4f} | {row[1]:.3f} | {row[2]:.2f} | {row[3]:.1f} |"


def measured(shape: Shape, others: list[Shape], settings: OptimizeSettings) -> np.ndarray:
    """Return the table's figures of a shape that is fitted to others."""
    result = optimize(others, settings)
    placed = [replace(item, alignment=a) for item, a in zip(others, result.alignments, strict=True)]
    _, ensemble = joint_ensemble(placed, result.local, settings)
    begun = time.process_time()
    aligned = replace(shape, alignment=first_placement(shape, ensemble, settings))
    nearest = nearest_template(ensemble, aligned)
    template = replace(placed[nearest], alignment=ensemble.placements[nearest])
    start = first_particles(ensemble, nearest, template, aligned)
    local = fit_shape_from(aligned, settings, ensemble, [start]).local
    seconds = time.process_time() - begun
    apart = distances_to(shape.mesh, local)
    gaps = KDTree(local).query(local, k=2)[0][:, 1]
    farthest = KDTree(local).query(shape.mesh.vertices)[0].max()
    return np.array([apart.mean(), gaps.std() / gaps.mean(), farthest, seconds])


if __name__ == "__main__":
    main()
