"""How near left-out controls' particles come to their places in the joint run.

    python tests/benchmarks/patient_fit.py PROJECT [--every 1]

Each control (or every second, third …) is fitted to the model of all others: the fitted surface alone, then
particles placed by the run's objective, as `homolog patient` does. Prints a table in Markdown.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from homolog.files.project import ProjectFolder
from homolog.files.results import read_result
from homolog.patient.build import _modes
from homolog.patient.controls import COARSE_VERTICES, read_controls
from homolog.patient.fit import fit_surface
from homolog.patient.left_out import _placed
from homolog.patient.surface_model import SurfaceModel
from homolog.progress import no_tick
from homolog.surfaces.simplify import simplified

NEAR = 0.3  # spacings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("project", type=Path)
    parser.add_argument("--every", type=int, default=1)
    arguments = parser.parse_args()
    project = ProjectFolder(arguments.project)
    result = read_result(project)
    controls = read_controls(project, result, range(len(result.names)))
    columns = np.zeros((len(result.names), 0))
    _, fitted = _modes(controls, columns, no_tick)
    errors: dict[str, list[np.ndarray]] = {}
    for index in range(0, len(result.names), arguments.every):
        others = np.arange(len(result.names)) != index
        model = SurfaceModel.fit(controls.points[others], columns[others], fitted, controls.surface.faces)
        mesh = controls.meshes[index]
        fit = fit_surface(model, mesh, simplified(mesh, COARSE_VERTICES), columns[index])
        left_out = _placed(controls, index)
        if left_out is None:
            sys.exit(f"{arguments.project}: its groomed fields are missing; run it again")
        placing, shape, turn = left_out
        ways = {"fitted surface alone": fit.particles, "placed": placing.placed(shape, fit, turn)}
        spacing = np.sqrt(mesh.area / len(fit.particles))
        for way, particles in ways.items():
            apart = np.linalg.norm(particles - controls.particles[index], axis=1) / spacing
            errors.setdefault(way, []).append(apart)
        print(result.names[index], file=sys.stderr, flush=True)
    print(f"| particles | within {NEAR} spacings (%) | 95 % within (spacings) |")
    print("|---|---|---|")
    for way, parts in errors.items():
        apart = np.concatenate(parts)
        print(f"| {way} | {100.0 * (apart < NEAR).mean():.1f} | {np.quantile(apart, 0.95):.2f} |")


if __name__ == "__main__":
    main()
