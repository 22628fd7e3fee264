"""What is possible now: the words that commands name as their needs."""

from collections.abc import Collection, Mapping

from homolog.files.project import ProjectFolder
from homolog_app.window.session import Session

__all__ = ["LAYOUTS", "REASONS", "available"]

LAYOUTS = (1, 4, 9, 16)
"""Numbers of views that there are commands for."""

_NO_STUDY = "nothing is open"
_NO_RESULT = "there is no result yet; run first"
_BUSY = "something is being computed; wait for it or cancel it"
_SELECT = "select subjects in Cohort first"
_TWO = "two included subjects are needed"
REASONS: Mapping[str, str] = {
    "idle": _BUSY,
    "study": _NO_STUDY,
    "unsaved": "everything is saved, or something is being computed",
    "cohort": "no subject is included, or something is being computed",
    "undo": "there is nothing to undo",
    "redo": "nothing was undone",
    "selection": _SELECT,
    "removable": _SELECT,
    "groomed": "the shapes are not groomed yet",
    "views": "slices are shown; switch them off (4)",
    "groomed_selection": "the selected subject is not groomed yet",
    "two": _TWO,
    "ready": "the shapes are not groomed yet, or something is being computed",
    "busy": "nothing is being computed",
    "running": "no run is in progress",
    "resumable": "there is no unfinished run",
    "cancelled": "no run was cancelled",
    "result": _NO_RESULT,
    "model": _NO_RESULT,
    "particles": _NO_RESULT,
    "idle_result": f"{_NO_RESULT}, or wait for what is being computed",
    "fit": "include new subjects in addition to those of the result, with its settings; save it first",
    "more": "set more particles than the result has, with the same subjects and settings; save it first",
    "answer": "compare groups first",
    "reference": "make or open a reference on the page Patient first",
    "patient": "compare a patient's file first",
    "frames": "there is nothing to play here",
    "previous_page": "this is the first page",
    "next_page": "this is the last page",
    "raw": "a shape of the model has no input surface",
    "picture": _NO_STUDY,
    "coloured": "the views show no colours of a model",
    **{f"grid{count}": "the open page has no such number of views" for count in LAYOUTS},
}
"""Why a command is not possible, by what it needs: ends the sentence "Not now: …"."""


def available(
    session: Session,
    project: ProjectFolder,
    *,
    busy: bool,
    running: bool,
    kept: bool,
    page: int,
    pages: int,
    ready: bool,
    plays: bool,
    answered: bool,
    reference: bool,
    patient: bool,
    layouts: Collection[int],
    model: bool,
    slices: bool,
    coloured: bool,
    preliminary: bool,
) -> Mapping[str, bool]:
    """Return whether each need of the command table is met.

    Parameters
    ----------
    session : Session
    project : ProjectFolder
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
    answered : bool
        Whether a question about groups or a number was answered.
    reference, patient : bool
        Whether there is a reference for patients, and a patient compared with it.
    layouts : collection of int
        Numbers of views that can be chosen.
    model, slices : bool
        Whether shapes of the model, or slices of a file, are seen.
    coloured : bool
        Whether a colour scale is shown whose ends can be set.
    preliminary : bool
        Whether there is a model of a run that has not finished.
    """
    study = session.is_open and ready
    idle = not busy
    chosen = bool(session.selection)
    two = len(session.study.included) >= 2
    groomed = study and bool(session.groomed or session.result)
    further = session.extension_of if session.is_result_written else None
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
        "views": study and not slices,
        "groomed_selection": study and idle and chosen and session.selection[0] in session.groomed,
        "two": study and two,
        "ready": study and idle and two and (session.is_groomed or session.result is not None),
        "more": study and idle and further is not None and further.particles > 0,
        "fit": study and idle and further is not None and bool(further.subjects),
        "answer": study and idle and session.result is not None and answered,
        "reference": study and idle and session.result is not None and reference,
        "patient": study and idle and session.result is not None and patient,
        "busy": busy,
        "running": running,
        "resumable": study and idle and two and project.checkpoint.is_file(),
        "cancelled": study and idle and kept,
        "result": study and session.result is not None,
        "particles": study and (running or session.result is not None),
        "idle_result": study and idle and session.result is not None,
        "model": study and (session.result is not None or preliminary),
        "frames": study
        and (
            (preliminary and plays)
            or (idle and session.result is not None and (plays or len(session.result.frames) > 1))
        ),
        "previous_page": study and page > 0,
        "next_page": study and page + 1 < pages,
        "raw": study and (slices or not model),
        "picture": study,
        "coloured": study and coloured and not slices,
        **{f"grid{count}": study and count in layouts for count in LAYOUTS},
    }
