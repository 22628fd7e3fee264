"""The commands of the window as data, and which of them are possible."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from homolog.io.project import ProjectFolder
from homolog_app.window.session import Session

__all__ = ["COMMANDS", "LAYOUTS", "MENUS", "Command", "WindowState", "command", "obstacles"]


MENUS = ("File", "Edit", "View", "Run", "Explore", "Help")


@dataclass(frozen=True, slots=True)
class Command:
    """One command.

    Attributes
    ----------
    id : str
        ``area.name``; its handler is looked up by it.
    title : str
        Text in the menu.
    help : str
        One sentence: tooltip and second line in the palette.
    menu : str
        One of `MENUS`; ``Menu/Submenu`` nests.
    shortcut : str
        Portable text of the key sequence, or nothing.
    icon : str
        File name without suffix in the resources, or nothing.
    needs : str
        Requirement: a name that `obstacles` returns.
    checkable : bool
        Whether it switches something on and off.
    choice : str
        Commands with the same word are alternatives: one of them is on.
    ends_section : bool
        Whether a line follows in the menu.
    writes : bool
        Whether it writes into the project's folder, which is not possible in read-only mode.
    """

    id: str
    title: str
    help: str
    menu: str
    shortcut: str = ""
    icon: str = ""
    needs: str = "always"
    checkable: bool = False
    choice: str = ""
    ends_section: bool = False
    writes: bool = False


COMMANDS = (
    Command("file.new", "New from folder…", "Start a study from a folder of segmentations or surfaces.",
            "File", "Ctrl+N", "new", "idle"),
    Command("file.add", "Add files…", "Add segmentations or surfaces to the study.",
            "File", "Ctrl+Shift+N", "files", "idle"),
    Command("file.open", "Open project…", "Open a project folder.", "File", "Ctrl+O", "open", "idle"),
    Command("file.sample_hearts", "Sample study: hearts",
            "Generate twenty left ventricles, half of them after an infarct, and show the tour.",
            "File", "", "heart", "idle"),
    Command("file.sample_vertebrae", "Sample study: vertebrae",
            "Generate twenty vertebrae, half of them fractured; a tour.", "File", "", "vertebra", "idle"),
    Command("file.sample_femora", "Sample study: femora",
            "Generate twenty upper ends of femora and show the tour.", "File", "", "femur", "idle"),
    Command("file.sample", "Sample study: coffee beans",
            "Generate ten coffee beans and show the tour.", "File", "", "bean", "idle", ends_section=True),
    Command("file.save", "Save", "Save the project.", "File", "Ctrl+S", "save", "unsaved", writes=True),
    Command("file.save_as", "Save as…", "Save the project to another folder.",
            "File", "Ctrl+Shift+S", "save", "study", ends_section=True),
    Command("file.import", "Import table…", "Add or replace groups and covariates from a table.",
            "File", "", "import", "study"),
    Command("file.import_model", "Import model…",
            "Make a project of a ShapeWorks project or a folder of particles.", "File", "", "import", "idle"),
    Command("file.export", "Export table…", "Write names, files, groups and covariates to a CSV file.",
            "File", "", "export", "study"),
    Command("export.film", "Film…", "Modes, groups or a turning shape as MP4, GIF or pictures.",
            "File/Export", "Ctrl+Alt+F", "play", "result"),
    Command("export.still", "Picture…", "The shape as a picture of any size.",
            "File/Export", "Ctrl+Alt+P", "screenshot", "result"),
    Command("export.plot", "Plot…", "Eigenvalues, scores, quality or groups as vector graphics.",
            "File/Export", "", "curves", "result"),
    Command("export.meshes", "Meshes…", "Mean, modes, groups and subjects as VTP, PLY, STL or GLB.",
            "File/Export", "", "grid4", "result"),
    Command("export.table", "Tables…", "Scores, measures and group results as CSV.",
            "File/Export", "", "log", "result"),
    Command("export.particles", "Particles…", "A .particles file for each subject.",
            "File/Export", "", "particles", "result"),
    Command("export.shapeworks", "ShapeWorks project…", "A project that ShapeWorks Studio opens.",
            "File/Export", "", "files", "result"),
    Command("export.markups", "Slicer markups…", "A point list for each subject, for 3D Slicer.",
            "File/Export", "", "locate", "result"),
    Command("export.morphometrics", "Morphometrics files…", "TPS, NTS and Morphologika, for R or MorphoJ.",
            "File/Export", "", "particles", "result"),
    Command("export.report", "Report…", "The model and its studies, as HTML and PDF.",
            "File/Export", "", "explore", "result", writes=True),
    Command("file.print", "Print patient…", "Print the pages of the patient's report, also of a follow-up.",
            "File", "Ctrl+P", "print", "patient", ends_section=True),
    Command("file.close", "Close project", "Go back to the start page.", "File", "Ctrl+W", "", "study"),
    Command("file.quit", "Quit", "Close the window.", "File", "Ctrl+Q"),
    Command("edit.undo", "Undo", "Undo the last edit of cohort or settings.",
            "Edit", "Ctrl+Z", "undo", "undo"),
    Command("edit.redo", "Redo", "Redo the last edit that was undone.",
            "Edit", "Ctrl+Shift+Z", "redo", "redo", ends_section=True),
    Command("edit.group", "Set group…", "Assign the selected subjects to a group.",
            "Edit", "Ctrl+G", "tag", "selection"),
    Command("edit.include", "Include or exclude", "Include the selected subjects, or exclude them.",
            "Edit", "Ctrl+E", "exclude", "selection"),
    Command("edit.remove", "Remove", "Remove the selected subjects from the list; their files stay.",
            "Edit", "Ctrl+Backspace", "remove", "removable", ends_section=True),
    Command("edit.preferences", "Preferences…", "Colours, confirmations.", "Edit", "Ctrl+,", "preferences"),
    Command("view.cohort", "Cohort", "Subjects of the study.", "View/Step", "F2", "cohort", "study"),
    Command("view.groom", "Groom", "From segmentations to smooth surfaces.",
            "View/Step", "F3", "groom", "study"),
    Command("view.correspond", "Correspond", "Place the particles.", "View/Step", "F4", "correspond", "two"),
    Command("view.explore", "Explore", "Look at the result and play the run again.",
            "View/Step", "F5", "explore", "model"),
    Command("view.grid1", "1 view", "One subject, or the shape at the sliders.",
            "View/Layout", "Ctrl+1", "grid1", "grid1", True, "grid"),
    Command("view.grid4", "4 views", "Four subjects, or steps along two modes.",
            "View/Layout", "Ctrl+2", "grid4", "grid4", True, "grid"),
    Command("view.grid9", "9 views", "Nine subjects, or steps along three modes.",
            "View/Layout", "Ctrl+3", "grid9", "grid9", True, "grid"),
    Command("view.grid16", "16 views", "Sixteen subjects, or steps along four modes.",
            "View/Layout", "Ctrl+4", "grid16", "grid16", True, "grid"),
    Command("view.previous", "Previous page", "Show the previous subjects.",
            "View/Layout", "PgUp", "previous", "previous_page"),
    Command("view.next", "Next page", "Show the next subjects.",
            "View/Layout", "PgDown", "next", "next_page"),
    Command("view.link", "Link cameras", "Rotate all views together.",
            "View/Camera", "L", "link", "views", True),
    Command("view.reset", "Fit to view", "Show the whole shapes.", "View/Camera", "R", "reset", "views"),
    Command("view.corner", "Oblique", "Look from above, the front and the right.",
            "View/Camera", "C", "axes", "views"),
    Command("view.right", "From the right", "Look from the patient's right (R).",
            "View/Camera", "X", "axes", "views"),
    Command("view.left", "From the left", "Look from the patient's left (L).",
            "View/Camera", "Shift+X", "axes", "views"),
    Command("view.front", "From the front", "Look from the front (A).", "View/Camera", "Y", "axes", "views"),
    Command("view.back", "From behind", "Look from behind (P).", "View/Camera", "Shift+Y", "axes", "views"),
    Command("view.feet", "From below", "Look from the feet (I).", "View/Camera", "Z", "axes", "views"),
    Command("view.head", "From above", "Look from the head (S).", "View/Camera", "Shift+Z", "axes", "views"),
    Command("view.raw", "Input surface", "Show the segmentation as it is in the file.",
            "View", "1", "layers", "raw", True),
    Command("view.groomed", "Groomed surface", "Show the surface that grooming made.",
            "View", "2", "groom", "groomed", True),
    Command("view.particles", "Particles", "Show the corresponding particles.",
            "View", "3", "particles", "particles", True),
    Command("view.slice", "Slices", "Show the file's slices with the groomed contour.",
            "View", "4", "slice", "study", True),
    Command("view.clip", "Cut away", "Cut the shapes open with a plane, to see what is inside.",
            "View", "5", "cut", "views", True, ends_section=True),
    Command("view.letters", "Directions", "Show the patient's directions at the edges: R, L, A, P, S, I.",
            "View", "", "axes", "views", True),
    Command("view.scale_bar", "Scale bar", "Show a scale bar in millimetres.",
            "View", "", "ruler", "views", True, ends_section=True),
    Command("view.from_middle", "Positive away from the centre",
            "Count displacements as positive away from the shape's centre: on the inner wall of a hollow "
            "organ, blue then means a larger cavity. Otherwise blue means outward from the tissue.",
            "View", "", "range", "coloured", True),
    Command("view.range", "Colour range…", "Set the lowest and highest value of the colour scale.",
            "View", "", "range", "coloured"),
    Command("view.screenshot", "Screenshot…", "Save a picture of the views, up to four times as large.",
            "View", "Ctrl+Alt+S", "screenshot", "picture"),
    Command("view.copy", "Copy picture", "Copy a picture of the views to the clipboard.",
            "View", "Ctrl+Shift+C", "copy", "picture", ends_section=True),
    Command("view.theme", "Light or dark", "Change between the light and the dark scheme.",
            "View", "Ctrl+Shift+D", "theme"),
    Command("view.plots", "Plots", "Show plots and curves below the views, or leave the space to the shapes.",
            "View", "6", "curves", "views", True),
    Command("view.log", "Log", "Show the program's messages.", "View", "Ctrl+L", "log", checkable=True),
    Command("run.groom", "Groom", "Compute smooth surfaces of the included subjects.",
            "Run", "Ctrl+Shift+G", "groom", "cohort", writes=True),
    Command("edit.carry", "Carry cuts to all", "Cut all subjects at the places that correspond.",
            "Edit", "", "cut", "cut_selection"),
    Command("edit.uncut", "Remove cuts", "Leave the selected subjects whole.",
            "Edit", "", "remove", "cut_selection"),
    Command("run.regroom", "Groom selected again", "Groom only the selected subject.",
            "Run", "", "redo_one", "groomed_selection", ends_section=True, writes=True),
    Command("run.start", "Run", "Place the particles.", "Run", "Ctrl+R", "play", "ready", writes=True),
    Command("run.pause", "Pause or resume", "Pause the run at the next step, or resume it.",
            "Run", "Ctrl+Space", "pause", "running"),
    Command("run.cancel", "Cancel", "Stop at once, and keep the particles.", "Run", "Ctrl+.", "stop", "busy"),
    Command("run.resume", "Resume", "Continue from the last checkpoint.",
            "Run", "Ctrl+Shift+R", "next", "resumable", ends_section=True, writes=True),
    Command("run.more", "Add particles",
            "Split the particles of the result until there are as many as in the settings.",
            "Run", "", "correspond", "more", writes=True),
    Command("run.fit", "Fit new subjects", "Give new subjects the result's particles; others keep theirs.",
            "Run", "", "correspond", "fit", ends_section=True, writes=True),
    Command("run.keep", "Keep particles", "Save the particles of the cancelled run as the result.",
            "Run", "Ctrl+K", "done", "cancelled", writes=True),
    Command("run.play", "Play", "Play the finished run from its stored frames, or the open page's mode.",
            "Run", "Space", "play", "frames"),
    Command("explore.modes", "Modes", "What varies: the shape along its modes of variation.",
            "Explore", "F6", "", "model"),
    Command("explore.groups", "Groups", "What differs between groups, with its tests.",
            "Explore", "F7", "", "result"),
    Command("explore.measure", "Measure", "Distance, volume and area along a mode and for each subject.",
            "Explore", "F8", "", "result"),
    Command("explore.check", "Check", "Find and repair places where the correspondence may be wrong.",
            "Explore", "F9", "", "result"),
    Command("explore.patient", "Patient", "One shape against the controls: how unusual, and where.",
            "Explore", "F10", "", "result", ends_section=True),
    Command("explore.mean", "Mean shape", "Set all modes to zero.", "Explore", "M", "", "model"),
    Command("explore.test", "Compare groups", "Test the chosen groups for a difference.",
            "Explore", "Ctrl+T", "", "idle_result"),
    Command("explore.keep", "Add to report", "Store the tables of this comparison in the project.",
            "Explore", "", "save", "answer", writes=True),
    Command("explore.compare", "Compare with…", "Show the result of another project next to this one.",
            "Explore", "Ctrl+B", "", "idle_result", ends_section=True),
    Command("explore.plan", "Plan a study…",
            "Power and needed numbers of a study of two groups, with this project as the pilot.",
            "Explore", "", "", "idle_result"),
    Command("explore.table", "Export measures…", "Write distance, volume and area of each subject to CSV.",
            "Explore", "", "export", "result"),
    Command("explore.distances", "Export distances…", "Write the surface with its distances from another.",
            "Explore", "", "export", "model"),
    Command("check.look", "Find suspects", "Find places where the correspondence may be wrong.",
            "Explore/Suspects", "", "search", "idle_result"),
    Command("check.next", "Next suspect", "Go to the next place in the list of suspects.",
            "Explore/Suspects", "N", "next", "result"),
    Command("check.mend", "Optimize again here", "Optimize the particles around the chosen suspect again.",
            "Explore/Suspects", "Ctrl+M", "redo_one", "idle_result"),
    Command("check.mend_all", "Optimize again at all suspects",
            "Optimize the particles around every suspect in the list again.",
            "Explore/Suspects", "", "redo_one", "idle_result"),
    Command("check.keep", "Save to project", "Save repaired particles to the project.",
            "Explore/Suspects", "", "save", "idle_result", writes=True),
    Command("check.export", "Export suspects…", "Write the list of suspects to a CSV or JSON file.",
            "Explore/Suspects", "", "export", "result"),
    Command("patient.reference", "Make reference", "Make a reference model of the chosen controls.",
            "Explore/Patient", "", "", "idle_result"),
    Command("patient.open_reference", "Open reference…", "Open a saved reference.",
            "Explore/Patient", "", "open", "idle_result"),
    Command("patient.keep_reference", "Save reference…",
            "Save the reference to a file without the controls' shapes.",
            "Explore/Patient", "", "save", "reference", ends_section=True),
    Command("patient.open", "Compare patient…", "Compare a segmentation or a surface with the reference.",
            "Explore/Patient", "", "files", "reference"),
    Command("patient.groups", "Compare with groups…",
            "Compare the patient with further groups, from their references.",
            "Explore/Patient", "", "open", "patient"),
    Command("patient.later", "Add later time…", "Compare the patient with a segmentation of a later time.",
            "Explore/Patient", "", "files", "patient"),
    Command("patient.repeat", "Add repeated segmentation…",
            "Add another segmentation of the first time, to estimate the measurement error.",
            "Explore/Patient", "", "files", "patient"),
    Command("patient.save", "Save report…", "Write the patient's report, tables and surfaces to a folder.",
            "Explore/Patient", "", "export", "patient"),
    Command("help.palette", "Find a command…", "Search commands by name.", "Help", "Ctrl+Shift+P", "search"),
    Command("help.shortcuts", "Keyboard shortcuts", "List every shortcut.", "Help", "F1", "keyboard"),
    Command("help.tour", "Tour", "Show the tour again.", "Help", "", "help", "study", ends_section=True),
    Command("help.report", "Save problem report…", "Write settings, versions and messages to a file.",
            "Help", "", "log"),
    Command("help.about", "About Homolog", "Version, device and licence.", "Help", "", "help"),
)  # fmt: skip

_BY_ID = {entry.id: entry for entry in COMMANDS}


def command(identifier: str) -> Command:
    """Return the command of an id."""
    return _BY_ID[identifier]


LAYOUTS = (1, 4, 9, 16)
"""Numbers of views that have commands."""

_NO_STUDY = "nothing is open"
_NO_RESULT = "there is no result yet; run first"
_BUSY = "something is being computed; wait for it or cancel it"
_SELECT = "select subjects in Cohort first"
_TWO = "two included subjects are needed"
_REASONS: Mapping[str, str] = {
    "unsaved": "everything is saved",
    "cohort": "no subject is included",
    "undo": "there is nothing to undo",
    "redo": "nothing was undone",
    "selection": _SELECT,
    "removable": _SELECT,
    "groomed": "the shapes are not groomed yet",
    "views": "slices are shown; switch them off (4)",
    "groomed_selection": "the selected subject is not groomed yet",
    "cut_selection": "nothing is cut away of the selected subject",
    "two": _TWO,
    "ready": "the shapes are not groomed yet",
    "busy": "nothing is being computed",
    "running": "no run is in progress",
    "resumable": "there is no unfinished run",
    "cancelled": "no run was cancelled",
    "result": _NO_RESULT,
    "model": _NO_RESULT,
    "particles": _NO_RESULT,
    "idle_result": _NO_RESULT,
    "fit": "include new subjects in addition to those of the result, with its settings; save it first",
    "more": "set more particles than the result has, with the same subjects and settings; save it first",
    "answer": "compare groups first",
    "reference": "make or open a reference on the page Patient first",
    "patient": "compare a patient's file first",
    "frames": "there is nothing to play here",
    "previous_page": "this is the first page",
    "next_page": "this is the last page",
    "raw": "a shape of the model has no input surface",
    "coloured": "the views show no colours of a model",
    **{f"grid{count}": "the open page has no such number of views" for count in LAYOUTS},
}
"""Reasons why a command is disabled, by requirement; `obstacles` adds those that several share."""


@dataclass(frozen=True, slots=True)
class WindowState:
    """What determines which commands are enabled, in addition to the session."""

    busy: bool  # the user waits for a job
    running: bool  # that job is a run
    kept: bool  # a run was cancelled whose particles can be kept
    page: int  # of the views
    pages: int
    ready: bool  # the views have been created
    plays: bool  # the open page of Explore plays something
    answered: bool  # a question about groups or a number was answered
    reference: bool  # there is a reference for patients
    patient: bool  # a patient was compared with it
    layouts: Collection[int]  # numbers of views that can be chosen
    model: bool  # the views show shapes of the model
    slices: bool  # slices of a file are shown
    coloured: bool  # a colour scale is shown whose ends can be set
    preliminary: bool  # there is a model of a run that has not finished


def obstacles(session: Session, project: ProjectFolder, state: WindowState) -> Mapping[str, str]:
    """Return why each requirement of the command table is not met, for an open project or a draft.

    Empty texts are requirements that are met; others end the sentence "Not now: …".
    """
    unopened = "" if session.is_open and state.ready else _NO_STUDY
    busy = _BUSY if state.busy else ""
    undo = {"undo": session.undo.canUndo(), "redo": session.undo.canRedo()}
    return {
        "always": "",
        "idle": busy,
        "study": unopened,
        "picture": unopened,
        **_unmet({"busy": state.busy, "running": state.running}, ""),
        **_unmet(undo, busy),
        **_unmet(_of_views(state) | _of_result(session, state), unopened),
        **_unmet(_of_idle_study(session, project, state), unopened or busy),
    }


def _unmet(requirements: Mapping[str, bool], first: str) -> dict[str, str]:
    """Return why each requirement is not met: the first obstacle of all, or its own reason."""
    return {name: first or ("" if met else _REASONS[name]) for name, met in requirements.items()}


def _of_views(state: WindowState) -> dict[str, bool]:
    """Return which requirements the views meet, if a study is open."""
    return {
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
        "cut_selection": chosen
        and any(
            item.name == session.selection[0] and session.has_cuts(item) for item in session.study.included
        )
        and session.selection[0] in session.groomed,
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
