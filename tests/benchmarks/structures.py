"""Several structures of a subject, and surfaces with rims: errors, poses, cuts, cost.

    python tests/benchmarks/structures.py --folder WORK [--only bones flexion cartilages cuts cost memory]
                                          [--particles 256] [--seeds 1 2 3] [--jobs 4] [--rows FILE]

HOMOLOG_DATA names the folder of the real cohorts, of which `knees` (femur, tibia, patella and two cartilages
as sheets with rims, of which equal faces correspond) and `zoo/femur_open` are used. WORK keeps projects.

*bones*: mean error of particles from where the truth carries them [mm], of each bone alone and of all
together, with each of the seeds.
*flexion*: tibiae are turned about the femoral condyles by angles of a standard deviation of 12°, with each of
the seeds. *cartilages*: distances from the given sheets, errors, and how even particles are along the rim.
*cuts*: femora, each cut again 5 to 30 mm further, with planes placed by the program before and after.
*cost*: processor and wall seconds of femur and tibia together, and of each alone with as many particles.
*memory*: of six generated structures of 50 subjects.
"""

import argparse
import json
import multiprocessing
import os
import resource
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from homolog.cohort import read_cohort
from homolog.correspondence import load_kernels
from homolog.errors import InputError, NumericalError
from homolog.io.meshes import write_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.run import Run
from homolog.run.planes import cut_cohort
from homolog.samples.evaluate import place_errors
from homolog.settings import RunSettings
from homolog.statistics.relative_pose import relative_poses
from homolog.surfaces.clipping import Plane, clipped
from homolog.surfaces.closest import closest_points
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import rim_sides

DATA = Path(os.environ.get("HOMOLOG_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
BONES, SHEETS = ("femur", "tibia", "patella"), ("femoral_cartilage", "tibial_cartilage")
FLEXION = 12.0  # standard deviation [degrees]
FURTHER = 5.0, 30.0  # of second cuts [mm]


def knees():
    """Return the meshes by structure and subject."""
    result = {}
    with np.load(DATA / "knees" / "knees.npz") as arrays:
        for key in arrays.files:
            subject, structure = key.split("/")
            if subject != "faces":
                mesh = TriangleMesh(arrays[key].astype(float), arrays[f"faces/{structure}"].astype(np.int32))
                result.setdefault(structure, {})[subject] = mesh
    return result


def flexed(meshes, seed):
    """Return femora and tibiae, the latter turned about the condyles, and the angles [degrees]."""
    random, angles, turned = np.random.default_rng(seed), {}, {}
    femora, tibiae = meshes["femur"], meshes["tibia"]
    along = sum(femora[name].vertices.mean(axis=0) - tibiae[name].vertices.mean(axis=0) for name in femora)
    along = along / np.linalg.norm(along)
    for name, femur in femora.items():
        heights = femur.vertices @ along
        low = femur.vertices[heights < np.quantile(heights, 0.33)]
        centre = low.mean(axis=0)
        across = low - centre - np.outer((low - centre) @ along, along)
        axis = np.linalg.svd(across, full_matrices=False)[2][0]
        axis = axis * np.sign(axis[np.abs(axis).argmax()])
        angles[name] = float(random.normal(0.0, FLEXION))
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(np.radians(angles[name]) * axis).as_matrix()
        pose[:3, 3] = centre - pose[:3, :3] @ centre
        turned[name] = tibiae[name].placed(pose)
    return {"femur": femora, "tibia": turned}, angles


def written(place, meshes):
    """Write a folder a subject with a file a structure."""
    for structure, own in meshes.items():
        for name, mesh in own.items():
            (place / name).mkdir(parents=True, exist_ok=True)
            write_mesh(place / name / f"{structure}.ply", mesh)
    return place


def ran(place, cohort, structures, particles, *, optimize=None, workers=2, **groom):
    """Run a cohort; return the result, and processor and wall seconds by phase."""
    shutil.rmtree(place, ignore_errors=True)
    groom |= {"structures": ",".join(structures)} if len(structures) > 1 else {}
    optimize = {"particles": particles, **(optimize or {})}
    settings = {"groom": groom, "optimize": optimize, "device": "cpu", "workers": workers}
    marks = []

    def observe(status):
        if not marks or marks[-1][0] != status.phase:
            marks.append((status.phase, time.process_time(), time.perf_counter()))

    project = ProjectFolder(place)
    Run(project, cohort, RunSettings.model_validate(settings)).execute(observe)
    marks.append(("", time.process_time(), time.perf_counter()))
    spent = {
        str(before[0]): (after[1] - before[1], after[2] - before[2]) for before, after in pairwise(marks)
    }
    return read_result(project), spent


def errors_of(result, meshes):
    """Return the errors of each structure's particles [mm], and their spacing, by name."""
    parts = {part.name: part.particles for part in result.parts}
    found = {}
    for name in meshes if parts else list(meshes)[:1]:
        own = [meshes[name][subject] for subject in result.names]
        local = result.local[:, parts[name]] if parts else result.local
        area = np.mean([mesh.area for mesh in own])
        spacing = float(np.sqrt(area / local.shape[1] * 2.0 / np.sqrt(3.0)))
        found[name] = place_errors(own, local).distances, spacing, local, own
    return found


def bones(work, particles, names, seed, meshes):
    """Return the mean errors of bones that are modelled together."""
    own = {name: meshes[name] for name in names}
    place = written(work / "data", own)
    result, _ = ran(work / "project", read_cohort(place), names, particles, optimize={"seed": seed})
    return {name: float(item[0].mean()) for name, item in errors_of(result, own).items()}


def rim_evenness(mesh, points):
    """Return the spread of nearest distances of particles at a rim and inside, over their means."""
    ends = mesh.vertices[rim_sides(mesh.faces)[0].ravel()] if len(rim_sides(mesh.faces)[0]) else points[:0]
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    at_rim = cKDTree(ends).query(points)[0] < np.median(nearest)
    return [float(own.std() / own.mean()) for own in (nearest[at_rim], nearest[~at_rim])]


def cartilages(work, particles, names, meshes):
    """Return distances from the sheets, errors over half a spacing, and evenness."""
    own = {name: meshes[name] for name in names}
    place = written(work / "data", own)
    result, _ = ran(work / "project", read_cohort(place), names, particles, pieces="all")
    rows = {}
    for name, (errors, spacing, local, sheets) in errors_of(result, own).items():
        if name not in SHEETS:
            continue
        gaps = [
            np.linalg.norm(closest_points(mesh, points) - points, axis=1)
            for mesh, points in zip(sheets, local, strict=True)
        ]
        even = np.mean([rim_evenness(*pair) for pair in zip(sheets, local, strict=True)], axis=0)
        rows[name] = {
            "farthest": float(np.max(gaps)),
            "error": float(errors.mean()),
            "within half a spacing": float((errors <= 0.5 * spacing).mean()),
            "spread at the rim": float(even[0]),
            "spread inside": float(even[1]),
        }
    return rows


def flexion(work, particles, seed, meshes):
    """Return the errors of the angles [degrees], and the shares of the variance."""
    own, angles = (
        flexed(meshes, seed)
        if seed
        else ({name: meshes[name] for name in BONES[:2]}, dict.fromkeys(meshes["femur"], 0.0))
    )
    place = written(work / "data", own)
    result, _ = ran(work / "project", read_cohort(place), BONES[:2], particles)
    points = [result.local[:, part.particles] for part in result.parts]
    poses = relative_poses(points, BONES[:2])
    turns, planted = poses.rotations[:, 1], np.array([angles[name] for name in result.names])
    planted = planted - planted.mean()
    axis = np.linalg.svd(turns)[2][0] if seed else np.array([1.0, 0.0, 0.0])
    seen = turns @ axis
    seen = seen * (np.sign(seen @ planted) or 1.0)
    parts = poses.components()
    shares = dict(zip(parts.parts, (parts.variances / parts.variances.sum()).tolist(), strict=True))
    return {
        "largest error": float(np.abs(seen - planted).max()),
        "root mean square": float(np.sqrt(np.square(seen - planted).mean())),
        "shares": shares,
        "errors": {name: float(item[0].mean()) for name, item in errors_of(result, own).items()},
    }


def cuts(work, particles, seed):
    """Return how scores of femora that are cut again correlate with those before."""
    given = read_cohort(DATA / "zoo" / "femur_open", "{subject}.ply")
    random, further = np.random.default_rng(seed), {}
    for subject in given.subjects:
        loaded = trimesh.load(subject.path, process=True)
        mesh = TriangleMesh(np.asarray(loaded.vertices, float), np.asarray(loaded.faces, np.int32))
        rim = mesh.vertices[rim_sides(mesh.faces)[0].ravel()]
        middle = rim.mean(axis=0)
        normal = np.linalg.svd(rim - middle, full_matrices=False)[2][2]
        normal = normal * np.sign((mesh.vertices.mean(axis=0) - middle) @ normal)
        further[subject.name] = float(random.uniform(*FURTHER))
        plane = Plane.of(middle + further[subject.name] * normal, normal)
        (work / "data").mkdir(parents=True, exist_ok=True)
        write_mesh(work / "data" / f"{subject.name}.ply", clipped(mesh, plane))
    scores = []
    for number, cohort in enumerate((given, read_cohort(work / "data", "{subject}.ply"))):
        result, _ = ran(work / f"project{number}", cut_cohort(cohort), (), particles)
        rows = result.world.reshape(len(result.names), -1)
        left, values, _ = np.linalg.svd(rows - rows.mean(axis=0), full_matrices=False)
        scores.append(left * values)
    before, after = scores
    lengths = np.array([further[name] for name in result.names])
    alike = np.abs(np.corrcoef(before[:, :3].T, after[:, :5].T)[:3, 3:])
    return {
        "modes": alike.max(axis=1).tolist(),  # those of equal variance may change places
        "distances": float(np.corrcoef(*map(pdist, scores))[0, 1]),
        "first mode and the cut": abs(float(np.corrcoef(after[:, 0], lengths)[0, 1])),
    }


def cost(work, particles, meshes):
    """Return processor and wall seconds by phase of two structures, and of each with as many particles."""
    rows = {}
    load_kernels("cpu")
    for names in (BONES[:2], *((name,) for name in BONES[:2])):
        own = {name: meshes[name] for name in names}
        place = written(work / "+".join(names) / "data", own)
        count = particles if len(names) > 1 else 2 * particles
        given = ran(work / "+".join(names) / "project", read_cohort(place), names, count)
        rows["+".join(names)] = {phase: list(spent) for phase, spent in given[1].items()}
    return rows


def memory(work, particles, structures, subjects):
    """Return the peak memory of a short run of generated solids [GB]; it does not depend on iterations."""
    ball, random = trimesh.creation.icosphere(5), np.random.default_rng(0)
    names = [f"part{k}" for k in range(structures)]
    meshes = {name: {} for name in names}
    for subject in range(subjects):
        for k, name in enumerate(names):
            axes = (15.0, 11.0 + k, 8.0) * random.normal(1.0, 0.1, 3)
            bump = 1.0 + 0.15 * ball.vertices[:, k % 3] * random.normal(1.0, 0.5)
            vertices = ball.vertices * bump[:, None] * axes + [40.0 * k, 0.0, 0.0]
            meshes[name][f"s{subject:02d}"] = TriangleMesh(vertices, ball.faces.astype(np.int32))
    brief = {"split_iterations": 5, "anneal_iterations": 5, "settle_iterations": 5}
    place = written(work / "data", meshes)
    _, spent = ran(work / "project", read_cohort(place), names, particles, optimize=brief, workers=8)
    most = [
        resource.getrusage(who).ru_maxrss / 1e6 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    return {"process": most[0], "largest worker": most[1], "wall": sum(item[1] for item in spent.values())}


def task(number, what, work, particles, *given):
    """Do one task on two cores; return its name and what it measured."""
    cores = sorted(os.sched_getaffinity(0))
    if what != "memory":
        os.sched_setaffinity(0, {cores[(2 * number + k) % len(cores)] for k in range(2)})
    shutil.rmtree(work, ignore_errors=True)
    started = time.perf_counter()
    do = {
        "bones": bones,
        "flexion": flexion,
        "cartilages": cartilages,
        "cuts": cuts,
        "cost": cost,
        "memory": memory,
    }[what]
    try:
        measured = do(work, particles, *given)
    except (InputError, NumericalError) as error:
        measured = {"failed": str(error)}
    return {"what": work.name, "measured": measured, "seconds": round(time.perf_counter() - started)}


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = ("bones", "flexion", "cartilages", "cuts", "cost", "memory")
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--only", nargs="+", choices=kinds, default=kinds)
    parser.add_argument("--particles", type=int, default=256)
    parser.add_argument("--subjects", type=int, default=10)
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--rows", type=Path)
    arguments = parser.parse_args()
    meshes = {key: dict(list(own.items())[: arguments.subjects]) for key, own in knees().items()}
    alone = [(name,) for name in BONES]
    sheets = [(name,) for name in SHEETS]
    works = {
        "cost": [("cost", meshes)],
        "bones": [
            (f"bones {'+'.join(names)} {seed}", names, seed, meshes)
            for seed in arguments.seeds
            for names in (BONES, *alone)
        ],
        "flexion": [(f"flexion {seed}", seed, meshes) for seed in (0, *arguments.seeds)],
        "cartilages": [
            ("cartilages " + "+".join(names), names, meshes)
            for names in (*sheets, SHEETS, BONES[:2] + SHEETS)
        ],
        "memory": [("memory", 6, 50)],
        "cuts": [("cuts", 1)],
    }
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.jobs, context, max_tasks_per_child=1) as pool:
        listed = [(kind, *item) for kind in works if kind in arguments.only for item in works[kind]]
        started = [
            pool.submit(task, k, kind, arguments.folder / name.replace(" ", "_"), arguments.particles, *given)
            for k, (kind, name, *given) in enumerate(listed)
        ]
        for item in as_completed(started):
            line = json.dumps(item.result())
            print(line, flush=True)
            if arguments.rows:
                with arguments.rows.open("a") as file:
                    file.write(line + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
