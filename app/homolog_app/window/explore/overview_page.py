"""The page *Overview*: the result, what to do next, and stored answers."""

from PySide6.QtCore import Qt

from homolog.errors import InputError
from homolog_app.report.request import kept_studies
from homolog_app.window.actions import Actions
from homolog_app.window.explore.group_results import StoredAnswers
from homolog_app.window.explore.page import ExplorePage, ModelCache
from homolog_app.window.widgets import GRID, ActionButton, label
from homolog_app.window.workspace import Workspace

__all__ = ["OverviewPage"]


_NEXT = {
    "explore.modes": "What varies? Modes",
    "explore.groups": "What differs? Groups and numbers",
    "explore.check": "Can it be trusted? Check",
    "explore.measure": "How large? Measure",
    "explore.patient": "How unusual is one patient? Patient",
}


class OverviewPage(ExplorePage):
    """An overview of the result, with links to the other pages."""

    title = "Overview"
    hint = "Equal colours mark corresponding places."

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        session = self._session = workspace.session
        self._busy = False
        self.summary = label("", wrap=True)
        self.summary.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.files = label("", "Hint", wrap=True)
        self.files.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.body.addWidget(label("Result", "SectionTitle"))
        self.body.addWidget(self.summary)
        self.body.addSpacing(GRID)
        self.body.addWidget(label("What next", "SectionTitle"))
        for command, title in _NEXT.items():
            self.body.addWidget(ActionButton(title, actions[command]))
        self.body.addSpacing(GRID)
        self.kept_title = label("Answers stored in the project", "SectionTitle")
        self.kept = StoredAnswers()
        self.outdated = label("", "Problem", wrap=True)
        self.outdated.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.kept_hint = label("Double-click an answer to see it.", "Hint")
        for widget in (self.kept_title, self.kept, self.kept_hint, self.outdated):
            self.body.addWidget(widget)
        self.body.addSpacing(GRID)
        self.body.addWidget(label("Playback", "SectionTitle"))
        self.playback = label("", "Hint", wrap=True)
        self.body.addWidget(self.playback)
        self.body.addSpacing(GRID)
        self.body.addWidget(label("Files", "SectionTitle"))
        self.body.addWidget(self.files)
        self.body.addStretch()
        self.save = ActionButton("Save project…", actions["file.save"], "primary")
        self.footer.addWidget(self.save)
        session.result_changed.connect(self._show)
        workspace.session.job_changed.connect(self._follow_work)
        session.project_changed.connect(self._show)

    def enter(self) -> None:
        """Read the stored answers again."""
        self._show()

    def _follow_work(self) -> None:
        """Read the stored answers again after a new answer or new particles."""
        busy = self.workspace.session.job.is_busy
        if self._busy and not busy:
            self._show_kept()
        self._busy = busy

    def _show_kept(self) -> None:
        """List the answers in the project's folder, those of an earlier result apart."""
        try:
            kept = kept_studies(self.workspace.project) if self._session.folder else []
        except InputError as error:
            kept, text = [], str(error)
        else:
            old = [study.request.title for study in kept if study.is_outdated]
            text = "\n".join(
                ["Out of date: particles were placed again. Compare again, or write the report:", *old]
            ) if old else ""  # fmt: skip
        self.kept.show_answers([study for study in kept if not study.is_outdated])
        self.outdated.setText(text)
        self.kept_hint.setVisible(not self.kept.isHidden())
        self.outdated.setVisible(bool(text))
        self.kept_title.setVisible(bool(kept or text))

    def _show(self) -> None:
        self._show_kept()
        loaded = self._session.result
        self.summary.setText(loaded.summary if loaded else "")
        self.playback.setText(
            "Space replays the run from its stored frames; the slider below the views seeks."
            if loaded and loaded.frames
            else "This run can't be replayed: only runs in the window record frames."
        )
        folder = self._session.folder
        self.base.setVisible(self._session.folder is None)
        self.files.setText(
            f"Particles, shape model and tables are in {folder}."
            if folder
            else "Save the project to keep particles, shape model and tables."
        )
