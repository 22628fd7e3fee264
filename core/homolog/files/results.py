"""A project's result, read back: what statistics, pictures and other programs start from."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.files.meshes import read_mesh
from homolog.files.particles import read_particles
from homolog.files.project import Project
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["MEAN_SURFACE", "Result", "particle_file", "read_result"]

MEAN_SURFACE = "mean.vtp"
"""File of the mean surface in the project's ``model`` folder, in world coordinates."""


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Corresponding particles on the subjects' surfaces.

    Attributes
    ----------
    names : tuple of str
        The M subjects, in the project's order.
    groups : tuple of str or None
        Their groups.
    columns : tuple of mappings
        The manifest's further columns of each.
    world, local : (M, N, 3) float64 arrays
        Particles [mm] in aligned coordinates and in those of the input files, read-only.
    alignments : (M, 4, 4) float64 array
        Similarities from local to world, read-only.
    mean_surface : TriangleMesh
        The mean shape, in world coordinates.
    """

    names: tuple[str, ...]
    groups: tuple[str | None, ...]
    columns: tuple[Mapping[str, str], ...]
    world: FloatArray
    local: FloatArray
    alignments: FloatArray
    mean_surface: TriangleMesh


def particle_file(project: Project, stem: str, frame: str) -> Path:
    """Return the path of a subject's particles; `frame` is ``"local"`` or ``"world"``."""
    return project.particles / f"{stem}_{frame}.particles"


def read_result(project: Project) -> Result:
    """Read the last result of a project.

    Raises
    ------
    InputError
        If there is none, or one of its files is missing or damaged.
    """
    project.recover()
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result yet; run it first: homolog run {project.folder}")
    subjects = record.subjects
    world, local = (
        [read_particles(particle_file(project, one.file, frame)) for one in subjects]
        for frame in ("world", "local")
    )
    for one, *both in zip(subjects, world, local, strict=True):
        if any(len(points) != record.particles for points in both):
            raise InputError(
                f"{project.folder}: the particles of {one.name} are not {record.particles}; run again"
            )
    return Result(
        names=tuple(one.name for one in subjects),
        groups=tuple(one.group for one in subjects),
        columns=tuple(one.columns for one in subjects),
        world=frozen(np.array(world)),
        local=frozen(np.array(local)),
        alignments=frozen(np.array([one.alignment for one in subjects])),
        mean_surface=read_mesh(project.model / MEAN_SURFACE),
    )
