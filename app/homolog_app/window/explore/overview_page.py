"""The result at a glance, and the run played again."""

from PySide6.QtCore import Qt

from homolog.errors import InputError
from homolog_app.report.request import kept_studies
from homolog_app.window.actions import Actions
from homolog_app.window.explore.model_cache import ModelCache
from homolog_app.window.explore.page import ExplorePage
from homolog_app.window.widgets import GRID, ActionButton, label
from homolog_app.window.workspace import Workspace

__all__ = ["OverviewPage"]


_NEXT = {
    "explore.modes": "What varies? Modes",
    "explore.groups": "What differs? Groups and numbers",
    "explore.check": "Can it be trusted? Check",
    "explore.measure": "How large? Measure",
}


class OverviewPage(ExplorePage):
    """What the run came to, and how to look at it."""

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
        self.kept_title = label("Answers kept in the project", "SectionTitle")
        self.kept = label("", wrap=True)
        self.outdated = label("", "Problem", wrap=True)
        for listed in (self.kept, self.outdated):
            listed.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        for text in (self.kept_title, self.kept, self.outdated):
            self.body.addWidget(text)
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
        session.facts_changed.connect(self._show)
        workspace.work.changed.connect(self._follow_work)
        session.project_changed.connect(self._show)

    def enter(self) -> None:
        """Read anew what is kept."""
        self._show()

    def _follow_work(self) -> None:
        """Look again once an answer was kept or particles were placed."""
        busy = self.workspace.work.is_busy
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
            old = [study.title for study, outdated in kept if outdated]
            text = "\n".join(
                ["Out of date, since particles were placed again: compare again, or write the report:", *old]
            ) if old else ""  # fmt: skip
        self.kept.setText("\n".join(study.title for study, outdated in kept if not outdated))
        self.outdated.setText(text)
        self.kept.setVisible(bool(self.kept.text()))
        self.outdated.setVisible(bool(text))
        self.kept_title.setVisible(bool(kept or text))

    def _show(self) -> None:
        self._show_kept()
        loaded = self._session.result
        self.summary.setText(loaded.summary if loaded else "")
        self.playback.setText(
            "Space replays the run from its stored frames; the slider below the views seeks."
            if loaded and loaded.frames
            else "This run can't be played: only the window keeps frames of its runs."
        )
        folder = self._session.folder
        self.base.setVisible(self._session.folder is None)
        self.files.setText(
            f"Particles, shape model and tables are in {folder}."
            if folder
            else "Save the project to keep particles, shape model and tables."
        )
