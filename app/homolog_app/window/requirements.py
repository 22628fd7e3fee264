"""Which commands of the window are possible now."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from homolog.files.project import ProjectFolder
from homolog_app.window.commands import LAYOUTS
from homolog_app.window.session import Session

__all__ = ["WindowState", "available"]


@dataclass(frozen=True, slots=True)
class WindowState:
    """What decides, besides the session, which commands are possible.

    Attributes
    ----------
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

    busy: bool
    running: bool
    kept: bool
    page: int
    pages: int
    ready: bool
    plays: bool
    answered: bool
    reference: bool
    patient: bool
    layouts: Collection[int]
    model: bool
    slices: bool
    coloured: bool
    preliminary: bool


def available(session: Session, project: ProjectFolder, state: WindowState) -> Mapping[str, bool]:
    """Return whether each requirement of the command table is met, for an open project or a draft."""
    study = session.is_open and state.ready
    return {
        "always": True,
        "idle": not state.busy,
        "busy": state.busy,
        "study": study,
        "undo": not state.busy and session.undo.canUndo(),
        "redo": not state.busy and session.undo.canRedo(),
        **{name: study and met for name, met in _of_views(state).items()},
        **{name: study and met for name, met in _of_result(session, state).items()},
        **{
            name: study and not state.busy and met
            for name, met in _of_idle_study(session, project, state).items()
        },
        "running": state.running,
    }


def _of_views(state: WindowState) -> dict[str, bool]:
    """Return which requirements the views meet, if a study is open."""
    return {
        "picture": True,
        "views": not state.slices,
        "raw": state.slices or not state.model,
        "coloured": state.coloured and not state.slices,
        "previous_page": state.page > 0,
        "next_page": state.page + 1 < state.pages,
        **{f"grid{count}": count in state.layouts for count in LAYOUTS},
    }


def _of_result(session: Session, state: WindowState) -> dict[str, bool]:
    """Return which requirements shapes and results meet, if a study is open."""
    result = session.result
    frames = not state.busy and result is not None and (state.plays or len(result.frames) > 1)
    return {
        "groomed": bool(session.groomed or result),
        "two": len(session.study.included) >= 2,
        "result": result is not None,
        "particles": state.running or result is not None,
        "model": result is not None or state.preliminary,
        "frames": frames or (state.preliminary and state.plays),
    }


def _of_idle_study(session: Session, project: ProjectFolder, state: WindowState) -> dict[str, bool]:
    """Return which requirements are met, if a study is open and nothing is being computed."""
    chosen, result = bool(session.selection), session.result is not None
    two = len(session.study.included) >= 2
    further = session.extension_of if session.is_result_written else None
    return {
        "unsaved": session.folder is None or not session.undo.isClean(),
        "cohort": bool(session.study.included),
        "selection": chosen,
        "removable": chosen,
        "groomed_selection": chosen and session.selection[0] in session.groomed,
        "ready": two and (session.is_groomed or result),
        "more": further is not None and further.particles > 0,
        "fit": further is not None and bool(further.subjects),
        "resumable": two and project.checkpoint.is_file(),
        "cancelled": state.kept,
        "idle_result": result,
        "answer": result and state.answered,
        "reference": result and state.reference,
        "patient": result and state.patient,
    }
