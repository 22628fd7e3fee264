"""How often a healthy subject is flagged by homolog patient, and which planted bumps and dents are found.

    python tests/benchmarks/patient_null.py FOLDER [--workers 16] [--lesions 200]
    python tests/benchmarks/patient_null.py FOLDER --summary

Left ventricles of `homolog.samples.hearts` (healthy ones) with ragged borders (0.4 mm, correlated over 3 mm);
several references are made of other controls each, and new healthy subjects that no reference has seen are
compared with them. Real shapes: `patient_lesions.py`.

Each subject is compared as it is, mirrored, and with one bump or dent at a random place (Gaussian, height
1-4 mm, full width 5-20 mm). A lesion is found if a region beyond the limit reaches within half its width (at
least 4 mm) of its centre. Beside it the plain approach: the patient is part of the joint cohort, z is that of
the outward distance from the mean of all by their standard deviation, in perfect correspondence, which
flatters it.
Uncorrected, |z| > 1.96 is a finding; to compare detection at the same rate of false alarms, its limit is also
set at the 95th percentile of the healthy subjects' own largest |z|.

FOLDER keeps the references, and a line of JSON for each comparison: a run that was stopped goes on where it
was. `--summary` prints the tables in Markdown.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import as_completed
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from homolog.geometry import farthest_point_sampling
from homolog.grooming import GroomedSubject, GroomReport
from homolog.patient import compare_groomed
from homolog.patient.build import reference_of
from homolog.patient.coding import Coding
from homolog.patient.controls import Controls
from homolog.patient.provenance import Provenance
from homolog.patient.reference import Reference
from homolog.samples.hearts import make_hearts
from homolog.samples.study import Waves
from homolog.settings import GroomSettings
from homolog.statistics.procrustes import align
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import MIRROR
from homolog.surfaces.simplify import simplified
from homolog.workers import worker_processes

HEIGHTS, WIDTHS = (1.0, 2.0, 3.0, 4.0), (5.0, 10.0, 20.0)
RAGGED, RAGGED_LENGTH = 0.4, 3.0  # mm
PARTICLES, SURFACE = 512, 4000
OUTCOMES = "outcomes.jsonl"


@dataclass(frozen=True)
class Group:
    """Subjects of a reference, and those who are compared with it."""

    controls: Controls
    meshes: list[TriangleMesh]  # of those who are compared
    cohort: np.ndarray  # (M, N, 3), aligned points of the controls, for the plain approach
    points: list[np.ndarray]  # the same of those who are compared, in the frames of their meshes
    faces: np.ndarray  # of the points


@dataclass(frozen=True)
class Task:
    """A comparison: of a subject, with what was done to it."""

    reference: int
    subject: int
    kind: str  # healthy, mirrored, lesion
    height: float = 0.0
    width: float = 0.0
    repeat: int = 0

    @property
    def key(self) -> str:
        return "/".join(str(getattr(self, name)) for name in self.__dataclass_fields__)


def generated(folder: Path, number: int) -> Group:
    """Draw healthy ventricles with ragged borders, turned and shifted: controls, then new ones."""
    options = options_of(folder)
    seed, count = options["seed"] + 100 * number, options["controls"]
    subjects = make_hearts(2 * (count + options["new"]), seed).subjects[::2]
    random = np.random.default_rng([seed, 8])
    made = []
    for subject in subjects:
        noise = Waves(random, RAGGED_LENGTH, RAGGED, 1)(subject.mesh.vertices)
        points = subject.mesh.vertices + noise * subject.mesh.vertex_normals
        turn = Rotation.from_rotvec(np.deg2rad(random.normal(scale=5.0, size=3)))
        made.append(turn.apply(points) + random.normal(scale=20.0, size=3))
    vertices, faces = np.array(made), subjects[0].mesh.faces
    own = vertices[:count]
    aligned = align(own - own.mean(axis=1, keepdims=True), scaling=False)
    meshes = [TriangleMesh(points, faces) for points in vertices]
    controls = corresponding(aligned, own, meshes[:count])
    return Group(controls, meshes[count:], aligned, list(vertices[count:]), faces)


def corresponding(aligned: np.ndarray, own: np.ndarray, meshes: list[TriangleMesh]) -> Controls:
    """Return controls whose points correspond perfectly, with a surface of fewer vertices."""
    mean = TriangleMesh(aligned.mean(axis=0), meshes[0].faces)
    surface = simplified(mean, SURFACE)
    near = cKDTree(mean.vertices).query(surface.vertices, k=3)
    weights = 1.0 / np.maximum(near[0], 1e-6) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    dense = np.einsum("vk,mvki->mvi", weights, aligned[:, near[1]])
    chosen = farthest_point_sampling(mean.vertices, PARTICLES)
    names = tuple(map(str, range(len(aligned))))
    points = np.concatenate([dense, aligned[:, chosen]], axis=1)
    surface = TriangleMesh(dense.mean(axis=0), surface.faces)
    return Controls(names, points, surface, tuple(meshes), own[:, chosen])


@lru_cache(maxsize=2)
def group_of(folder: Path, number: int) -> Group:
    return generated(folder, number)


def path_of(folder: Path, number: int) -> Path:
    return folder / f"reference-{number}.npz"


@lru_cache(maxsize=2)
def reference_at(path: Path) -> Reference:
    return Reference.load(path)


def options_of(folder: Path) -> Any:
    return json.loads((folder / "options.json").read_text())


def make_reference(folder: Path, number: int) -> str:
    """Make one reference, in a worker; its controls are fitted in one further process."""
    controls = group_of(folder, number).controls
    now = datetime.now(UTC).isoformat(timespec="seconds")
    count, particles = controls.particles.shape[:2]
    about = Provenance("generated", "", count, now, now, {}, "", particles, GroomSettings(), "")
    coding, columns = Coding.of({}, controls.names)
    reference = reference_of(controls, coding, columns, about, workers=1)
    path = path_of(folder, number)
    written = path.with_stem(f"{path.stem}-partly")
    reference.save(written)
    written.replace(path)
    return f"{number}: limit {reference.limit:.2f}, {reference.quality.limit_mm:.2f} mm"


def tasks_of(folder: Path, number: int) -> Iterator[Task]:
    """Yield the comparisons with a reference; lesions go round the subjects."""
    options = options_of(folder)
    references, subjects = options["references"], options["new"]
    for subject in range(subjects):
        yield Task(number, subject, "healthy")
        yield Task(number, subject, "mirrored")
    for height in HEIGHTS:
        for width in WIDTHS:
            for repeat in range(number, options["lesions"], references):
                yield Task(number, repeat // references % subjects, "lesion", height, width, repeat)


def outcome(folder: Path, task: Task) -> dict[str, Any]:
    """Compare a subject with its reference, in a worker."""
    begun = time.process_time()
    group = group_of(folder, task.reference)
    reference = reference_at(path_of(folder, task.reference))
    random = np.random.default_rng([options_of(folder)["seed"], *task.key.encode()])
    mesh, points = group.meshes[task.subject], group.points[task.subject]
    line: dict[str, Any] = {"key": task.key, "kind": task.kind, "limit": reference.limit}
    centre = int(random.integers(len(mesh.vertices)))
    sign = float(random.choice([-1.0, 1.0]))
    if task.kind == "mirrored":
        mesh, points = mesh.placed(MIRROR), points @ MIRROR[:3, :3]
    elif task.kind == "lesion":
        line |= {"height": sign * task.height, "width": task.width, "wall": wall_of(mesh, centre)}
        move = lesion(mesh, centre, sign * task.height, task.width)
        nearest = cKDTree(mesh.vertices).query(points)[1]
        points = points + move[nearest]
        mesh = TriangleMesh(mesh.vertices + move, mesh.faces)
    result = compare_groomed(reference, groomed(mesh), force=True)
    line |= {
        "largest": float(np.abs(result.z).max()),
        "regions": len(result.regions),
        "gap": result.measures.gap,
        "mahalanobis": result.measures.mahalanobis,
    }
    if task.kind != "mirrored":
        score, middle = plain(group, mesh, points), mesh.vertices[centre]
        own = np.linalg.norm(points - middle, axis=1) < max(0.5 * task.width, 4.0)
        there = (result.placement @ np.append(middle, 1.0))[:3]
        surface = result.expected.vertices + result.residual[:, None] * result.expected.vertex_normals
        near = np.linalg.norm(surface - there, axis=1) < max(0.5 * task.width, 4.0)
        line |= {
            "near": float(np.abs(result.z[near]).max(initial=0.0)),
            "plain": float(np.abs(score).max()),
            "plain_near": float(np.abs(score[own]).max(initial=0.0)),
        }
    line["cpu_s"] = round(time.process_time() - begun, 2)
    return line


def groomed(mesh: TriangleMesh) -> GroomedSubject:
    field = DistanceField(np.zeros((2, 2, 2), np.float32), np.eye(4))
    return GroomedSubject("patient", field, mesh, mesh, GroomReport(0, 0, False, 1.0, 1.0, 0))


def lesion(mesh: TriangleMesh, centre: int, height: float, width: float) -> np.ndarray:
    """Return how a lesion moves a surface outward around a vertex; the opposite wall stays."""
    normals = mesh.vertex_normals
    gaps = np.square(mesh.vertices - mesh.vertices[centre]).sum(axis=1)
    shape = np.exp(-4.0 * np.log(2.0) * gaps / width**2) * (normals @ normals[centre] > 0.0)
    return height * shape[:, None] * normals


def wall_of(mesh: TriangleMesh, centre: int) -> str:
    """Return where a vertex lies on a hollow shape: whether its normal leads away from the middle."""
    way = mesh.vertices[centre] - mesh.vertices.mean(axis=0)
    along = float(mesh.vertex_normals[centre] @ way / np.linalg.norm(way))
    return "outer" if along > 0.5 else "inner" if along < -0.5 else "rim"


def plain(group: Group, mesh: TriangleMesh, points: np.ndarray) -> np.ndarray:
    """Return the plain z of a patient in the joint cohort, at the points."""
    joint = np.concatenate([group.cohort, (points - points.mean(axis=0))[None]])
    joint = align(joint, scaling=False)
    mean = joint.mean(axis=0)
    normals = TriangleMesh(mean, group.faces).vertex_normals
    outward = np.einsum("mvi,vi->mv", joint - mean, normals)
    return np.asarray(outward[-1] / outward.std(axis=0, ddof=1))


def auc(healthy_values: np.ndarray, values: np.ndarray) -> float:
    pairs = len(values) * len(healthy_values)
    return float(stats.mannwhitneyu(values, healthy_values).statistic / pairs)


def report(lines: list[dict[str, Any]]) -> None:
    null = [line for line in lines if line["kind"] == "healthy"]
    lesions = [line for line in lines if line["kind"] == "lesion"]
    flagged = sum(line["regions"] > 0 for line in null)
    low, high = 100.0 * np.array(stats.beta.interval(0.95, flagged + 0.5, len(null) - flagged + 0.5))
    uncorrected = 100.0 * np.mean([line["plain"] > 1.96 for line in null])
    print(
        f"\nHealthy subjects flagged: {flagged} of {len(null)} "
        f"({100 * flagged / len(null):.1f} %, 95 % interval {low:.1f} to {high:.1f}); plain z map, "
        f"uncorrected: {uncorrected:.0f} %\n"
    )
    ours = np.array([line["largest"] / line["limit"] for line in null])
    others = np.array([line["plain"] for line in null])
    levels = [np.quantile(ours, 1.0 - rate) for rate in (0.01, 0.1)]
    usual = np.quantile(others, 0.95)
    print(
        "| width (mm) | height (mm) | lesions | found (%) | at 1 % false alarms | at 10 % | plain, at 5 % | "
        "AUC | AUC, plain |\n|---|---|---|---|---|---|---|---|---|"
    )
    for width in WIDTHS:
        for height in HEIGHTS:
            items = [line for line in lesions if (line["width"], abs(line["height"])) == (width, height)]
            near = np.array([line["near"] / line["limit"] for line in items])
            rates = [100.0 * np.mean(near > level) for level in (1.0, *levels)]
            rates.append(100.0 * np.mean([line["plain_near"] > usual for line in items]))
            areas = (
                auc(ours, np.array([line["largest"] / line["limit"] for line in items])),
                auc(others, np.array([line["plain"] for line in items])),
            )
            cells = [f"{width:.0f}", f"{height:.0f}", str(len(items)), *(f"{rate:.0f}" for rate in rates)]
            print(f"| {' | '.join([*cells, *(f'{area:.2f}' for area in areas)])} |")
    print("\n| place (3 and 4 mm, 10 and 20 mm wide) | lesions | found (%) |\n|---|---|---|")
    clear = [line for line in lesions if abs(line["height"]) >= 3.0 and line["width"] >= 10.0]
    for wall in ("outer", "rim", "inner"):
        for word, sign in (("bump", 1.0), ("dent", -1.0)):
            items = [line for line in clear if line["wall"] == wall and sign * line["height"] > 0.0]
            if items:
                rate = 100.0 * np.mean([line["near"] > line["limit"] for line in items])
                print(f"| {word}, {wall} wall | {len(items)} | {rate:.0f} |")
    mirrored = {
        line["key"].replace("mirrored", "healthy"): line for line in lines if line["kind"] == "mirrored"
    }
    ratios = [line["gap"] / mirrored[line["key"]]["gap"] for line in null if line["key"] in mirrored]
    shares = np.quantile(ratios, [0.05, 0.5, 0.95])
    print(
        f"\nDistance from the fit, over that of the mirror image: median {shares[1]:.2f}, 90 % between "
        f"{shares[0]:.2f} and {shares[2]:.2f}; below 1 in {100 * np.mean(np.array(ratios) < 1.0):.0f} %"
    )
    print(f"\n{len(lines)} comparisons, {sum(line['cpu_s'] for line in lines):.0f} CPU s")


def prepared(arguments: argparse.Namespace) -> None:
    """Write the options."""
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    options = {
        name: getattr(arguments, name) for name in ("controls", "references", "new", "lesions", "seed")
    }
    path = folder / "options.json"
    if path.exists() and (before := options_of(folder)) != options:
        sys.exit(f"{folder}: was begun with other options: {before}; take another folder")
    path.write_text(json.dumps(options))


def lines_of(folder: Path) -> list[dict[str, Any]]:
    """Read the outcomes, without a last line that was cut off while it was written."""
    path = folder / OUTCOMES
    text = path.read_text() if path.exists() else ""
    return [json.loads(line) for line in text.split("\n")[:-1]]


def work(arguments: argparse.Namespace) -> None:
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    prepared(arguments)
    folder, references = arguments.folder, range(arguments.references)
    begun = time.perf_counter()
    finished = lines_of(folder)
    (folder / OUTCOMES).write_text("".join(f"{json.dumps(line)}\n" for line in finished))
    done = {line["key"] for line in finished}
    with worker_processes(arguments.workers) as executor, (folder / OUTCOMES).open("a") as log:
        missing = [item for item in references if not path_of(folder, item).exists()]
        for future in as_completed([executor.submit(make_reference, folder, item) for item in missing]):
            print(future.result(), file=sys.stderr, flush=True)
        tasks = [task for item in references for task in tasks_of(folder, item) if task.key not in done]
        futures = [executor.submit(outcome, folder, task) for task in tasks]
        for number, future in enumerate(as_completed(futures)):
            log.write(f"{json.dumps(future.result())}\n")
            log.flush()
            if number % 50 == 49 or number + 1 == len(tasks):
                spent = time.perf_counter() - begun
                print(f"{number + 1} of {len(tasks)}, {spent:.0f} s", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--summary", action="store_true")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--controls", type=int, default=24)
    parser.add_argument("--references", type=int, default=10)
    parser.add_argument("--new", type=int, default=20)
    parser.add_argument("--lesions", type=int, default=200, help="of each height and width")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if not arguments.summary:
        work(arguments)
    lines = lines_of(arguments.folder)
    report(lines)


if __name__ == "__main__":
    main()
