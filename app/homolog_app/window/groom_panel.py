"""The second step: from segmentations to smooth surfaces."""

from PySide6.QtCore import Qt, Signal

from homolog.settings import GroomSettings
from homolog.surfaces.mirroring import mirrors
from homolog_app.rendering.text import millilitres
from homolog_app.views.contents import Groomed
from homolog_app.window.actions import Actions
from homolog_app.window.form import SettingsPair
from homolog_app.window.runner import Status
from homolog_app.window.session import Session
from homolog_app.window.widgets import ActionButton, Panel, Progress, label, rule, set_primary

__all__ = ["GroomPanel"]

_MAIN = ("label", "smoothing", "alignment", "pieces")


class GroomPanel(Panel):
    """Settings of grooming, its button, and what it did to the selected subject."""

    settings_edited = Signal(str, object)

    def __init__(self, session: Session, actions: Actions) -> None:
        super().__init__(
            "Groom", "Fill, smooth and align the shapes. Check the contours before you continue."
        )
        self._session = session
        self.form = SettingsPair(GroomSettings, _MAIN)
        self.form.edited.connect(self.settings_edited)
        self.report = label("", "Hint", wrap=True)
        self.report.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.subject = label("", "SectionTitle", wrap=True)
        self.mirrored = label("", "Hint", wrap=True)
        self.again = ActionButton("Groom this subject again", actions["run.regroom"])
        self.body.addWidget(self.form)
        self.body.addWidget(self.mirrored)
        self.body.addWidget(rule())
        for widget in (self.subject, self.report, self.again):
            self.body.addWidget(widget)
        self.body.addStretch()
        self.progress = Progress(actions)
        self.go = ActionButton("Groom", actions["run.groom"], "primary")
        self.proceed = ActionButton("Next: Correspond", actions["view.correspond"], "primary")
        for below in (self.form.help, self.progress, self.go, self.proceed):
            self.footer.addWidget(below)
        for signal in (session.study_changed, session.facts_changed, session.selection_changed):
            signal.connect(self._show)
        self._show()

    def show_busy(self, status: Status | None) -> None:
        """Show the progress of grooming, or that nothing goes on."""
        self.progress.show_status(status)
        self.go.setVisible(status is None)
        self._show()

    def _show(self) -> None:
        session = self._session
        self.form.show_values(session.study.settings.groom)
        idle = not self.progress.isVisibleTo(self)
        count = len(session.study.included)
        self.go.setText(f"Groom {count} subjects" if not session.is_groomed else "Groom all again")
        set_primary(self.go, not session.is_groomed)
        self.proceed.setVisible(idle and session.is_groomed)
        turned = [name for name, groomed in session.groomed.items() if mirrors(groomed.alignment)]
        self.mirrored.setText(f"Mirrored to the other side: {', '.join(turned)}")
        self.mirrored.setVisible(bool(turned))
        name = session.selection[0] if session.selection else ""
        groomed = session.groomed.get(name)
        for widget in (self.subject, self.report, self.again):
            widget.setVisible(groomed is not None)
        if groomed is not None:
            self.subject.setText(name)
            self.report.setText(_sentences(groomed))


def _sentences(groomed: Groomed) -> str:
    report = groomed.subject.report
    change = 100.0 * (report.volume_after / report.volume_before - 1.0)
    lines = [
        f"Volume {millilitres(report.volume_before)} in the file, "
        f"{millilitres(report.volume_after)} groomed ({change:+.1f} %)",
        f"{len(groomed.subject.mesh.vertices)} vertices, {report.genus} handle{'s' * (report.genus != 1)}",
        *report.notes,
    ]
    return "\n".join(lines)
