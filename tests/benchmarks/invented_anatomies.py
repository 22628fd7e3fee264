"""Cohorts of invented anatomies, run from the command line as a new user runs them.

    python tests/benchmarks/invented_anatomies.py FOLDER [COHORT…] [--particles 128] [--seed 0] [--only-write]
                                                [--poses]

An anatomy is a solid of smoothly joined ellipsoids and tubes with handles, thin walls or slits. Its eight
subjects are images of one mesh under smooth random deformations: three ways to vary in common, individual
differences, proportions, sizes up to 1.5-fold, poses; some are left and some right. They are written as
noisy label maps or as meshes, clean or damaged. FOLDER/COHORT gets the files and FOLDER/COHORT.project the
result. Printed is a row a cohort: how the run ended, suspects of `homolog check`, the errors of particles
against the known correspondence (in spacings), and processor time. With --poses the undamaged surfaces are
registered only: printed is by what angles shapes are turned against the true correspondence [degrees], and
how many get the notes that they fit about as well after a further rotation, and that they do not look like
the others.
"""

import argparse
import re
import resource
import shutil
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1] / "anatomy"))

import invented as solids
from cohort import carried

from anatomy import LabelMap, write_label_map
from homolog.geometry import rotation_of
from homolog.io.meshes import write_mesh
from homolog.registration.align import register
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import mesh_level
from homolog.surfaces.simplify import simplified


@dataclass(frozen=True)
class Kind:
    """How a cohort is written: the solid, half its length [mm], voxels [mm], voxels between slices."""

    solid: Callable
    size: float
    voxel: float = 1.0
    slices: int = 1
    mesh: bool = False
    turn: float = 20.0
    sides: bool = False
    dirty: str = ""


COHORTS = {
    "molar": Kind(solids.molar, 10, 0.25, turn=40),
    "molar_fused": Kind(lambda p: solids.molar(p, fused=True), 10, 0.3),
    "incisor": Kind(solids.incisor, 12, mesh=True, turn=180),
    "skullcap": Kind(solids.skullcap, 90, 1.5),
    "skull": Kind(solids.skull, 95, 2.0),
    "aortic_arch": Kind(solids.aortic_arch, 70, 1.5),
    "airway": Kind(solids.airway, 60, 1.2),
    "vessels": Kind(solids.vessels, 30, 0.6),
    "meniscus": Kind(solids.meniscus, 22, 0.5, 3),
    "annulus": Kind(solids.annulus, 18, 0.6),
    "pelvis": Kind(solids.pelvis, 130, 2.0),
    "rib": Kind(solids.rib, 110, 1.5),
    "kidney": Kind(solids.kidney, 60, 1.0, 3, sides=True),
    "liver": Kind(solids.liver, 100, 1.5, 3),
    "mandible": Kind(solids.mandible, 60, 1.0),
    "tibia": Kind(solids.tibia, 180, mesh=True, sides=True, turn=90),
    "fibula": Kind(solids.fibula, 180, mesh=True, turn=90),
    "patella": Kind(solids.patella, 25, 0.6, sides=True),
    "cerebellum": Kind(solids.cerebellum, 55, 1.0),
    "cortex": Kind(solids.cortex, 40, 1.7),
    "caudate": Kind(solids.caudate, 25, 1.0),
    "callosum": Kind(solids.callosum, 38, 1.0),
    "lung": Kind(solids.lung, 120, 2.0, sides=True),
    "lungs": Kind(solids.lungs, 150, 2.5),
    "cochlea": Kind(solids.cochlea, 5, 0.15),
    "phalanx": Kind(solids.phalanx, 20, mesh=True, turn=180),
    "atrium": Kind(solids.atrium, 40, 1.0),
    "right_ventricle": Kind(solids.right_ventricle, 45, 1.2),
    "kidney_soup": Kind(solids.kidney, 60, mesh=True, dirty="soup"),
    "mandible_units": Kind(solids.mandible, 60, mesh=True, dirty="units"),
    "liver_flipped": Kind(solids.liver, 100, mesh=True, dirty="flipped"),
    "atrium_holes": Kind(solids.atrium, 40, mesh=True, dirty="holes"),
    "patella_inner": Kind(solids.patella, 25, mesh=True, dirty="inner"),
    "molar_scan": Kind(solids.molar, 10, mesh=True, dirty="scan"),
    "aortic_arch_pieces": Kind(solids.aortic_arch, 70, 1.2, dirty="crumbs"),
}


def waves(rng, points, frequency, scale):
    """Return a smooth random displacement of points."""
    directions = rng.normal(scale=frequency, size=(6, 3))
    return np.sin(points @ directions.T + rng.uniform(0, 2 * np.pi, 6)) @ rng.normal(
        scale=0.55 * scale, size=(6, 3)
    )


def subjects(kind, rng, count=8):
    """Yield name and mesh of each subject [mm]; all have the faces of the template, some of them mirrored."""
    base = solids.template(kind.solid)
    points = np.array(base.vertices)
    modes = [waves(rng, points, 1.6, 0.05) for _ in range(3)]
    for number in range(1, count + 1):
        vertices = points + sum(rng.normal() * mode for mode in modes) + waves(rng, points, 2.5, 0.012)
        vertices = (
            vertices * np.exp(rng.normal(scale=0.06, size=3)) * kind.size * np.exp(rng.uniform(-0.2, 0.2))
        )
        is_left = kind.sides and number % 2 == 0
        turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(-kind.turn, kind.turn, 3)))
        if is_left:
            vertices = vertices * [-1.0, 1.0, 1.0]
        mesh = TriangleMesh(turn.apply(vertices) + rng.uniform(-30, 30, 3), base.faces)
        yield (
            f"s{number:02d}" + ("_L" if is_left else "_R" if kind.sides else ""),
            solids.flipped(mesh) if is_left else mesh,
        )


def write(kind, name, mesh, folder, rng, number):
    """Write a subject's file."""
    if kind.mesh:
        suffix = (".stl", ".ply", ".vtp", ".obj")[number % 4] if kind.dirty else ".ply"
        write_mesh(folder / (name + suffix), damaged(kind.dirty, mesh, rng, number))
        return
    step = np.array([1.0, 1.0, kind.slices]) * kind.voxel
    low, high = mesh.vertices.min(axis=0) - 3.0 * step, mesh.vertices.max(axis=0) + 3.0 * step
    shape = tuple((np.ceil((high - low) / kind.voxel) + 1).astype(int))
    level = mesh_level(mesh, low, kind.voxel, shape)
    noise = ndimage.gaussian_filter(rng.normal(size=shape), 1.2)
    level = (level + 0.25 * kind.voxel * noise / noise.std())[:, :, :: kind.slices]
    mask = level < 0.0
    if kind.dirty == "crumbs":
        mask |= rng.random(mask.shape) < 0.0005
    write_label_map(LabelMap(mask, step, np.eye(3), low), folder / f"{name}.nrrd")


def damaged(how, mesh, rng, number):
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    if how == "soup":  # no shared corners, some faces twice, in metres
        faces = np.concatenate([faces, faces[:200]])[rng.permutation(len(faces) + 200)]
        vertices, faces = vertices[faces].reshape(-1, 3) / 1000.0, np.arange(3 * len(faces)).reshape(-1, 3)
    if how == "units":
        vertices = vertices / 10.0
    if how == "flipped":
        turned = rng.random(len(faces)) < (0.3 if number % 2 else 1.0)
        faces[turned] = faces[turned][:, ::-1]
    if how == "holes":
        middles = vertices[faces].mean(axis=1)
        for place in middles[rng.integers(len(faces), size=6)]:
            far = np.linalg.norm(middles - place, axis=1) > 2.0
            faces, middles = faces[far], middles[far]
    if how == "inner":  # a second surface inside
        inner = (vertices - vertices.mean(axis=0)) * 0.6 + vertices.mean(axis=0)
        vertices, faces = np.concatenate([vertices, inner]), np.concatenate([faces, faces + len(vertices)])
    if how == "scan":
        vertices = vertices + rng.normal(scale=0.06, size=vertices.shape)
        faces = faces[rng.random(len(faces)) > 0.003]
    return TriangleMesh(vertices, np.ascontiguousarray(faces, np.int32))


def make(name, folder, seed):
    """Write a cohort's files, and the true places beside them for `errors_of`."""
    kind, rng = COHORTS[name], np.random.default_rng([seed, zlib.crc32(name.encode())])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    truth = {}
    for number, (subject, mesh) in enumerate(subjects(kind, rng)):
        write(kind, subject, mesh, folder, rng, number)
        truth[subject] = mesh.vertices
    np.savez(folder.with_suffix(".truth.npz"), faces=mesh.faces, **truth)


def errors_of(name, folder, project):
    """Return errors of particles in spacings, of all pairs, and the number of subjects in the result."""
    truth = np.load(folder.with_suffix(".truth.npz"))
    files = sorted((project / "particles").glob("*_local.particles"))
    names = [file.name.removesuffix("_local.particles") for file in files]
    unit = {"soup": 1000.0, "units": 10.0}.get(COHORTS[name].dirty, 1.0)
    particles = np.stack([np.loadtxt(file) for file in files])
    meshes = [TriangleMesh(truth[item], truth["faces"]) for item in names]
    if np.ptp(particles[0], axis=0).max() * 3.0 < np.ptp(meshes[0].vertices, axis=0).max():
        particles = particles * unit
    spacing = np.sqrt([mesh.area / particles.shape[1] * 2.0 / np.sqrt(3.0) for mesh in meshes])
    pairs = [
        np.delete(
            np.linalg.norm(carried(meshes, k, points) - particles, axis=2) / spacing[:, None], k, axis=0
        )
        for k, points in enumerate(particles)
    ]
    return np.concatenate([item.ravel() for item in pairs]), len(names)


def command(*words):
    """Return exit code, output and processor time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(["homolog", *map(str, words)], capture_output=True, text=True, timeout=1800)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.returncode, done.stdout + done.stderr, seconds


def wrong_turns(name, seed):
    """Return angles by which registration alone turns shapes against most others [degrees], and its notes."""
    kind, rng = COHORTS[name], np.random.default_rng([seed, zlib.crc32(name.encode())])
    meshes = [
        solids.flipped(TriangleMesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces))
        if subject.endswith("_L")
        else mesh
        for subject, mesh in subjects(kind, rng)
    ]
    groomed = [SimpleNamespace(name="", coarse_mesh=simplified(mesh, 1500)) for mesh in meshes]
    registered = register(groomed, GroomSettings())
    poses = registered.alignments
    placed = [mesh.vertices[::7] @ rotation_of(pose).T for mesh, pose in zip(meshes, poses, strict=True)]
    placed = [points - points.mean(axis=0) for points in placed]
    turns = np.degrees([[Rotation.align_vectors(a, b)[0].magnitude() for a in placed] for b in placed])
    return turns[np.argmin(np.median(turns, axis=1))], [note or "" for note in registered.notes]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("cohorts", nargs="*", default=list(COHORTS))
    parser.add_argument("--particles", type=int, default=128)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only-write", action="store_true")
    parser.add_argument("--poses", action="store_true")
    options = parser.parse_args()
    for name in options.cohorts:
        if options.poses:
            turns, notes = wrong_turns(name, options.seed)
            named, wrong = np.array(["a further rotation" in note for note in notes]), turns > 40.0
            print(f"{name}: {wrong.sum()} turned by more than 40°;", *turns.round(), end="; ")
            print(
                f"{(named & wrong).sum()} of them and {(named & ~wrong).sum()} others may be turned", end="; "
            )
            print(f"{sum('does not look like' in note for note in notes)} unlike the others", flush=True)
            continue
        folder = options.folder / name
        make(name, folder, options.seed)
        if options.only_write:
            continue
        project = folder.with_suffix(".project")
        shutil.rmtree(project, ignore_errors=True)
        code, output, seconds = command("run", folder, "--out", project, "--particles", options.particles)
        folder.with_suffix(".log").write_text(output)
        if code:
            print(f"| {name} | {code}: {output.strip().splitlines()[-1]} |", flush=True)
            continue
        checked = command("check", project)[1]
        folder.with_suffix(".check").write_text(checked)
        ended = re.search(r"(converged|stopped|most iterations)[^\n,|]*", output)
        suspects = re.findall(r"(\d+) suspects? of", checked)
        errors, count = errors_of(name, folder, project)
        print(
            f"| {name} | {count} | {ended[0] if ended else '?'} | {suspects[-1] if suspects else '?'} "
            f"| {100 * np.mean(errors < 0.5):.1f} % | {errors.mean():.2f} | {np.percentile(errors, 95):.2f} "
            f"| {len(re.findall('mirrored', output))} | {seconds:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
