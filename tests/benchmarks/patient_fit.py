"""How near left-out controls' particles come to their places in the joint run.

    python tests/benchmarks/patient_fit.py PROJECT [--every 1] [--objective]

Each control (or every second, third …) is fitted to the model of all others: the fitted surface alone, then
particles placed by the run's objective, as `homolog patient` does. Prints a table in Markdown.

`--objective` tells whether the search or the objective is at fault: 200 further iterations, with the weights
of the run, begin with the fitted particles and with those of the joint run; it prints the objective where
they end, and how many of the latter stay in place.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from homolog.correspondence import Shape
from homolog.correspondence.shape_fit import _FitLoop, _prepared, _stages
from homolog.correspondence.types import InitialParticles
from homolog.geometry import fit_similarity, inverse_matrices, transform_points
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.patient.build import _modes
from homolog.patient.controls import COARSE_VERTICES, read_controls
from homolog.patient.fit import fit_surface
from homolog.patient.left_out import _placed
from homolog.patient.placed import Placing
from homolog.patient.surface_model import SurfaceModel
from homolog.progress import no_tick
from homolog.run.core_set import first_placement
from homolog.surfaces.simplify import simplified

NEAR, ITERATIONS = 0.3, 200  # spacings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("project", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--objective", action="store_true")
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
        line = f"{result.names[index]}: {100.0 * (apart < NEAR).mean():.1f} % in place"
        if arguments.objective:
            joint = controls.particles[index]
            value, _ = followed(*left_out, ways["placed"])
            other, ended = followed(*left_out, joint)
            stay = np.linalg.norm(ended - joint, axis=1) < NEAR * spacing
            line += f", objective {value:.3f}; from the joint run {other:.3f}, {100.0 * stay.mean():.1f} %"
        print(line, file=sys.stderr, flush=True)
    print(f"| particles | within {NEAR} spacings (%) | 95 % within (spacings) |")
    print("|---|---|---|")
    for way, parts in errors.items():
        apart = np.concatenate(parts)
        print(f"| {way} | {100.0 * (apart < NEAR).mean():.1f} | {np.quantile(apart, 0.95):.2f} |")


def followed(placing: Placing, shape: Shape, turn: np.ndarray, particles: np.ndarray):
    """Return the objective after iterations that begin with some particles, and where these end."""
    ensemble, settings = placing.ensemble, placing.settings
    pose = fit_similarity(particles, float(ensemble.unit[0]) * ensemble.mean, scaling=False) @ turn
    shape = replace(shape, alignment=pose)
    shape = replace(shape, alignment=first_placement(shape, ensemble, settings))
    unit, opening = float(ensemble.unit[0]), float(ensemble.opening_scale[0])
    cohort, side = _prepared(shape, settings, len(particles), unit, opening, free=True)
    start = InitialParticles(transform_points(side @ inverse_matrices(turn), particles)[None])
    last = _stages(settings, len(particles), ITERATIONS)[1]
    plan = replace(last, iterations=ITERATIONS)
    loop = _FitLoop(ensemble, cohort, settings, [plan], [start], False, False, no_tick)
    try:
        loop.run(None)
        parts = loop.engine.energy() @ plan.factors
        return parts, transform_points(turn, loop.state(shape.alignment, side).local)
    finally:
        loop.launcher.close()


if __name__ == "__main__":
    main()
