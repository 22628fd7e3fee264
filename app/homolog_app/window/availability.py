"""What is possible now: the words that commands name as their needs."""

from collections.abc import Mapping

from homolog.files.project import Project
from homolog_app.window.session import Session

__all__ = ["available"]


def available(
    session: Session,
    project: Project,
    *,
    busy: bool,
    running: bool,
    kept: bool,
    page: int,
    pages: int,
    ready: bool,
    plays: bool,
) -> Mapping[str, bool]:
    """Return whether each need of the command table is met.

    Parameters
    ----------
    session : Session
    project : Project
        The open project, or the draft.
    busy, running : bool
        Whether the user waits for a job; whether that job is a run.
    kept : bool
        Whether a run was cancelled whose particles can be kept.
    page, pages : int
        Of the views.
    ready : bool
        Whether the views are there.
    plays : bool
        Whether the open page of Explore plays something.
    """
    study = session.is_open and ready
    idle = not busy
    chosen = bool(session.selection)
    two = len(session.study.included) >= 2
    groomed = study and bool(session.groomed or session.result)
    return {
        "always": True,
        "idle": idle,
        "study": study,
        "unsaved": study and idle and (session.folder is None or not session.undo.isClean()),
        "cohort": study and idle and bool(session.study.included),
        "undo": idle and session.undo.canUndo(),
        "redo": idle and session.undo.canRedo(),
        "selection": study and idle and chosen,
        "removable": study and idle and chosen,
        "groomed": groomed,
        "groomed_selection": study and idle and chosen and session.selection[0] in session.groomed,
        "two": study and two,
        "ready": study and idle and two and (session.is_groomed or session.result is not None),
        "busy": busy,
        "running": running,
        "resumable": study and idle and two and project.checkpoint.is_file(),
        "cancelled": study and idle and kept,
        "result": study and session.result is not None,
        "particles": study and (running or session.result is not None),
        "idle_result": study and idle and session.result is not None,
        "frames": study and idle and session.result is not None and (plays or len(session.result.frames) > 1),
        "previous_page": study and page > 0,
        "next_page": study and page + 1 < pages,
    }
