"""A finished project folder, opened."""

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path

from homolog.api.mean_shape import HasMeanShape, MeanShape
from homolog.arrays import FloatArray
from homolog.files.project import ProjectFolder
from homolog.files.records import ResultRecord
from homolog.files.results import read_result, read_surface
from homolog.settings import RunSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Project"]


class Project(HasMeanShape):
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
        Their groups, from the present table.
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
        Whether the run converged; False for models of other programs.
    notes : tuple of str
        Findings and changes, one line each.

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
        self._folder = ProjectFolder(self.folder)
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

    @cached_property
    def _mean_shape(self) -> MeanShape:
        return MeanShape(self.aligned.mean(axis=0), self._mean_surface, self._smoothing)
