"""Keeping an answer in its project: tables, and the question for the report."""

from pathlib import Path

from homolog.files.project import ProjectFolder
from homolog.files.results import Result
from homolog_app.report.request import Answered, study_folder, write_request
from homolog_app.report.study import Study
from homolog_app.report.surface_maps import SurfaceCarrier
from homolog_app.report.tables import write_study_tables

__all__ = ["keep_study"]


def keep_study(
    project: ProjectFolder, study: Study, result: Result, carrier: SurfaceCarrier | None = None
) -> Path:
    """Write a study's tables and its question into the project; returns their folder.

    Parameters
    ----------
    project : ProjectFolder
    study : Study
    result : Result
        That it was asked of.
    carrier : SurfaceCarrier, optional
        Of the result, if it is there already.

    Raises
    ------
    InputError
        If the project can't be written to.
    """
    folder = study_folder(project, study.request)
    answered = Answered.now(project)
    write_study_tables(folder, study, result, carrier or SurfaceCarrier.of(result), answered)
    write_request(study.request, folder, answered)
    return folder
