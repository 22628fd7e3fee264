"""The page *Correspond*."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QComboBox,
)

from homolog.io.project import ProjectFolder
from homolog.settings import OptimizeSettings
from homolog_app.window.actions import Actions
from homolog_app.window.form import SettingsPair, resources_form
from homolog_app.window.runner import Status
from homolog_app.window.session import Session
from homolog_app.window.study import outdated_text
from homolog_app.window.study_files import interrupted_text
from homolog_app.window.widgets import (
    ActionButton,
    Panel,
    Progress,
    fill,
    having,
    held,
    label,
    link,
    named_rows,
    offer,
    rule,
    set_primary,
)

__all__ = ["RunPanel"]


_RUN_MAIN = ("method", "particles", "seed")
_STOPPED = (
    "The last run was stopped. Resume continues from its checkpoint; Run again starts from the beginning."
)
_FIRST = "Groom the shapes first, and check the surfaces."


class RunPanel(Panel):
    """Method, particles, seed and device; run, pause, cancel, resume."""

    settings_edited = Signal(str, object)
    resource_edited = Signal(str, object)

    def __init__(self, session: Session, actions: Actions) -> None:
        super().__init__("Correspond", "Place corresponding particles on every shape.")
        self._session, self._actions = session, actions
        self.form = SettingsPair(OptimizeSettings, _RUN_MAIN)
        self.form.edited.connect(self.settings_edited)
        tip = "Compute device. Automatic selects the first GPU, or the CPU without one."
        self.device = having(QComboBox(), accessibleName="Device", toolTip=tip)
        self.show_devices({"auto": "Automatic"})
        self.device.activated.connect(
            lambda _: self.resource_edited.emit("device", self.device.currentData())
        )
        self.resources = resources_form(self.form, ("workers", "memory", "cluster"), self.resource_edited)
        self.summary, self.further = label("", "Hint", wrap=True), label("", "Hint", wrap=True)
        self.more = ActionButton("Add particles", actions["run.more"])
        self.fit = ActionButton("Fit new subjects", actions["run.fit"])
        extend = label("Extend the result", "SectionTitle")
        self.from_result = held(extend, self.further, [self.more, self.fit, ...])
        self.progress = Progress(actions["run.cancel"])
        self.pause = ActionButton("Pause", actions["run.pause"])
        self.progress.buttons.insertWidget(0, self.pause)
        self.go = ActionButton("Run", actions["run.start"], "primary")
        self.resume = ActionButton("Resume", actions["run.resume"])
        self.keep = ActionButton("Keep particles", actions["run.keep"])
        self.proceed = ActionButton("Next: Explore", actions["view.explore"], "primary")
        device = named_rows((("Device", self.device),))
        device.setColumnMinimumWidth(0, self.form.name_px)  # aligned with the form
        fill(self.body, device, self.form, rule(), self.summary, self.from_result, ...)
        fill(self.footer, self.form.help, self.progress, [(self.go, 1), self.resume, self.keep], self.proceed)
        link(self.refresh, session.study_changed, session.groomed_changed, session.result_changed)
        self.refresh()

    def show_devices(self, devices: dict[str, str]) -> None:
        """Offer the devices: descriptions by the name of the setting."""
        self.device.clear()
        offer(self.device, {text: alias for alias, text in devices.items()})
        self.refresh_device()

    def show_busy(self, status: Status | None) -> None:
        """Show the progress of a run, or hide it."""
        was_busy = status is not None and self.go.isHidden()
        self.progress.show_status(status)
        self.pause.setText("Resume" if status is not None and status.paused else "Pause")
        if not was_busy:
            self.go.setVisible(status is None)
            self.form.setEnabled(status is None)
            self.device.setEnabled(status is None)
            self.refresh()

    def refresh(self) -> None:
        """Update settings and buttons."""
        session = self._session
        idle = not self.progress.isVisibleTo(self)
        self.form.show_values(session.study.settings.optimize)
        self.resources.show_values(session.study.settings)
        self.refresh_device()
        result = session.result
        done = result is not None
        current = result is not None and not outdated_text(session.study, result.record)
        resumable = self._actions["run.resume"].isEnabled()
        self.go.setText("Run again" if done or resumable else "Run")
        self._show_further()
        set_primary(self.go, not current and not resumable)
        set_primary(self.proceed, current)
        set_primary(self.resume, not done)
        self.resume.setVisible(idle and resumable)
        self.keep.setVisible(idle and self._actions["run.keep"].isEnabled())
        self.proceed.setVisible(idle and done)
        reading = session.folder is not None and not session.groomed
        ready = session.is_groomed or done or resumable or not idle or reading
        text = session.result.summary if session.result else "" if ready else _FIRST
        if self.resume.isVisibleTo(self):
            text = f"{self._interrupted()}\n{text}".strip()
        self.summary.setText(text)

    def _interrupted(self) -> str:
        """Describe the progress of the unfinished run."""
        folder = self._session.folder
        if folder is None:
            return _STOPPED
        particles = self._session.study.settings.optimize.particles
        return interrupted_text(ProjectFolder(folder).checkpoint, particles)

    def _show_further(self) -> None:
        """Show how the result can be extended."""
        possible = self._session.extension_of
        self.from_result.setVisible(possible is not None)
        if possible is None:
            return
        self.further.setText(possible.message)
        count = len(possible.subjects)
        self.more.setText(f"Add {possible.particles} particles" if possible.particles else "Add particles")
        self.fit.setText(f"Fit {count} new subject{'s' * (count != 1)}" if count else "Fit new subjects")

    def refresh_device(self) -> None:
        """Show the chosen device; one that this machine lacks is listed as missing."""
        chosen = self._session.study.settings.device
        if self.device.findData(chosen) < 0:
            self.device.addItem(f"{chosen} (not on this machine)", chosen)
        self.device.setCurrentIndex(self.device.findData(chosen))
