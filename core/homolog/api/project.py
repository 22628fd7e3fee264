"""A finished project folder, opened."""

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path

from pydantic import ValidationError

from homolog.api.mean_shape import HasMeanShape, MeanShape
from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog.files.records import ResultRecord
from homolog.files.report_details import Axes, ReportDetails, read_details, write_details
from homolog.files.results import read_result, read_surface
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

    @property
    def details(self) -> ReportDetails:
        """What reports say about structure, cohort and axes; read again on each use."""
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
            What the shapes are, such as ``"left ventricle"``. None keeps what is stored.
        cohort : str, optional
            Who the subjects are: recruitment, criteria, what the groups mean, scanner.
        axes : {"auto", "patient", "file"}, optional
            How places are named. ``"patient"``: by the patient's directions (left, anterior, superior);
            ``"file"``: by the axes of the files (+x, -z); ``"auto"``: patient if all files are images with
            these directions in their headers.
        places : str, optional
            Your own names of the structure's sides, such as ``"septal/lateral anterior/inferior
            basal/apical"``. Two for each axis: towards smaller and towards larger x, y and z.

        Raises
        ------
        InputError
            If a text is too long, `axes` is another word, `places` are not three pairs, or the project can't
            be written to.
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
