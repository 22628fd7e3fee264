"""A sample study as files: the inputs of a study, and the truth."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray
from homolog.cohort import Cohort, read_cohort
from homolog.errors import InputError
from homolog.io.meshes import write_mesh
from homolog.io.tables import write_table
from homolog.io.written_images import write_image
from homolog.progress import Tick, no_tick
from homolog.samples.bones import make_femora, make_vertebrae
from homolog.samples.hearts import make_hearts
from homolog.samples.study import SampleStudy, SampleSubject, Waves
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import mesh_level

__all__ = ["KINDS", "make_study", "write_study"]

KINDS: dict[str, Callable[[int, int], SampleStudy]] = {
    "hearts": make_hearts,
    "vertebrae": make_vertebrae,
    "femora": make_femora,
}
"""Functions of the number of subjects and the seed."""

_FEWEST, _MOST = 4, 500
_NOISE = 0.35  # voxels: standard deviation of the segmentations' borders
_MARGIN = 4  # voxels
_SCAN_MARGIN, _SCAN_VOXEL = 10, 1.25  # voxels; edge, in voxels of the label map
_TISSUE, _SURROUNDING, _SCAN_NOISE = 110.0, -20.0, 18.0  # HU
_CAP = 0.999  # cosine of the angle between a face of the cut and the cut's plane


def make_study(kind: str, subjects: int, seed: int) -> SampleStudy:
    """Return a sample study; its subjects are rotated by a few degrees and shifted, as in a scanner.

    Parameters
    ----------
    kind : str
        A name of `KINDS`.
    subjects : int
        Number of subjects, 4 to 500.
    seed : int
        Non-negative random seed; the same seed gives the same study.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    if kind not in KINDS:
        raise InputError(f"{kind}: is not a sample study; choose one of {', '.join(KINDS)}")
    if not _FEWEST <= subjects <= _MOST:
        raise InputError(f"{subjects} subjects: must be between {_FEWEST} and {_MOST}")
    if seed < 0:
        raise InputError(f"seed {seed}: must be 0 or more")
    study = KINDS[kind](subjects, seed)
    random = np.random.default_rng([seed, 4])
    placed = []
    for subject in study.subjects:
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_rotvec(np.deg2rad(random.normal(scale=5.0, size=3))).as_matrix()
        matrix[:3, 3] = random.normal(scale=20.0, size=3)
        mesh = subject.mesh.placed(matrix)
        placed.append(SampleSubject(subject.name, subject.columns, subject.parameters, mesh))
    return SampleStudy(study.kind, tuple(placed), study.reference, study.affected, study.voxel)


def write_study(
    folder: Path, study: SampleStudy, seed: int, tick: Tick = no_tick, *, scans: bool = False
) -> Cohort:
    """Write a study: a file for each subject, ``cohort.csv``, and ``truth/``.

    ``truth/`` contains every subject's exact surface with corresponding vertices (PLY), its parameters
    (``parameters.csv``), the average subject without and with the second group's effect (``reference.ply``,
    ``affected.ply``), and the outward displacement by this effect (``effect.csv``).

    Parameters
    ----------
    folder : Path
        Output folder, created if necessary. Files of the same names are replaced.
    study : SampleStudy
        The study to write.
    seed : int
        Random seed of the segmentation noise.
    tick : Tick
        Called after each subject.
    scans : bool
        Whether to write ``NAME_image.nrrd``, too: grey values with noise (in HU, like CT), which match the
        label maps. Surfaces have no scans.

    Raises
    ------
    InputError
        If a file can't be written.
    """
    truth = folder / "truth"
    suffix = ".ply" if study.voxel is None else ".nrrd"
    for number, subject in enumerate(study.subjects):
        tick(number / len(study.subjects), f"writing {subject.name}")
        path = folder / f"{subject.name}{suffix}"
        if study.voxel is None:
            write_mesh(path, _opened(subject.mesh, study.reference))
        else:
            noise = Waves(np.random.default_rng([seed, 5, number]), 1.8 * study.voxel, _NOISE, 1)
            _write_labels(path, subject.mesh, study.voxel, noise)
            if scans:
                grain = np.random.default_rng([seed, 6, number])
                _write_scan(folder / f"{subject.name}_image.nrrd", subject.mesh, study.voxel, grain)
        write_mesh(truth / f"{subject.name}.ply", subject.mesh)
    first = study.subjects[0]
    columns = list(first.columns)
    write_table(
        folder / "cohort.csv",
        ["name", "path", *columns],
        ([each.name, f"{each.name}{suffix}", *each.columns.values()] for each in study.subjects),
    )
    write_table(
        truth / "parameters.csv",
        ["name", *columns, *first.parameters],
        ([each.name, *each.columns.values(), *each.parameters.values()] for each in study.subjects),
    )
    write_mesh(truth / "reference.ply", study.reference)
    write_mesh(truth / "affected.ply", study.affected)
    write_table(truth / "effect.csv", ["vertex", "outward_mm"], enumerate(study.effect.tolist()))
    return read_cohort(folder)


def _write_labels(path: Path, mesh: TriangleMesh, voxel: float, noise: Waves) -> None:
    """Write the voxels inside a surface whose border is displaced by noise."""
    low = mesh.vertices.min(axis=0) - _MARGIN * voxel
    shape = np.ceil((mesh.vertices.max(axis=0) - low) / voxel).astype(int) + _MARGIN
    level = mesh_level(mesh, low, voxel, (int(shape[0]), int(shape[1]), int(shape[2])))
    border = np.argwhere(np.abs(level) < 2.0)
    level[tuple(border.T)] += noise(low + voxel * border)[:, 0]
    write_image(path, (level < 0.0).astype(np.uint8), _grid(low, voxel))


def _write_scan(path: Path, mesh: TriangleMesh, voxel: float, random: np.random.Generator) -> None:
    """Write simulated grey values: another grid, blurred, with noise, in soft tissue."""
    size = voxel * _SCAN_VOXEL
    low = mesh.vertices.min(axis=0) - _SCAN_MARGIN * size
    sizes = np.ceil((mesh.vertices.max(axis=0) - low) / size).astype(int) + _SCAN_MARGIN
    shape = (int(sizes[0]), int(sizes[1]), int(sizes[2]))
    level = mesh_level(mesh, low, size, shape)
    places = low + size * np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3)
    around = _SURROUNDING + Waves(random, 15.0 * size, 30.0, 1)(places)[:, 0].reshape(shape)
    inside = 1.0 / (1.0 + np.exp(np.clip(2.0 * level, -30.0, 30.0)))
    grey = around + (_TISSUE - around) * inside + random.normal(scale=_SCAN_NOISE, size=shape)
    write_image(path, np.round(grey).astype(np.int16), _grid(low, size))


def _grid(low: FloatArray, voxel: float) -> FloatArray:
    """Return the matrix from indices to positions [mm] of an image with cubic voxels."""
    matrix = np.diag([voxel, voxel, voxel, 1.0])
    matrix[:3, 3] = low
    return matrix


def _opened(mesh: TriangleMesh, reference: TriangleMesh) -> TriangleMesh:
    """Return a bone without the faces of its cut, like a surface from a scan that ends there."""
    corners: FloatArray = reference.vertices[reference.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    lowest = float(reference.vertices[:, 2].min())
    is_cap = (normals[:, 2] < -_CAP) & (corners[:, :, 2].max(axis=1) < lowest + 1.0)
    used, faces = np.unique(mesh.faces[~is_cap], return_inverse=True)
    return TriangleMesh(mesh.vertices[used], faces.reshape(-1, 3))
