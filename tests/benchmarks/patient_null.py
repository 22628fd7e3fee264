"""How often a healthy subject is flagged by homolog patient, and which planted bumps and dents are found.

    python tests/benchmarks/patient_null.py [--controls 24] [--references 4] [--new 40] [--lesions 20]

Left ventricles of `homolog.samples.hearts` (healthy ones) with ragged borders (0.4 mm, correlated over 3 mm).
Several references are made of other controls each; new healthy subjects that no reference has seen are
compared with each, as they are and with one bump or dent (Gaussian, height 1-4 mm, full width 5-20 mm,
at a random place). A lesion is found if a region beyond the limit reaches within half its width (at least
4 mm) of its centre.

Beside it the plain approach: the patient is part of the joint cohort (with perfect correspondence, which
flatters it), z is that of the outward distance from the mean of all by their standard deviation. Uncorrected,
|z| > 1.96 is a finding; to compare detection at the same rate of false alarms, its limit is also set at the
95th percentile of the healthy new subjects' own largest |z|. Prints tables in Markdown.
"""

import argparse
import sys
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from scipy import stats
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from homolog.analysis.procrustes import align
from homolog.geometry import farthest_point_sampling
from homolog.grooming import GroomedSubject, GroomReport
from homolog.patient import compare_groomed
from homolog.patient.build import reference_of
from homolog.patient.coding import Coding
from homolog.patient.controls import Controls
from homolog.patient.reference import Provenance, Reference
from homolog.samples.hearts import make_hearts
from homolog.samples.study import Waves
from homolog.settings import GroomSettings
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified

HEIGHTS, WIDTHS = (1.0, 2.0, 3.0, 4.0), (5.0, 10.0, 20.0)
RAGGED, RAGGED_LENGTH = 0.4, 3.0  # mm
PARTICLES, SURFACE = 512, 4000


@dataclass(frozen=True)
class Healthy:
    """Healthy subjects: corresponding vertices (M, V, 3) [mm] and their common faces."""

    vertices: np.ndarray
    faces: np.ndarray

    def mesh(self, index: int) -> TriangleMesh:
        return TriangleMesh(self.vertices[index], self.faces)


def healthy(count: int, seed: int) -> Healthy:
    """Draw healthy ventricles with ragged borders, turned and shifted."""
    subjects = make_hearts(2 * count, seed).subjects[::2]
    random = np.random.default_rng([seed, 8])
    made = []
    for subject in subjects:
        noise = Waves(random, RAGGED_LENGTH, RAGGED, 1)(subject.mesh.vertices)
        points = subject.mesh.vertices + noise * subject.mesh.vertex_normals
        turn = Rotation.from_rotvec(np.deg2rad(random.normal(scale=5.0, size=3)))
        made.append(turn.apply(points) + random.normal(scale=20.0, size=3))
    return Healthy(np.array(made), subjects[0].mesh.faces)


def reference_from(group: Healthy) -> tuple[Reference, np.ndarray]:
    """Make a reference, and return it with the aligned vertices of its controls."""
    aligned = align(group.vertices - group.vertices.mean(axis=1, keepdims=True), scaling=False)
    mean = TriangleMesh(aligned.mean(axis=0), group.faces)
    surface = simplified(mean, SURFACE)
    near = cKDTree(mean.vertices).query(surface.vertices, k=3)
    weights = 1.0 / np.maximum(near[0], 1e-6) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    dense = np.einsum("vk,mvki->mvi", weights, aligned[:, near[1]])
    chosen = farthest_point_sampling(mean.vertices, PARTICLES)
    count = len(aligned)
    controls = Controls(
        tuple(map(str, range(count))),
        np.concatenate([dense, aligned[:, chosen]], axis=1),
        TriangleMesh(dense.mean(axis=0), surface.faces),
        tuple(group.mesh(index) for index in range(count)),
        group.vertices[:, chosen],
    )
    now = datetime.now(UTC).isoformat(timespec="seconds")
    about = Provenance("generated", "", count, now, now, {}, "", PARTICLES, GroomSettings(), "")
    coding, columns = Coding.of({}, controls.names)
    return reference_of(controls, coding, columns, about), aligned


def groomed(mesh: TriangleMesh) -> GroomedSubject:
    field = DistanceField(np.zeros((2, 2, 2), np.float32), np.eye(4))
    return GroomedSubject("patient", field, mesh, mesh, GroomReport(0, 0, False, 1.0, 1.0, 0))


def with_lesion(mesh: TriangleMesh, centre: int, height: float, width: float) -> TriangleMesh:
    """Move a surface outward around a vertex; the opposite wall stays."""
    normals = mesh.vertex_normals
    gaps = np.square(mesh.vertices - mesh.vertices[centre]).sum(axis=1)
    lesion = np.exp(-4.0 * np.log(2.0) * gaps / width**2) * (normals @ normals[centre] > 0.0)
    return TriangleMesh(mesh.vertices + height * lesion[:, None] * normals, mesh.faces)


def plain(aligned: np.ndarray, mesh: TriangleMesh) -> np.ndarray:
    """Return the plain z of a patient in the joint cohort, at the vertices."""
    joint = np.concatenate([aligned, (mesh.vertices - mesh.vertices.mean(axis=0))[None]])
    joint = align(joint, scaling=False)
    mean = TriangleMesh(joint.mean(axis=0), mesh.faces)
    outward = np.einsum("mvi,vi->mv", joint - mean.vertices, mean.vertex_normals)
    return outward[-1] / outward.std(axis=0, ddof=1)


@dataclass
class Outcome:
    """What both approaches make of a subject: largest |z|, and that near the lesion."""

    ours: float
    ours_near: float
    limit: float
    plain: float
    plain_near: float


def outcome(
    reference: Reference, aligned: np.ndarray, mesh: TriangleMesh, centre: int, width: float
) -> Outcome:
    found = compare_groomed(reference, groomed(mesh), force=True)
    there = (found.placement @ np.append(mesh.vertices[centre], 1.0))[:3]
    on_patient = found.expected.vertices + found.residual[:, None] * found.expected.vertex_normals
    near = np.linalg.norm(on_patient - there, axis=1) < max(0.5 * width, 4.0)
    score = plain(aligned, mesh)
    own = np.linalg.norm(mesh.vertices - mesh.vertices[centre], axis=1) < 0.5 * width
    return Outcome(
        float(np.abs(found.z).max()),
        float(np.abs(found.z[near]).max(initial=0.0)),
        reference.limit,
        float(np.abs(score).max()),
        float(np.abs(score[own]).max()),
    )


def auc(healthy_values: np.ndarray, values: np.ndarray) -> float:
    """Return the probability that a lesion's largest value is above a healthy subject's."""
    return float(stats.mannwhitneyu(values, healthy_values).statistic / (len(values) * len(healthy_values)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controls", type=int, default=24)
    parser.add_argument("--references", type=int, default=4)
    parser.add_argument("--new", type=int, default=40)
    parser.add_argument("--lesions", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    null: list[Outcome] = []
    lesions: dict[tuple[float, float], list[Outcome]] = {(h, w): [] for w in WIDTHS for h in HEIGHTS}
    rates = []
    for number in range(arguments.references):
        group = healthy(arguments.controls + arguments.new, arguments.seed + 100 * number)
        own = Healthy(group.vertices[: arguments.controls], group.faces)
        reference, aligned = reference_from(own)
        new = range(arguments.controls, len(group.vertices))
        here = [outcome(reference, aligned, group.mesh(index), 0, 5.0) for index in new]
        null += here
        rates.append(np.mean([item.ours > item.limit for item in here]))
        print(
            f"reference {number + 1}: limit {reference.limit:.2f}, {reference.quality.limit_mm:.2f} mm, "
            f"flagged {100 * rates[-1]:.0f} %",
            file=sys.stderr, flush=True,
        )  # fmt: skip
        for height, width in lesions:
            for _ in range(-(-arguments.lesions // arguments.references)):
                mesh = group.mesh(int(random.choice(list(new))))
                centre, sign = int(random.integers(len(mesh.vertices))), float(random.choice([-1.0, 1.0]))
                hurt = with_lesion(mesh, centre, sign * height, width)
                lesions[height, width].append(outcome(reference, aligned, hurt, centre, width))
    report(null, lesions)


def report(null: list[Outcome], lesions: dict[tuple[float, float], list[Outcome]]) -> None:
    flagged = sum(item.ours > item.limit for item in null)
    low, high = stats.beta.interval(0.95, flagged + 0.5, len(null) - flagged + 0.5)
    uncorrected = np.mean([item.plain > 1.96 for item in null])
    print(f"Healthy new subjects flagged: {flagged} of {len(null)} ({100 * flagged / len(null):.1f} %, ")
    print(
        f"95 % interval {100 * low:.1f} to {100 * high:.1f}); plain z map, uncorrected: "
        f"{100 * uncorrected:.0f} %\n"
    )
    usual = np.quantile([item.plain for item in null], 0.95)
    ours, others = (np.array([getattr(item, name) for item in null]) for name in ("ours", "plain"))
    print("| width (mm) | height (mm) | found (%) | plain, same false alarms (%) | AUC | AUC, plain |")
    print("|---|---|---|---|---|---|")
    for (height, width), items in lesions.items():
        found = 100.0 * np.mean([item.ours_near > item.limit for item in items])
        plainly = 100.0 * np.mean([item.plain_near > usual for item in items])
        areas = (
            auc(ours, np.array([item.ours for item in items])),
            auc(others, np.array([item.plain for item in items])),
        )
        print(
            f"| {width:.0f} | {height:.0f} | {found:.0f} | {plainly:.0f} | {areas[0]:.2f} | {areas[1]:.2f} |"
        )


if __name__ == "__main__":
    main()
