"""Cohorts of organs that are nearly round or symmetric, whose files lie alike within 15°, or in any way.

    python tests/benchmarks/orientations.py [KIND ...] [--turned] [--flipped] [--particles 128] [--seeds 0]
                                            [--alignment icp]

Each kind is a solid of known correspondence, deformed by three common modes and own noise, stretched, turned
by up to 15° and written as a label map of a usual slice spacing. With --turned every file is turned at
random, with --flipped only the fourth, by 180° about a random axis. Printed is a row a cohort: why the run
ended; how far particles are from those that the known correspondence carries there, in spacings: the share of
pairs below half a spacing, the mean and the 95th percentile; by what angle shapes are turned against each
other by the alignment and at the end, the median and the largest; and how many subjects have a note on that.
"""

import argparse
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

from cohort import RandomCohort, carried_errors

from anatomy import LabelMap, write_label_map
from homolog.cohort import read_cohort
from homolog.correspondence import Shape, load_kernels, optimize
from homolog.device import choose_device
from homolog.grooming import groom_cohort
from homolog.registration import align_cohort
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings
from homolog.surfaces.isosurface import marching_cubes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import mesh_level
from homolog.surfaces.simplify import simplified

_NODES, _HALF = 96, 1.4
_VERTICES = 6000
_JITTER = 15.0
_Grid = np.ndarray
_Solid = Callable[[_Grid], _Grid]


def _ellipsoid(p: _Grid, centre, radii, tilt=(0.0, 0.0, 0.0)) -> _Grid:
    """Return about the signed distance of an ellipsoid."""
    turn = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
    radii = np.array(radii)
    return (np.linalg.norm((p - np.array(centre)) @ turn / radii, axis=-1) - 1.0) * radii.min()


def _capsule(p: _Grid, begin, end, first: float, last: float) -> _Grid:
    """Return the signed distance of a rod whose radius changes."""
    begin, end = np.array(begin), np.array(end)
    along = np.clip((p - begin) @ (end - begin) / ((end - begin) @ (end - begin)), 0.0, 1.0)
    return (
        np.linalg.norm(p - begin - along[..., None] * (end - begin), axis=-1) - first - (last - first) * along
    )


def _union(*parts: _Grid, blend: float = 0.06) -> _Grid:
    least = np.minimum.reduce(parts)
    return least - blend * np.log(sum(np.exp((least - part) / blend) for part in parts))


def _without(whole: _Grid, part: _Grid, blend: float = 0.06) -> _Grid:
    return -_union(-whole, part, blend=blend)


def _prostate(p: _Grid) -> _Grid:
    lobes = (_ellipsoid(p, (side * 0.4, 0.36, 0.1), (0.55, 0.36, 0.63)) for side in (1.0, -1.0))
    return _union(
        _ellipsoid(p, (0.0, 0.0, 0.0), (1.0, 0.72, 0.82)),
        *lobes,
        _ellipsoid(p, (0.0, -0.1, -0.63), (0.45, 0.4, 0.45)),
        blend=0.14,
    )


def _eye(p: _Grid) -> _Grid:
    return _union(
        _ellipsoid(p, (0, 0, 0), (0.95, 0.98, 0.92)), _ellipsoid(p, (0.05, 0.72, 0), (0.42, 0.4, 0.42))
    )


def _thyroid_lobe(p: _Grid) -> _Grid:
    return _union(
        _ellipsoid(p, (0.0, 0.0, 0.0), (0.38, 0.42, 1.1), (0, 10, 0)),
        _capsule(p, (0.0, 0.05, -0.4), (0.5, 0.15, -0.45), 0.22, 0.16),
        blend=0.08,
    )


def _uterus(p: _Grid) -> _Grid:
    return _union(
        _ellipsoid(p, (0.0, 0.0, 0.45), (0.75, 0.52, 0.6)),
        _capsule(p, (0.0, 0.0, 0.2), (0.0, 0.15, -0.95), 0.4, 0.27),
        blend=0.1,
    )


def _kidney(p: _Grid) -> _Grid:
    return _without(
        _ellipsoid(p, (0, 0, 0), (0.6, 0.5, 1.1)), _ellipsoid(p, (0.63, 0, 0), (0.38, 0.3, 0.4)), 0.09
    )


def _humeral_head(p: _Grid) -> _Grid:
    ball = np.maximum(_ellipsoid(p, (0.1, 0.0, 0.15), (0.8, 0.8, 0.8)), -(p[..., 2] + 0.5))
    return _union(ball, _ellipsoid(p, (-0.72, 0.15, 0.05), (0.3, 0.35, 0.45)), blend=0.08)


def _nodule(p: _Grid) -> _Grid:
    bumps = ((0.5, 0.4, 0.5), (-0.6, 0.3, -0.2), (0.1, -0.7, 0.3), (0.3, 0.1, -0.7))
    parts = (_ellipsoid(p, place, (0.38, 0.33, 0.35)) for place in bumps)
    return _union(_ellipsoid(p, (0, 0, 0), (0.8, 0.75, 0.7)), *parts, blend=0.1)


def _tooth_root(p: _Grid) -> _Grid:
    stretched = p * np.array([1.0, 0.8, 1.0])
    return _union(
        _capsule(stretched, (0, 0, 0.9), (0, 0, 0), 0.36, 0.3),
        _capsule(stretched, (0, 0, 0), (0.14, 0.03, -1.0), 0.3, 0.12),
    )


def _tube(p: _Grid) -> _Grid:
    return _union(
        _capsule(p, (0, 0, 1.0), (0, 0.05, 0), 0.3, 0.27),
        _capsule(p, (0, 0.05, 0), (0.05, 0, -1.0), 0.27, 0.24),
    )


def _cup(p: _Grid) -> _Grid:
    wall = np.maximum(
        _ellipsoid(p, (0, 0, 0.2), (0.72, 0.75, 1.2)), -_ellipsoid(p, (0.03, 0, 0.25), (0.48, 0.5, 0.95))
    )
    return np.maximum(wall, p[..., 2] - 0.55)


def _bladder(p: _Grid) -> _Grid:
    return _union(
        _ellipsoid(p, (0, 0, 0.1), (1.0, 0.85, 0.75)),
        _ellipsoid(p, (0, -0.1, -0.35), (0.5, 0.45, 0.5)),
        blend=0.12,
    )


def _jaw(p: _Grid) -> _Grid:
    """Clearly asymmetric: a bent body with a process."""
    return _union(
        _capsule(p, (-1.0, -0.3, 0.0), (0.0, 0.3, 0.1), 0.3, 0.26),
        _capsule(p, (0.0, 0.3, 0.1), (0.9, -0.2, 0.35), 0.26, 0.16),
        _capsule(p, (-0.8, -0.2, 0.0), (-0.7, 0.1, 0.8), 0.22, 0.12),
    )


@dataclass(frozen=True, slots=True)
class Kind:
    """A solid, its half length [mm], and the voxels of its label maps [mm]."""

    solid: _Solid
    size: float
    voxel: float
    slices: int = 1


KINDS = {
    "prostate": Kind(_prostate, 24.0, 0.6, 6),
    "bladder": Kind(_bladder, 45.0, 1.5, 3),
    "cup": Kind(_cup, 45.0, 1.3, 6),
    "eye": Kind(_eye, 12.0, 0.5, 2),
    "humeral head": Kind(_humeral_head, 25.0, 0.8),
    "jaw": Kind(_jaw, 40.0, 1.0),
    "kidney": Kind(_kidney, 55.0, 1.2, 3),
    "nodule": Kind(_nodule, 9.0, 0.6, 2),
    "thyroid lobe": Kind(_thyroid_lobe, 25.0, 0.6, 4),
    "tooth root": Kind(_tooth_root, 8.0, 0.25),
    "tube": Kind(_tube, 40.0, 0.8, 2),
    "uterus": Kind(_uterus, 40.0, 1.0, 4),
}


def made(name: str, seed: int, subjects: int = 8) -> tuple[RandomCohort, list[LabelMap]]:
    """Return a cohort and its label maps."""
    rng, kind = np.random.default_rng([seed, zlib.crc32(name.encode())]), KINDS[name]
    places = np.linspace(-_HALF, _HALF, _NODES)
    values = kind.solid(np.stack(np.meshgrid(places, places, places, indexing="ij"), axis=-1))
    nodes, faces = marching_cubes(ndimage.gaussian_filter(values, 0.6))
    base = simplified(TriangleMesh(nodes * (places[1] - places[0]) - _HALF, faces), _VERTICES)
    modes = [_waves(rng, base.vertices, 1.6, 0.05) for _ in range(3)]
    meshes, maps = [], []
    for _ in range(subjects):
        shape = (
            base.vertices
            + sum(rng.normal() * mode for mode in modes)
            + _waves(rng, base.vertices, 2.5, 0.012)
        )
        shape = shape * (1.0 + 0.07 * rng.normal(size=3)) * kind.size * np.exp(0.08 * rng.normal())
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(np.radians(rng.uniform(-_JITTER, _JITTER)) * axis / np.linalg.norm(axis))
        mesh = TriangleMesh(turn.apply(shape) + rng.uniform(-40.0, 40.0, 3), base.faces)
        meshes.append(mesh)
        maps.append(_label_map(mesh, kind))
    return RandomCohort(name, "label maps", tuple(meshes)), maps


def _waves(rng: np.random.Generator, points: np.ndarray, frequency: float, amount: float) -> np.ndarray:
    """Return a smooth random field of displacements."""
    total = np.zeros_like(points)
    for _ in range(6):
        phase = points @ (frequency * rng.normal(size=3)) + rng.uniform(0.0, 2.0 * np.pi)
        total += np.sin(phase)[:, None] * rng.normal(size=3)
    return amount * total * 1.4 / np.sqrt(6.0)


def _label_map(mesh: TriangleMesh, kind: Kind) -> LabelMap:
    spacing = kind.voxel * np.array([1.0, 1.0, kind.slices])
    low, high = mesh.vertices.min(axis=0) - 3.0 * spacing, mesh.vertices.max(axis=0) + 3.0 * spacing
    shape = tuple(np.ceil((high - low) / kind.voxel).astype(int) + 1)
    inside = mesh_level(mesh, low, kind.voxel, shape) < 0.0
    first = kind.slices // 2
    return LabelMap(
        inside[:, :, first :: kind.slices], spacing, np.eye(3), low + np.array([0.0, 0.0, first * kind.voxel])
    )


def turned(
    cohort: RandomCohort, maps: list[LabelMap], turns: Rotation
) -> tuple[RandomCohort, list[LabelMap]]:
    """Return a cohort whose files lie otherwise, each about the origin."""
    meshes = [
        TriangleMesh(mesh.vertices @ turn.as_matrix().T, mesh.faces)
        for mesh, turn in zip(cohort.meshes, turns, strict=True)
    ]
    moved = [
        replace(item, rotation=turn.as_matrix() @ item.rotation, origin=turn.apply(item.origin))
        for item, turn in zip(maps, turns, strict=True)
    ]
    return replace(cohort, meshes=tuple(meshes)), moved


def angles(points: np.ndarray) -> np.ndarray:
    """Return by what angle each shape's points (S, N, 3) are turned against the others' [°], the median."""
    arms = points - points.mean(axis=1, keepdims=True)
    turns = np.array([[Rotation.align_vectors(a, b)[0].magnitude() for a in arms] for b in arms])
    return np.degrees(np.median(turns, axis=1))


def errors_of_angles(cohort: RandomCohort, alignments: np.ndarray) -> np.ndarray:
    """Return by what angle each shape is turned against the others in the world [°], by the known truth."""
    moved = [
        mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        for mesh, pose in zip(cohort.meshes, alignments, strict=True)
    ]
    return angles(np.array(moved)[:, ::20])


def groomed_cohort(cohort: RandomCohort, maps: list[LabelMap], settings: GroomSettings):
    """Return the cohort as read from files, and its groomed subjects."""
    with tempfile.TemporaryDirectory(prefix="homolog-orientations-") as folder:
        for number, item in enumerate(maps, start=1):
            write_label_map(item, Path(folder) / f"subject{number:02d}.nrrd")
        read = read_cohort(Path(folder))
        return read, groom_cohort(read, settings)


def run(cohort: RandomCohort, read, groomed, settings: RunSettings, device: str) -> str:
    """Return a row of the table."""
    begun = time.process_time()
    subjects, alignments = align_cohort(read, groomed, settings.groom)
    shapes = [
        Shape(item.name, item.field, item.mesh, item.coarse_mesh, alignment)
        for item, alignment in zip(subjects, alignments, strict=True)
    ]
    optimized = optimize(shapes, settings.placing, device=device)
    errors = carried_errors(cohort, np.asarray(optimized.local))
    first = errors_of_angles(cohort, alignments)
    last = errors_of_angles(cohort, optimized.alignments)
    notes = sum(
        len(item.report.notes) > len(old.report.notes) for item, old in zip(subjects, groomed, strict=True)
    )
    return (
        f"{optimized.reason.value} | {100.0 * np.mean(errors < 0.5):.1f} % | {errors.mean():.2f} | "
        f"{np.percentile(errors, 95):.2f} | {np.median(first):.0f}, {first.max():.0f} | "
        f"{np.median(last):.0f}, {last.max():.0f} | {notes} | {time.process_time() - begun:.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}; all by default")
    parser.add_argument("--turned", action="store_true")
    parser.add_argument("--flipped", action="store_true")
    parser.add_argument("--particles", type=int, default=128)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--alignment", default="icp")
    parser.add_argument("--device", default="auto")
    options = parser.parse_args()
    device = choose_device(options.device)
    load_kernels(device)
    settings = RunSettings(
        groom=GroomSettings(alignment=options.alignment),
        optimize=OptimizeSettings(particles=options.particles),
    )
    print("| cohort | seed | ended | pairs | mean | 95 % | aligned ° | at the end ° | notes | CPU s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for seed in options.seeds:
        for name in options.kinds or KINDS:
            cohort, maps = made(name, seed)
            turns = Rotation.identity(len(maps))
            if options.turned:
                turns = Rotation.random(len(maps), random_state=seed)
            if options.flipped:
                axis = np.random.default_rng(seed).normal(size=3)
                vectors = np.zeros((len(maps), 3))
                vectors[3] = np.pi * axis / np.linalg.norm(axis)
                turns = Rotation.from_rotvec(vectors)
            cohort, maps = turned(cohort, maps, turns)
            read, groomed = groomed_cohort(cohort, maps, settings.groom)
            print(f"| {name} | {seed} | {run(cohort, read, groomed, settings, device)}", flush=True)


if __name__ == "__main__":
    main()
