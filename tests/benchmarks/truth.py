"""Errors of correspondence against known truth: nearest points, the start, and the result.

    python tests/benchmarks/truth.py --folder GROOMED [--cohorts skulls …] [--particles 64 128 512 1024]
                                     [--seeds 0 1 2] [--device cpu] [--rows FILE] [--invented]

With --invented, cohorts are those of `invented_anatomies.py` whose files are clean. Cohorts are groomed
once, into GROOMED.
HOMOLOG_DATA names the folder of the real cohorts.

Landmarks of experts are carried between all pairs of subjects by thin plates through the 64 nearest
particles, and put on the nearest point of the surface. Where all meshes of a cohort have the same faces, a
particle's true place on another subject is the same point of the same face. *Nearest
points* are those with agreeing normals, in the poses and at the size in which the program compares the
shapes; *start* is what registration gives, and *expected* the error that the model's verdict names.
Errors are means over all pairs [mm], *span* those of the seeds. One line of JSON a run is added to --rows.
"""

import argparse
import csv
import json
import os
import pickle
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import invented_anatomies
import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from homolog.correspondence import Shape, optimize
from homolog.correspondence.surface_sets import normalize_size
from homolog.device import choose_device
from homolog.geometry import inverse_matrices, transform_points
from homolog.inspection.verdict import judge
from homolog.samples.evaluate import place_errors
from homolog.settings import OptimizeSettings, RunSettings
from homolog.surfaces.closest import closest_faces, closest_points
from homolog.surfaces.mesh import TriangleMesh

DATA = Path(os.environ.get("HOMOLOG_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
SPLINE_PARTICLES = 64


@dataclass(frozen=True)
class Source:
    """Where a cohort lies, and its landmarks if experts placed any; else its meshes have the same faces."""

    folder: str
    landmarks: str = ""
    archive: str = ""  # NumPy file with the meshes
    structure: str = ""
    is_invented: bool = False


SOURCES = {
    "skulls": Source("skulls", "landmarks.csv", "skulls.npz"),
    "mandibles": Source("zoo/mandible_mouse/labels", "../landmarks.csv"),
    "vertebrae": Source("vertebra_l1_verse/meshes", "../landmarks.csv"),
    "femora": Source("zoo/limb_femur"),
    "hip bones": Source("zoo/limb_hip"),
    "scapulae": Source("zoo/scapula"),
    "knee femora": Source("knees", archive="knees.npz", structure="femur"),
    "knee tibiae": Source("knees", archive="knees.npz", structure="tibia"),
}


INVENTED = {
    name: Source(name, is_invented=True)
    for name, kind in invented_anatomies.COHORTS.items()
    if not kind.dirty
}


def groomed(name, folder):
    """Return the shapes of a cohort and its truth: landmarks (M, L, 3), or vertices and faces."""
    kept = folder / f"{name.replace(' ', '_')}.pkl"
    if not kept.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(pickle.dumps(prepared({**SOURCES, **INVENTED}[name]), protocol=5))
    return pickle.loads(kept.read_bytes())


def prepared(source):
    """Groom a cohort and read its truth."""
    import trimesh

    from homolog.cohort import read_cohort
    from homolog.grooming import groom_cohort
    from homolog.registration import align_cohort

    settings = RunSettings().groom
    with tempfile.TemporaryDirectory() as place:
        where = DATA / source.folder
        if source.archive:
            where = unpacked(source, Path(place))
        if source.is_invented:
            where = Path(place) / source.folder
            invented_anatomies.make(source.folder, where, seed=0)
            state_sides(where)
        cohort = read_cohort(where)
        annotated, alignments = align_cohort(cohort, groom_cohort(cohort, settings), settings)
        shapes = [
            Shape(item.name, item.field, item.mesh, item.coarse_mesh, alignment)
            for item, alignment in zip(annotated, alignments, strict=True)
        ]
        if source.landmarks:
            return shapes, placed(DATA / source.folder / source.landmarks, shapes)
        if source.is_invented:
            with np.load(where.with_suffix(".truth.npz")) as known:
                return shapes, (np.array([known[shape.name] for shape in shapes]), known["faces"])
        files = [next(where.glob(f"{shape.name}.*")) for shape in shapes]
        meshes = [trimesh.load(file, process=False) for file in files]
    return shapes, (np.array([mesh.vertices for mesh in meshes], float), np.asarray(meshes[0].faces))


def state_sides(folder):
    """Write a table with the sides of subjects that are called *_L and *_R."""
    files = sorted(folder.glob("*_[LR].*"))
    if files:
        lines = [f"{file.stem},{file.name},{file.stem[-1]}" for file in files]
        (folder / "cohort.csv").write_text("\n".join(["name,path,side", *lines, ""]))


def unpacked(source, place):
    """Write the meshes of an archive as files (SUBJECT/vertices or SUBJECT/STRUCTURE, and their faces)."""
    import trimesh

    with np.load(DATA / source.folder / source.archive) as arrays:
        what = source.structure or "vertices"
        for key in arrays.files:
            name = key.removesuffix(f"/{what}")
            if name not in (key, "faces"):
                faces = arrays[f"faces/{what}" if source.structure else f"{name}/faces"].astype(int)
                trimesh.Trimesh(arrays[key], faces, process=False).export(place / f"{name}.ply")
    return place


def placed(path, shapes):
    """Return the experts' landmarks in the order of the shapes, (M, L, 3)."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    labels = list(dict.fromkeys(row["landmark"] for row in rows))
    result = np.full((len(shapes), len(labels), 3), np.nan)
    for row in rows:
        for k, shape in enumerate(shapes):
            if shape.name == row["id"] or shape.name.startswith(f"{row['id']}_"):
                result[k, labels.index(row["landmark"])] = [float(row[axis]) for axis in "xyz"]
    return result


def carried_errors(local, landmarks, snaps):
    """Return the mean error of landmarks carried by particles (M, N, 3)."""
    errors = []
    for i, own in enumerate(local):
        _, distinct = np.unique(np.round(own, 6), axis=0, return_index=True)
        there = np.isfinite(landmarks[i]).all(axis=1)
        targets = np.concatenate([local[j][distinct] for j in range(len(local))], axis=1)
        spline = RBFInterpolator(own[distinct], targets, neighbors=min(SPLINE_PARTICLES, len(distinct)))
        moved = spline(landmarks[i][there]).reshape(there.sum(), -1, 3)
        for j, snap in enumerate(snaps):
            if j != i:
                errors.append(np.linalg.norm(snap(moved[:, j]) - landmarks[j][there], axis=1))
    return float(np.nanmean(np.concatenate(errors)))


def dense_errors(local, truth):
    """Return the mean error of particles (M, N, 3) where faces correspond."""
    vertices, faces = truth
    return float(place_errors([TriangleMesh(own, faces) for own in vertices], local).distances.mean())


def nearest(shapes, poses, points):
    """Return the nearest vertex with an agreeing normal on every shape, for points of each, (M, M, n, 3)."""
    pairs = list(zip(shapes, poses, strict=True))
    vertices = [transform_points(pose, shape.mesh.vertices) for shape, pose in pairs]
    turns = [pose[:3, :3] / np.cbrt(np.linalg.det(pose[:3, :3])) for pose in poses]
    normals = [shape.mesh.vertex_normals @ turn.T for shape, turn in zip(shapes, turns, strict=True)]
    trees = [cKDTree(item) for item in vertices]
    back = inverse_matrices(poses)
    result = np.full((len(shapes), *points.shape), np.nan)
    for i, own in enumerate(points):
        there = np.isfinite(own).all(axis=1)
        posed = transform_points(poses[i], own[there])
        facing = normals[i][trees[i].query(posed)[1]]
        for j, tree in enumerate(trees):
            rows = np.asarray(tree.query(posed, k=min(400, len(vertices[j])))[1])
            agrees = np.einsum("nkd,nd->nk", normals[j][rows], facing) > 0.5
            row = rows[np.arange(len(posed)), np.where(agrees.any(axis=1), agrees.argmax(axis=1), 0)]
            result[i, j, there] = transform_points(back[j], vertices[j][row])
    return result


def nearest_error(shapes, alignments, truth, local):
    """Return the mean error of nearest points in place of the correspondence."""
    posed = normalize_size([replace(s, alignment=a) for s, a in zip(shapes, alignments, strict=True)])
    poses = np.stack([shape.alignment for shape in posed])
    others = ~np.eye(len(shapes), dtype=bool)
    if isinstance(truth, np.ndarray):
        found = nearest(shapes, poses, truth)
        return float(np.nanmean(np.linalg.norm(found - truth, axis=-1)[others]))
    found, (vertices, faces) = nearest(shapes, poses, local), truth
    errors = []
    for k, points in enumerate(local):
        on, weights = closest_faces(TriangleMesh(vertices[k], faces), points)
        true = np.einsum("nc,mncx->mnx", weights, vertices[:, faces[on]])
        errors.append(np.delete(np.linalg.norm(found[k] - true, axis=-1), k, axis=0))
    return float(np.mean(errors))


def measured(name, shapes, truth, settings, device):
    """Run the optimization and return its errors."""
    frames = []
    result = optimize(shapes, settings, device=device, observe=lambda frame: frames or frames.append(frame))
    start = transform_points(inverse_matrices(frames[0].alignments), frames[0].world)
    if isinstance(truth, np.ndarray):
        snaps = [partial(closest_points, shape.mesh) for shape in shapes]
        errors = [carried_errors(local, truth, snaps) for local in (start, result.local)]
    else:
        errors = [dense_errors(local, truth) for local in (start, result.local)]
    placed = [shape.mesh.placed(pose) for shape, pose in zip(shapes, result.alignments, strict=True)]
    verdict = judge(result.world, placed, alignments=result.alignments)
    return {
        "cohort": name,
        "particles": settings.particles,
        "seed": settings.seed,
        "nearest": nearest_error(shapes, result.alignments, truth, result.local),
        "start": errors[0],
        "result": errors[1],
        "expected": verdict.landmark,
        "verdict": verdict.word.value,
        "iterations": result.iterations,
        "reason": result.reason.value,
    }


def table(rows):
    """Print a row for each cohort: nearest points; start, result, span and expected error by the number."""
    counts = sorted({row["particles"] for row in rows})
    print(f"| cohort | nearest points | {' | '.join(map(str, counts))} |\n|---|---{'|---' * len(counts)}|")
    for name in dict.fromkeys(row["cohort"] for row in rows):
        own = [row for row in rows if row["cohort"] == name]
        digits = 3 if np.mean([row["result"] for row in own]) < 1.0 else 2
        nearest = [row["nearest"] for row in own]
        cells = [f"{min(nearest):.{digits}f}-{max(nearest):.{digits}f}"]
        for count in counts:
            start, result, expected = (
                [row[key] for row in own if row["particles"] == count]
                for key in ("start", "result", "expected")
            )
            cells.append(
                f"{np.mean(start):.{digits}f} → {np.mean(result):.{digits}f} ({np.ptp(result):.{digits}f}), "
                f"expected {np.mean(expected):.{digits}f}"
            )
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--invented", action="store_true")
    parser.add_argument("--cohorts", nargs="+", choices=[*SOURCES, *INVENTED])
    parser.add_argument("--particles", nargs="+", type=int, default=[64, 128, 512, 1024])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--device", default="auto")
    parser.add_argument("--rows", type=Path)
    arguments = parser.parse_args()
    device, rows = choose_device(arguments.device), []
    for name in arguments.cohorts or (INVENTED if arguments.invented else SOURCES):
        shapes, truth = groomed(name, arguments.folder)
        for particles in arguments.particles:
            for seed in arguments.seeds:
                settings = OptimizeSettings(particles=particles, seed=seed, procrustes="form")
                rows.append(measured(name, shapes, truth, settings, device))
                if arguments.rows:
                    with arguments.rows.open("a") as file:
                        file.write(json.dumps(rows[-1]) + "\n")
    table(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
