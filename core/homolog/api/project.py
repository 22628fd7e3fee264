"""A finished project folder, opened."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path

from pydantic import ValidationError

from homolog.api.mean_shape import HasMeanShape, MeanShape
from homolog.arrays import FloatArray
from homolog.errors import InputError, path_of
from homolog.inspection.verdict import Verdict, read_verdict
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord
from homolog.io.report_details import Axes, ReportDetails, read_details, write_details
from homolog.io.results import read_result, read_surface
from homolog.parameters import fault_text
from homolog.settings import RunSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Project"]


class Project(HasMeanShape):
    """A project folder with a result, as ``homolog run``, the window or `Correspondence.save` wrote it.

    The result is read when the project is opened; later runs do not change it. All arrays are read-only.

    Parameters
    ----------
    folder : path
        The project folder.

    Attributes
    ----------
    folder : Path
    names : tuple of str
        Names of the M subjects.
    groups : tuple of str or None
        Their groups, from the current table.
    covariates : dict of str to tuple of str
        The further columns of the cohort's table, one value for each subject, empty where missing.
    particles : (M, N, 3) float64 array
        Each subject's particles in the frame of its file [mm]. Particles of equal index correspond.
    aligned : (M, N, 3) float64 array
        Particles in one common frame [mm], the data of statistics.
    alignments : (M, 4, 4) float64 array
        Similarities from `particles` to `aligned`; reflections for mirrored subjects.
    settings : RunSettings
        Settings of the run.
    converged : bool
        Whether the run converged; False for models of other programs.
    notes : tuple of str
        Findings and changes, one line for each kind.

    Raises
    ------
    InputError
        If the folder is not a project, has no result, or one of its files is missing or damaged.
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
        self.folder = path_of(folder, "project")
        self._folder = ProjectFolder(self.folder)
        result = read_result(self._folder)
        columns = dict.fromkeys(column for own in result.columns for column in own)
        self.names, self.groups = result.names, result.groups
        self.covariates = {column: tuple(own.get(column, "") for own in result.columns) for column in columns}
        self.particles, self.aligned, self.alignments = result.local, result.world, result.alignments
        self.settings = self._record.settings
        self.converged = self._record.ended == "converged"
        self.notes = tuple(filter(None, [self._record.mirrored_text, *self._record.remarks]))
        self._mean_surface, self._smoothing = result.mean_surface, result.smoothing
        self._pieces = {part.name: (part.particles, part.vertices) for part in result.parts}

    def __repr__(self) -> str:
        """Return a one-line summary."""
        subjects, count = self.particles.shape[:2]
        return f"Project({str(self.folder)!r}: {count} particles on {subjects} subjects)"

    @property
    def structures(self) -> dict[str, Project]:
        """Of a model of several structures, the project of each alone, by name; empty for a single one."""
        return {name: Project(self._folder.structure(name).folder) for name in self._pieces}

    @property
    def _own(self) -> Mapping[str, slice]:
        return {name: particles for name, (particles, _) in self._pieces.items()}

    @property
    def details(self) -> ReportDetails:
        """Details for reports on structure, cohort and axes; read again on each use."""
        return read_details(self._folder)

    def describe(
        self,
        *,
        structure: str | None = None,
        cohort: str | None = None,
        axes: str | None = None,
        places: str | None = None,
    ) -> None:
        """Store details for reports in the project, as the options of ``homolog report`` do.

        Parameters
        ----------
        structure : str, optional
            Name of the structure, such as ``"left ventricle"``. None keeps the stored value, here and below.
        cohort : str, optional
            Description of the subjects: recruitment, criteria, meaning of the groups, scanner.
        axes : {"auto", "patient", "file"}, optional
            How locations are named. ``"patient"``: by the patient's directions (left, anterior, superior);
            ``"file"``: by the axes of the files (+x, -z); ``"auto"``: as ``"file"``, until somebody has
            confirmed that the axes are the patient's.
        places : str, optional
            Your own names of the structure's sides, such as ``"septal/lateral anterior/inferior
            basal/apical"``. Two for each axis: towards smaller and towards larger x, y and z.

        Raises
        ------
        InputError
            If a text is too long, `axes` has another value, `places` are not three pairs, or the project
            can't be written to.
        """
        if axes is not None and axes not in list(Axes):
            raise InputError(f"axes={axes!r}: choose one of {', '.join(Axes)}")
        given = {"structure": structure, "cohort": cohort, "axes": axes, "places": places}
        kept = {name: value for name, value in given.items() if value is not None}
        try:
            details = ReportDetails.model_validate(self.details.model_dump() | kept)
        except ValidationError as error:
            first = error.errors()[0]
            raise InputError(f"{first['loc'][0]}: {fault_text(first)}") from error
        with self._folder.locked(new=False):
            write_details(self._folder, details)

    @cached_property
    def verdict(self) -> Verdict:
        """How much of the model is reproducible, and what follows; judged now if it is not stored."""
        return read_verdict(self._folder, self.aligned)

    @cached_property
    def _record(self) -> ResultRecord:
        record = self._folder.read().result
        assert record is not None, "a result was read"
        return record

    @cached_property
    def meshes(self) -> tuple[TriangleMesh, ...]:
        """The smoothed surfaces of the particles, each in its own frame; read on first use."""
        return tuple(read_surface(self._folder, subject) for subject in self._record.subjects)

    def _surfaces(self) -> tuple[TriangleMesh, ...]:
        return self.meshes

    @cached_property
    def _mean_shape(self) -> MeanShape:
        pieces = tuple(self._pieces.values())
        return MeanShape(self.aligned.mean(axis=0), self._mean_surface, self._smoothing, pieces)
