"""A project's result, for statistics, pictures and exports."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.io.meshes import read_mesh
from homolog.io.particle_array import particle_file, read_all_particles, write_particle_array
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh, joined
from homolog.surfaces.mirroring import mirrors

__all__ = [
    "MODE_DEVIATIONS",
    "Part",
    "Result",
    "mean_file",
    "mode_file",
    "particle_file",
    "read_energies",
    "read_modes",
    "read_result",
    "read_surface",
    "read_surfaces",
    "read_whole_surface",
    "surface_file",
    "write_smoothing",
]

_MANY_FILES = 100
"""Number of parsed text files above which the array of particles is written again."""
MODE_DEVIATIONS = 2.0
"""Position of the mode surfaces in standard deviations."""


@dataclass(frozen=True, slots=True)
class Part:
    """One of several structures in a result: its particles, and its vertices of the mean surface."""

    name: str
    particles: slice
    vertices: slice


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Corresponding particles on the subjects' surfaces.

    Attributes
    ----------
    names : tuple of str
        The M subjects, in the project's order.
    groups : tuple of str or None
        Groups of the subjects.
    columns : tuple of mappings
        Further columns of the cohort's table, by subject.
    world, local : (M, N, 3) float64 arrays
        Particles [mm] in aligned coordinates and in those of the input files, read-only.
    alignments : (M, 4, 4) float64 array
        Similarities from local to world, read-only; reflections for subjects that were mirrored.
    mean_surface : TriangleMesh
        The mean shape, in world coordinates.
    smoothing : (N,) float64 array
        Smoothing at each particle of the spline by which the mean surface follows the particles [mm]: 0
        except where the surface or a mode would fold. See `homolog.statistics.reconstruction.warp_surface`.
    voxels : tuple of tuples of float
        Edges of the voxels of each subject's file [mm], the shortest first; empty for surfaces and if
        unknown.
    parts : tuple of Part
        The structures of subjects with several; empty for a single one.
    """

    names: tuple[str, ...]
    groups: tuple[str | None, ...]
    columns: tuple[Mapping[str, str], ...]
    world: FloatArray
    local: FloatArray
    alignments: FloatArray
    mean_surface: TriangleMesh
    smoothing: FloatArray
    voxels: tuple[tuple[float, ...], ...] = ()
    parts: tuple[Part, ...] = ()

    @property
    def pieces(self) -> tuple[tuple[slice, slice], ...]:
        """Particles and vertices of the mean surface of each of several structures."""
        return tuple((part.particles, part.vertices) for part in self.parts)

    @property
    def structures(self) -> dict[str, int]:
        """Number of particles of each of several structures; empty for a single one."""
        return {part.name: part.particles.stop - part.particles.start for part in self.parts}

    @property
    def mirrored(self) -> int:
        """Number of mirrored subjects."""
        return int(mirrors(self.alignments).sum())

    def with_table_of(self, subjects: Iterable[Subject]) -> "Result":
        """Return the result with the groups and columns of these subjects; others keep their own."""
        present = {subject.name: subject for subject in subjects}
        rows = [
            (known.group, known.columns) if (known := present.get(name)) is not None else (group, columns)
            for name, group, columns in zip(self.names, self.groups, self.columns, strict=True)
        ]
        return replace(
            self, groups=tuple(group for group, _ in rows), columns=tuple(columns for _, columns in rows)
        )


def surface_file(project: ProjectFolder, stem: str) -> Path:
    """Return the path of a subject's groomed surface, in local coordinates."""
    return project.groomed / f"{stem}.vtp"


def mean_file(project: ProjectFolder) -> Path:
    """Return the path of the mean surface, in world coordinates."""
    return project.model / "mean.vtp"


def mode_file(project: ProjectFolder, mode: int, side: str) -> Path:
    """Return the path of the surface at one end (``"minus"``, ``"plus"``) of a mode, counted from 0."""
    return project.model / f"mode_{mode + 1:02d}_{side}_{MODE_DEVIATIONS:g}sd.vtp"


def read_result(project: ProjectFolder, tick: Tick = no_tick) -> Result:
    """Read the last result of a project, with the current groups and columns of the cohort's table.

    Parameters
    ----------
    project : ProjectFolder
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If there is no result, or one of its files is missing or damaged.
    """
    whole = _read_whole(project)
    record = _result_of(project, whole)
    subjects = record.subjects
    present = {subject.name: subject for subject in whole.subjects}
    listed = [present.get(subject.name, subject) for subject in subjects]
    names, stems = [subject.name for subject in subjects], [subject.file for subject in subjects]
    parts, mean = _parts(record), read_mesh(mean_file(project))
    local, world, parsed = read_all_particles(project, stems, names, record.particles, tick)
    if parsed > _MANY_FILES and project.is_held:
        with suppress(InputError):  # a full or read-only disk
            write_particle_array(project, stems, local, world)
    return Result(
        names=tuple(names),
        groups=tuple(item.group for item in listed),
        columns=tuple(item.columns for item in listed),
        world=world,
        local=local,
        alignments=frozen(np.array([subject.alignment for subject in subjects])),
        mean_surface=TriangleMesh(mean.vertices, mean.faces, tuple(part.vertices.stop for part in parts)),
        smoothing=_read_smoothing(project, record),
        voxels=tuple(tuple(sorted(subject.voxel)) for subject in subjects),
        parts=parts,
    )


def _parts(record: ResultRecord) -> tuple[Part, ...]:
    ends = np.cumsum([[item.particles, item.vertices] for item in record.structures], axis=0).tolist()
    begins = [[0, 0], *ends[:-1]]
    return tuple(
        Part(item.name, slice(a, b), slice(c, d))
        for item, (a, c), (b, d) in zip(record.structures, begins, ends, strict=False)
    )


def read_surface(project: ProjectFolder, subject: ResultSubject) -> TriangleMesh:
    """Read the groomed surface of a result's subject, in local coordinates.

    Raises
    ------
    InputError
        If it is missing or damaged.
    """
    mesh = read_mesh(surface_file(project, subject.file))
    if subject.is_mirrored and mesh.volume < 0.0:  # imported by an older version
        return TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    return mesh


def read_whole_surface(project: ProjectFolder, record: ResultRecord, subject: ResultSubject) -> TriangleMesh:
    """Read the groomed surface of a subject, that of several structures as separate pieces.

    Raises
    ------
    InputError
        If one is missing or damaged.
    """
    parts = [read_surface(project.structure(item.name), subject) for item in record.structures]
    return joined(parts) if parts else read_surface(project, subject)


def read_energies(project: ProjectFolder) -> FloatArray:
    """Return iteration and the three terms of the objective during the run, (T, 4); empty if it was imported.

    Raises
    ------
    InputError
        If the table can't be read.
    """
    path = project.folder / "energies.csv"
    try:
        rows = path.read_text(encoding="utf-8").splitlines()[1:]
        return frozen(np.array([row.split(",") for row in rows], dtype=np.float64).reshape(-1, 4))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: can't be read: {error}; run again") from error


def write_smoothing(project: ProjectFolder, smoothing: FloatArray) -> None:
    """Write the smoothing (N,) of the spline by which the mean surface follows the particles [mm]."""
    write_arrays(_smoothing_file(project), {"smoothing": smoothing})


def read_surfaces(project: ProjectFolder) -> list[TriangleMesh]:
    """Read the groomed surfaces of the result's subjects, moved to world coordinates.

    Raises
    ------
    InputError
        If there is no result, or one of the surfaces is missing or damaged.
    """
    record = _result_of(project, _read_whole(project))
    return [read_surface(project, subject).placed(np.array(subject.alignment)) for subject in record.subjects]


def read_modes(project: ProjectFolder, mean: TriangleMesh) -> FloatArray:
    """Read the displacements of the mean surface along the modes with stored surfaces.

    Parameters
    ----------
    project : ProjectFolder
    mean : TriangleMesh
        The project's mean surface, V vertices.

    Returns
    -------
    (K, V, 3) float64 array
        Displacements of the vertices [mm] for one standard deviation, K >= 1.

    Raises
    ------
    InputError
        If a surface is damaged or does not belong to the mean surface.
    """
    displacements: list[FloatArray] = []
    while (path := mode_file(project, len(displacements), "plus")).is_file():
        plus, minus = (
            read_mesh(item).vertices for item in (path, mode_file(project, len(displacements), "minus"))
        )
        if not plus.shape == minus.shape == mean.vertices.shape:
            raise InputError(f"{path}: does not belong to {mean_file(project)}; run again")
        displacements.append((plus - minus) / (2.0 * MODE_DEVIATIONS))
    return frozen(np.array(displacements).reshape(-1, *mean.vertices.shape))


def _smoothing_file(project: ProjectFolder) -> Path:
    return project.model / "smoothing.npz"


def _read_smoothing(project: ProjectFolder, record: ResultRecord) -> FloatArray:
    if not record.smoothed_particles:
        return frozen(np.zeros(record.particles))
    path = _smoothing_file(project)
    stored = read_arrays(path).get("smoothing", np.zeros(0))
    fits = stored.shape == (record.particles,) and stored.dtype.kind == "f"
    fits = fits and bool(np.isfinite(stored).all()) and stored.min() >= 0.0
    if not fits or np.count_nonzero(stored) != record.smoothed_particles:
        raise InputError(f"{path}: does not belong to the result; run again")
    return frozen(stored, np.float64)


def _read_whole(project: ProjectFolder) -> ProjectRecord:
    project.recover()
    return project.read()


def _result_of(project: ProjectFolder, whole: ProjectRecord) -> ResultRecord:
    record = whole.result
    if record is None:
        raise InputError(f"{project.folder}: has no result yet; run it first")
    return record
