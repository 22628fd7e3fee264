"""What accurate geodesic distances buy: the same studies with distances of several orders, all else equal.

    python tests/benchmarks/geodesic_orders.py groom FOLDER                  groom the cohorts once, as npz
    python tests/benchmarks/geodesic_orders.py run FOLDER --out RUNS.jsonl   a line of JSON a run, as they end
    python tests/benchmarks/geodesic_orders.py table RUNS.jsonl              medians over seeds, side by side

The first two take --cohorts, the second also --distances, --particles, --seeds and --device; a run whose line
is in the file is not repeated. Distances are *circular* (virtual sources, the default), *straight*
(Euclidean) and *exact* (polyhedral, by tvb-gdist: about a minute for each mesh). Commit 320e32c also has
*planar* ones (fronts of the paper), a065c72 *second-order* ones.
"""

import argparse
import itertools
import json
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import mandible_landmarks
import numpy as np
import warp as wp
from optimizer import DATA, expert_landmarks, load, make_beans, opposed, save
from ventricle_walls import wall_swaps

sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

from cohort import carried

from homolog.beans.evaluate import evaluate
from homolog.beans.generate import NARROW, WIDE, draw_beans
from homolog.cohort import read_cohort
from homolog.correspondence import load_kernels, optimize
from homolog.device import choose_device
from homolog.geodesics import solve_tables
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.table import ARRAYS
from homolog.inspection import inspect
from homolog.io.meshes import read_mesh
from homolog.settings import GroomSettings, Method, OptimizeSettings, RunSettings
from homolog.statistics.thin_plate import landmark_errors
from homolog.surfaces.closest import closest_points

BEANS = {f"wide{seed}": (WIDE, seed) for seed in (1, 2, 3, 5, 12)} | {"narrow5": (NARROW, 5)}
REAL = {
    "vertebrae": "vertebra_l1_verse/meshes",
    "ventricles": "lv_acdc_dev/myo_iso",
    "femora": "zoo/limb_femur",
    "hips": "zoo/limb_hip",
    "scapulae": "zoo/scapula",
    "mandibles": "zoo/mandible_mouse/labels",
    "amygdalae": "zoo/brain_amygdala",
    "hippocampi": "zoo/brain_hippocampus",
}
DENSE = ("femora", "hips", "scapulae")  # vertices of the files correspond
DISTANCES = ("straight", "circular", "exact")
KEYS = ("cohort", "distances", "particles", "seed")


class TimedSolver:
    """Solves geodesic tables and counts the seconds."""

    def __init__(self, exact):
        self.seconds, self.exact = 0.0, exact

    def __call__(self, meshes, d_max, **options):
        begin = time.perf_counter()
        tables = solve_tables(meshes, d_max, **options)
        wp.synchronize()
        if self.exact:
            tables = [exact_table(mesh, table) for mesh, table in zip(meshes, tables, strict=True)]
        self.seconds += time.perf_counter() - begin
        return tables


SOLVED = {}  # exact codes, by mesh and longest distance


def exact_table(mesh, table):
    """Return a table with exact distances of the same pairs."""
    key = (mesh.vertices.tobytes(), table.d_max)
    if key not in SOLVED:
        SOLVED[key] = exact_codes(mesh, table)
    return replace(table, codes=wp.array(SOLVED[key], dtype=wp.uint16, ndim=2, device=table.device))


def exact_codes(mesh, table):
    """Return the codes of a table whose distances are exact."""
    import gdist

    limit = 1.05 * table.d_max if np.isfinite(table.d_max) else 1e100
    exact = gdist.local_gdist_matrix(mesh.vertices, mesh.faces.astype(np.int32), max_distance=limit).tocsr()
    codes, row, start, slot = (getattr(table, name).numpy() for name in ARRAYS)
    codes = codes.copy()
    for v in range(table.n_vertices):
        cluster, lane = divmod(slot[v], LANES)
        reached = np.flatnonzero(row[cluster] != MISSING)
        rows = start[cluster] + row[cluster, reached].astype(np.int64)
        present = codes[rows, lane] != MISSING
        distances = exact[[v]].toarray()[0, reached[present]]
        codes[rows[present], lane] = np.rint(distances / table.unit)
    return codes


def groom(folder, name):
    """Store a cohort's groomed shapes unless they are there."""
    path = folder / f"{name}.npz"
    if not path.exists():
        if name in BEANS:
            make_beans(folder, *BEANS[name])
        else:
            save(path, read_cohort(DATA / REAL[name]), GroomSettings())


def run(name, shapes, distances, particles, seed, device):
    """Return the figures of one run."""
    method = Method.NORMALS if distances == "straight" else Method.GEODESIC_NORMALS
    grooming = GroomSettings(alignment="none") if name in BEANS else GroomSettings()
    chosen = OptimizeSettings(particles=particles, seed=seed, method=method)
    solve = TimedSolver(distances == "exact")
    begin = time.perf_counter()
    settings = RunSettings(groom=grooming, optimize=chosen).placing
    result = optimize(shapes, settings, device=device, solve=solve)
    seconds = time.perf_counter() - begin
    figures = {
        "objective": float(result.energies[-1, 1:].sum()),
        "iterations": result.iterations,
        "repaired": int((result.repaired > 0).sum()),
        "table s": solve.seconds,
        "whole s": seconds,
        "opposed %": opposed(result.normals),
    }
    kinds = [
        suspect.kind.value
        for suspect in inspect(
            result.local, [s.mesh for s in shapes], result.alignments, names=[s.name for s in shapes]
        ).suspects
    ]
    figures["exchanged"] = kinds.count("exchanged particles")
    return figures | errors(name, shapes, result)


def errors(name, shapes, result):
    """Return how far a run is from what is known of its cohort."""
    if name in BEANS:
        geometry, seed = BEANS[name]
        metrics = evaluate(result.local, draw_beans(10, seed, geometry))
        return {
            "linear %": 100.0 * metrics.ground_truth_r2,
            "R2 width": metrics.r2_width,
            "slot": metrics.slot_fill,
            "swapped %": 100.0 * metrics.wall_swap,
        }
    if name in ("vertebrae", "mandibles"):
        names = [shape.name for shape in shapes]
        of_mandibles = mandible_landmarks.expert_landmarks
        landmarks = expert_landmarks(shapes) if name == "vertebrae" else of_mandibles(names)
        missed = landmark_errors(
            result.local, landmarks, [partial(closest_points, shape.mesh) for shape in shapes]
        )
        return {"landmark mm": float(np.nanmean(missed))}
    if name == "ventricles":
        return {"on both walls": wall_swaps(shapes, result)[1]}
    if name in DENSE:
        missed = dense_errors(name, shapes, result.local)
        return {"dense mm": missed.mean(), "dense 95 % mm": np.percentile(missed, 95)}
    return {}


def dense_errors(name, shapes, particles):
    """Distances [mm] of particles carried by the files' vertices from those of the same number."""
    paths = {path.stem: path for path in (DATA / REAL[name]).iterdir()}
    meshes = [read_mesh(paths[shape.name]) for shape in shapes]
    carried_to = [carried(meshes, k, points) for k, points in enumerate(particles)]
    missed = [np.linalg.norm(points - particles, axis=2) for points in carried_to]
    return np.concatenate([np.delete(item, k, axis=0).ravel() for k, item in enumerate(missed)])


def print_table(path):
    """Print medians over the seeds of each study and figure, the distances side by side."""
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    columns = [name for name in DISTANCES if any(row["distances"] == name for row in rows)]
    print(f"| cohort | particles | figure | {' | '.join(columns)} |\n|{'---|' * (3 + len(columns))}")
    for study in dict.fromkeys((row["cohort"], row["particles"]) for row in rows):
        here = [row for row in rows if (row["cohort"], row["particles"]) == study]
        for figure in dict.fromkeys(key for row in here for key in row if key not in KEYS):
            cells = []
            for name in columns:
                values = [row[figure] for row in here if row["distances"] == name]
                spread = f" ({min(values):.5g}-{max(values):.5g})" if len(values) > 1 else ""
                cells.append(f"{np.median(values):.5g}{spread}" if values else "")
            print(f"| {study[0]} | {study[1]} | {figure} | {' | '.join(cells)} |")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["groom", "run", "table"])
    parser.add_argument("path", type=Path)
    parser.add_argument("--cohorts", nargs="+", choices=[*BEANS, *REAL], default=[*BEANS, *REAL])
    parser.add_argument("--distances", nargs="+", choices=DISTANCES, default=["circular"])
    parser.add_argument("--particles", nargs="+", type=int, default=[256, 1024])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--device", default="auto")
    parser.add_argument("--out", type=Path, default=Path("geodesic_orders.jsonl"))
    options = parser.parse_args()
    if options.what == "table":
        print_table(options.path)
        return
    options.path.mkdir(parents=True, exist_ok=True)
    if options.what == "groom":
        for name in options.cohorts:
            groom(options.path, name)
        return
    device = choose_device(options.device)
    load_kernels(device)
    rows = map(json.loads, options.out.read_text().splitlines() if options.out.exists() else [])
    done = {tuple(row[key] for key in KEYS) for row in rows}
    for name in options.cohorts:
        groom(options.path, name)
        shapes = load(options.path / f"{name}.npz")
        for particles, seed, distances in itertools.product(
            options.particles, options.seeds, options.distances
        ):
            study = (name, distances, particles, seed)
            if study in done:
                continue
            row = dict(zip(KEYS, study, strict=True))
            row |= run(name, shapes, distances, particles, seed, device)
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
