"""Which bumps and thinned walls homolog patient finds on real shapes, by size and number of controls.

    python tests/benchmarks/patient_lesions.py PROJECT [--group VALUE] [--controls 10 20 33] [--draws 5]
        [--lesions 1] [--jobs 1]

Each subject of PROJECT is fitted to the model of all others, as it is and with one lesion at a time: a
Gaussian bump on a random place of the outer side (height, full width at half maximum), or a wall that is
thinned from the inside (share of its thickness, width); `--lesions` of each kind. Norm and limit come from
the healthy maps of controls drawn from the others. A lesion is found if a place beyond the limit lies within
half its width (at least 4 mm) of its centre. Prints a table in Markdown.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy import stats

from homolog.geometry import inverse_matrices, transform_points
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.patient.build import _modes
from homolog.patient.controls import COARSE_VERTICES, Controls, read_controls
from homolog.patient.fit import fit_surface
from homolog.patient.local import bands_of, norm_and_maxima, prediction_limit, scores_of
from homolog.patient.surface_model import SurfaceModel
from homolog.patient.wall import local_maps
from homolog.progress import no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.surfaces.walls import wall_thickness

Lesion = tuple[str, float, float]
LESIONS = [
    *(("bump", height, width) for height in (5.0, 8.0, 10.0) for width in (10.0, 20.0)),
    *(("thinned", 0.4, width) for width in (15.0, 20.0, 25.0)),
]


@dataclass(frozen=True)
class Tried:
    """A lesion of a subject: its maps (2, V), and the vertices (V,) where it counts as found."""

    subject: int
    lesion: Lesion
    maps: np.ndarray
    near: np.ndarray


def with_lesion(
    mesh: TriangleMesh, kind: str, size: float, width: float, random: np.random.Generator
) -> tuple[TriangleMesh, np.ndarray]:
    """Return a surface with a lesion at a random place, and its centre."""
    normals = mesh.vertex_normals
    way = mesh.vertices - mesh.vertices.mean(axis=0)
    outward = np.einsum("vi,vi->v", normals, way) / np.linalg.norm(way, axis=1)
    centre = int(random.choice(np.flatnonzero(outward > 0.5 if kind == "bump" else outward < -0.5)))
    gaps = np.linalg.norm(mesh.vertices - mesh.vertices[centre], axis=1)
    same_side = normals @ normals[centre] > 0.0
    if kind == "bump":
        move = size * np.exp(-4.0 * np.log(2.0) * np.square(gaps / width))
    else:  # full over the middle 70 % of the width, none beyond 130 %
        phase = np.clip((gaps - 0.35 * width) / (0.3 * width), 0.0, 1.0)
        move = -size * np.nan_to_num(wall_thickness(mesh)) * (0.5 + 0.5 * np.cos(np.pi * phase))
    vertices = mesh.vertices + (move * same_side)[:, None] * normals
    return TriangleMesh(vertices, mesh.faces), vertices[centre]


def fitted_one(
    controls: Controls, columns: np.ndarray, modes: int, index: int, lesions: int, seed: int
) -> tuple[np.ndarray, list[Tried]]:
    """Return the maps of a subject (2, V) by the model of all others, and those of its lesions."""
    random, none = np.random.default_rng([seed, index]), np.zeros(0)
    others, mesh = np.arange(len(controls.names)) != index, controls.meshes[index]
    model = SurfaceModel.fit(controls.points[others], columns[others], modes, controls.surface.faces)
    fit = fit_surface(model, mesh, simplified(mesh, COARSE_VERTICES), none)
    tried = []
    for kind, size, width in LESIONS * lesions:
        changed, centre = with_lesion(mesh, kind, size, width, random)
        own = fit_surface(model, changed, simplified(changed, COARSE_VERTICES), none, pose=fit.pose)
        normals = model.surface(own.expected).vertex_normals
        places = own.expected[: model.vertices] + own.residual[:, None] * normals
        gaps = np.linalg.norm(transform_points(inverse_matrices(own.pose), places) - centre, axis=1)
        maps = local_maps(model, own, changed)
        tried.append(Tried(index, (kind, size, width), maps, gaps < max(0.5 * width, 4.0)))
    print(f"{controls.names[index]} of {len(controls.names)}", file=sys.stderr, flush=True)
    return local_maps(model, fit, mesh), tried


def fitted(controls: Controls, lesions: int, seed: int, jobs: int) -> tuple[np.ndarray, list[Tried]]:
    """Return the maps of all subjects (2, M, V), each left out, and those of their lesions."""
    columns = np.zeros((len(controls.names), 0))
    modes = _modes(controls, columns, no_tick)[1]
    own = replace(controls, jointly=None, later={})
    tasks = [(own, columns, modes, index, lesions, seed) for index in range(len(controls.names))]
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        healthy, tried = zip(*pool.map(fitted_one, *zip(*tasks, strict=True)), strict=True)
    return np.stack(healthy, axis=1), [item for items in tried for item in items]


def report(
    healthy: np.ndarray, tried: list[Tried], faces: np.ndarray, controls: int, draws: int
) -> dict[Lesion, list[bool]]:
    """Return which lesions are found with a number of controls; print how many subjects are flagged."""
    count, random = healthy.shape[1], np.random.default_rng(controls)
    bands = bands_of(healthy, faces)
    changed = [bands_of(item.maps, faces) for item in tried]
    sets = [random.permutation(count)[:controls] for _ in range(draws)]
    if controls == count - 1:
        sets = [np.delete(np.arange(count), index) for index in range(count)]
    flagged: list[bool] = []
    found: dict[Lesion, list[bool]] = {lesion: [] for lesion in LESIONS}
    for own in sets:
        norm, maxima = norm_and_maxima(healthy[:, own], bands[:, :, own])
        usual, limit = healthy[:, own].mean(axis=1), prediction_limit(maxima)
        left = np.setdiff1d(np.arange(count), own).tolist()
        for index in left:
            z = scores_of(norm, healthy[:, index], usual, bands[:, :, index])
            flagged.append(bool(np.abs(z).max() > limit))
        for item, filtered in zip(tried, changed, strict=True):
            if item.subject in left:
                z = scores_of(norm, item.maps, usual, filtered)
                found[item.lesion].append(bool(np.abs(z[item.near]).max(initial=0.0) > limit))
    ends = stats.beta.interval(0.95, sum(flagged) + 0.5, len(flagged) - sum(flagged) + 0.5)
    low, high = 100.0 * np.array(ends)
    print(
        f"{controls} controls: {sum(flagged)} of {len(flagged)} healthy subjects flagged "
        f"({100.0 * np.mean(flagged):.0f} %, {low:.0f} to {high:.0f})"
    )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("project", type=Path)
    parser.add_argument("--group")
    parser.add_argument("--controls", type=int, nargs="+", default=[10, 20, 33])
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--lesions", type=int, default=1, help="of each kind, in each subject")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    project = ProjectFolder(arguments.project)
    result = read_result(project)
    chosen = [i for i, group in enumerate(result.groups) if arguments.group in (None, group)]
    controls = read_controls(project, result, chosen)
    healthy, tried = fitted(controls, arguments.lesions, arguments.seed, arguments.jobs)
    numbers = [number for number in arguments.controls if number < len(chosen)] or [len(chosen) - 1]
    table = [report(healthy, tried, controls.surface.faces, number, arguments.draws) for number in numbers]
    heads = [f"found with {number} controls (%)" for number in numbers]
    print(f"\n| lesion | width (mm) | {' | '.join(heads)} |\n|---|---|{'---|' * len(numbers)}")
    for lesion in LESIONS:
        kind, amount, width = lesion
        name = f"bump of {amount:.0f} mm" if kind == "bump" else f"wall thinned by {100.0 * amount:.0f} %"
        rates = " | ".join(f"{100.0 * np.mean(found[lesion]):.0f}" for found in table)
        print(f"| {name} | {width:.0f} | {rates} |")


if __name__ == "__main__":
    main()
