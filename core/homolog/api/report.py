"""The report of a project in one call."""

from collections.abc import Callable
from importlib import import_module
from os import PathLike
from pathlib import Path

from homolog.api.project import Project
from homolog.errors import path_of
from homolog.inspection.verdict import refuse_unusable
from homolog.io.project import ProjectFolder
from homolog.progress import tick_of

__all__ = ["report"]


def report(
    project: str | PathLike[str],
    *,
    structure: str | None = None,
    cohort: str | None = None,
    axes: str | None = None,
    places: str | None = None,
    anyway: bool = False,
    callback: Callable[[float, str], object] | None = None,
) -> Path:
    """Write the report of a project's model and studies, as HTML and PDF, as ``homolog report`` does.

    Parameters
    ----------
    project : path
        A project with a result; the report contains the studies stored by `analyze`, the command line or the
        window.
    structure : str, optional
        Name of the structure; this and the following are stored as by `homolog.Project.describe`.
    cohort : str, optional
        Description of the subjects.
    axes : {"auto", "patient", "file"}, optional
        How locations are named.
    places : str, optional
        Own names of the structure's sides.
    anyway : bool
        Whether to use a model even if its verdict is *not usable*.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    Path
        The page ``report/report.html``, next to ``report.pdf`` and the figures.

    Raises
    ------
    InputError
        If there is no result or it is not usable, or the folder can't be written to.
    """
    folder = ProjectFolder(path_of(project, "project"))
    with folder.locked(new=False):
        opened = Project(project)
        if not anyway:
            refuse_unusable(folder, opened.aligned)
        opened.describe(structure=structure, cohort=cohort, axes=axes, places=places)
        # The report is drawn, and so the application's; the core must not depend on it.
        written: Path = import_module("homolog_app.report.write").write_report(folder, tick_of(callback))
        return written
