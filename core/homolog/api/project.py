"""A finished project folder, opened."""

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np

from homolog.analysis.reconstruction import carried
from homolog.arrays import ArrayLike, FloatArray
from homolog.files.project import Project as Folder
from homolog.files.records import ResultRecord
from homolog.files.results import read_result, read_surface
from homolog.settings import RunSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Project", "surface_at"]


class Project:
    """A project folder with a result, as ``homolog run``, the window or `Correspondence.save` wrote it.

    The result is read when the project is opened; later runs do not change it. All arrays are read-only.

    Parameters
    ----------
    folder : path
        The project.

    Attributes
    ----------
    folder : Path
    names : tuple of str
        The M subjects.
    groups : tuple of str or None
        Their groups, as the cohort's table has them now.
    covariates : dict of str to tuple of str
        The further columns of the cohort's table, one value for each subject, empty where missing.
    particles : (M, N, 3) float64 array
        Each subject's particles in the frame of its file [mm]. The same index is the same place on all
        subjects.
    aligned : (M, N, 3) float64 array
        The same in one common frame [mm]: what statistics are computed from.
    alignments : (M, 4, 4) float64 array
        Similarities that take particles to aligned ones; reflections for subjects that were mirrored.
    settings : RunSettings
        Of the run.
    converged : bool
        Whether the run's objective had come to rest; False for models of other programs.
    notes : tuple of str
        What was found and changed: a line for each finding on a subject.

    Raises
    ------
    InputError
        If the folder is no project, has no result, or one of its files is missing or damaged.
    """

    folder: Path
    names: tuple[str, ...]
    groups: tuple[str | None, ...]
    covariates: Mapping[str, tuple[str, ...]]
    particles: FloatArray
    aligned: FloatArray
    alignments: FloatArray
    settings: RunSettings
    converged: bool
    notes: tuple[str, ...]

    def __init__(self, folder: str | PathLike[str]) -> None:
        self.folder = Path(folder)
        self._folder = Folder(self.folder)
        result = read_result(self._folder)
        columns = dict.fromkeys(column for own in result.columns for column in own)
        self.names, self.groups = result.names, result.groups
        self.covariates = {column: tuple(own.get(column, "") for own in result.columns) for column in columns}
        self.particles, self.aligned, self.alignments = result.local, result.world, result.alignments
        self.settings = self._record.settings
        self.converged = self._record.ended == "converged"
        self.notes = tuple(
            f"{subject.name}: {note}" for subject in self._record.subjects for note in subject.notes
        )
        self._mean_surface, self._smoothing = result.mean_surface, result.smoothing

    def __repr__(self) -> str:
        """Return a line for people."""
        subjects, count = self.particles.shape[:2]
        return f"Project({str(self.folder)!r}: {count} particles on {subjects} subjects)"

    @cached_property
    def _record(self) -> ResultRecord:
        record = self._folder.read().result
        assert record is not None, "a result was read"
        return record

    @cached_property
    def meshes(self) -> tuple[TriangleMesh, ...]:
        """The smoothed surfaces that the particles lie on, each in its own frame; read on first use."""
        return tuple(read_surface(self._folder, subject) for subject in self._record.subjects)

    def surface(self, particles: ArrayLike | None = None) -> TriangleMesh:
        """Return the surface of aligned particles: the project's mean surface, warped to them.

        Parameters
        ----------
        particles : (N, 3) array_like, optional
            Such as ``ShapeModel.instance([2.0])`` [mm]; the mean of `aligned` if not given.

        Returns
        -------
        TriangleMesh
            In the common frame; the same faces for all particles.
        """
        return surface_at(self.aligned.mean(axis=0), self._mean_surface, self._smoothing, particles)


def surface_at(
    mean: FloatArray, surface: TriangleMesh, smoothing: FloatArray, particles: ArrayLike | None
) -> TriangleMesh:
    """Return a mean surface, warped to particles.

    Parameters
    ----------
    mean : (N, 3) array
        Mean particles [mm].
    surface : TriangleMesh
        The mean surface.
    smoothing : (N,) array
        Of the spline that carries it [mm]; see `homolog.analysis.reconstruction.carried`.
    particles : (N, 3) array_like or None
        Where to [mm]; None for the mean surface itself.

    Returns
    -------
    TriangleMesh
    """
    if particles is None:
        return surface
    move = np.asarray(particles, np.float64) - mean
    moved = carried(mean, surface.vertices, move[None], smoothing)[0]
    return TriangleMesh(surface.vertices + moved, surface.faces)
