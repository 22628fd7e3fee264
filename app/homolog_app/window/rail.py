"""The four steps of a study, the rail that leads to them, and the status bar."""

import logging
from dataclasses import dataclass

import psutil
from PySide6.QtCore import QEvent, QObject, QRect, QSize, Qt, QTimer, Slot
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import (
    QAbstractButton,
    QDockWidget,
    QFrame,
    QMainWindow,
    QSizePolicy,
    QStatusBar,
    QWidget,
)

from homolog_app.window.actions import Actions
from homolog_app.window.dialogs import STATUS
from homolog_app.window.session import PAGE_OF_JOB, Session
from homolog_app.window.study import outdated_text
from homolog_app.window.theme import Theme, pixmap, scaled
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    ProgressBar,
    column,
    keep_space,
    label,
    link,
    show_all,
)

__all__ = ["STEPS", "DockSizes", "Rail", "StatusBar", "Step", "least_inspector", "steps_of"]

_log = logging.getLogger(__name__)

STEPS = ("cohort", "groom", "correspond", "explore")
_WIDTH, _HEIGHT = 88, 104


@dataclass(frozen=True, slots=True)
class Step:
    """State of a step: whether it is reachable, done or next, and its status text."""

    enabled: bool
    done: bool
    following: bool
    status: str


class Rail(QFrame):
    """A button for each step that can be opened, from top to bottom."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("Rail")
        self.setFixedWidth(scaled(_WIDTH))
        self.buttons = {name: _StepButton(name, theme, self) for name in STEPS}
        column(*self.buttons.values(), ..., on=self, edges=(0, GRID, 0, GRID), gap=GRID // 2)

    def show_steps(self, steps: dict[str, Step], current: str) -> None:
        """Show the state of the steps and the open one."""
        for name, button in self.buttons.items():
            button.show_step(steps[name], name == current)


class _StepButton(QAbstractButton):
    def __init__(self, name: str, theme: Theme, parent: QWidget) -> None:
        super().__init__(parent)
        self._name, self._theme = name, theme
        self._step = Step(False, False, False, "")
        self._current = False
        self.setText(name.capitalize())
        self.setAccessibleName(name.capitalize())
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        theme.changed.connect(self.update)
        self.hide()

    def show_step(self, step: Step, current: bool) -> None:
        if (step, current) == (self._step, self._current):
            return
        self._step, self._current = step, current
        self.setVisible(step.enabled)
        state = "done" if step.done else "next" if step.following else ""
        self.setAccessibleDescription(", ".join(part for part in (step.status, state) if part))
        self.setToolTip(f"{self.text()}: {step.status}" if step.status else self.text())
        self.update()

    def event(self, event: QEvent) -> bool:
        return keep_space(event) or super().event(event)

    def sizeHint(self) -> QSize:
        return QSize(scaled(_WIDTH), scaled(_HEIGHT))

    def minimumSizeHint(self) -> QSize:
        return QSize(scaled(_WIDTH), scaled(_HEIGHT) - 2 * GRID)

    def paintEvent(self, event: QPaintEvent) -> None:
        colours = self._theme.colours
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        box = self.rect().adjusted(GRID, 2, -GRID, -2)
        if self._current or self.underMouse():
            painter.setBrush(QColor(colours.selected if self._current else colours.hover))
            painter.drawRoundedRect(box, 8, 8)
        if self.hasFocus():
            painter.setPen(QPen(QColor(colours.accent), 2))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRoundedRect(box, 8, 8)
            painter.setPen(Qt.PenStyle.NoPen)
        if self._current:
            painter.setBrush(QColor(colours.accent))
            painter.drawRoundedRect(QRect(0, box.top() + 16, 4, box.height() - 32), 2, 2)
        ink = colours.accent if self._current else colours.text
        painter.drawPixmap((self.width() - 28) // 2, box.top() + 12, pixmap(self._name, ink, 28))
        self._paint_badge(painter, (self.width() + 28) // 2 + 2, box.top() + 14)
        self._paint_text(painter, box, ink)
        painter.end()

    def _paint_badge(self, painter: QPainter, x: int, y: int) -> None:
        colours = self._theme.colours
        if self._step.done:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(colours.accent))
            painter.drawEllipse(QRect(x - 7, y - 7, 14, 14))
            painter.drawPixmap(x - 5, y - 5, pixmap("done", colours.on_accent, 10))
        elif self._step.following and not self._current:
            painter.setPen(QPen(QColor(colours.accent), 2))
            painter.setBrush(QColor(colours.sunken))
            painter.drawEllipse(QRect(x - 5, y - 5, 10, 10))

    def _paint_text(self, painter: QPainter, box: QRect, ink: str) -> None:
        font = QFont(self.font())
        font.setPixelSize(scaled(12))
        font.setWeight(QFont.Weight.DemiBold if self._current else QFont.Weight.Medium)
        painter.setFont(font)
        painter.setPen(QColor(ink))
        flags = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop
        painter.drawText(box.adjusted(0, 46, 0, 0), flags, self.text())
        font.setPixelSize(scaled(11))
        font.setWeight(QFont.Weight.Normal)
        painter.setFont(font)
        painter.setPen(QColor(self._theme.colours.dim))
        text = self._step.status or ("next" if self._step.following and not self._current else "")
        painter.drawText(box.adjusted(2, 54 + scaled(12), -2, 0), flags | Qt.TextFlag.TextWordWrap, text)


def steps_of(session: Session) -> dict[str, Step]:
    """Return the state of the steps; exactly one reachable step is next."""
    included = len(session.study.included)
    groomed = len(session.groomed_names)
    result = session.result
    is_current = result is not None and not outdated_text(session.study, result.record)
    done = {
        "cohort": included >= 2,
        "groom": session.is_groomed or is_current,
        "correspond": is_current,
        "explore": False,
    }
    enabled = {
        "cohort": session.is_open,
        "groom": included > 0,
        "correspond": included >= 2,
        "explore": result is not None or session.preliminary is not None,
    }
    texts = {
        "cohort": f"{included} subject{'s' * (included != 1)}" if session.is_open else "",
        "groom": f"{groomed} of {included}" if groomed else "",
        "correspond": f"{result.result.world.shape[1]} particles" if result else "",
        "explore": "preliminary" if session.preliminary is not None else "",
    }
    job = session.job
    if job.status is not None and job.kind in ("groom", "run"):
        texts["groom" if job.kind == "groom" else "correspond"] = f"{100 * job.status.fraction:.0f} %"
    following = next((name for name, is_done in done.items() if not is_done), "") if session.is_open else ""
    return {
        name: Step(enabled[name], done[name], name == following and enabled[name], texts[name])
        for name in done
    }


_MEMORY_MS = 2000
_BAR_PX = 160, 8
_INSPECTOR, _INSPECTOR_ENOUGH = 376, 552  # pixels
_ON_RAIL = ("groom", "run")  # their steps show their progress


class StatusBar(QObject):
    """Fills the window's status bar."""

    def __init__(self, bar: QStatusBar, session: Session, actions: Actions) -> None:
        super().__init__(bar)
        self._bar, self._session = bar, session
        self._bar.setSizeGripEnabled(False)
        self.work = label("")
        self.bar = ProgressBar()
        self.bar.setFixedSize(*_BAR_PX)
        self.cancel = ActionButton("Cancel", actions["run.cancel"], "flat")
        self.device = label("Device: …")
        self.memory = label("")
        self.work.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # names may be long
        self._bar.addWidget(self.work, 1)
        for widget in (self.bar, self.cancel):
            self._bar.addPermanentWidget(widget)
            widget.hide()
        self._bar.addPermanentWidget(self.device)
        self._bar.addPermanentWidget(self.memory)
        link(self._show_busy, session.job_changed, session.job_progressed)
        link(self._show_busy, session.page_changed, session.step_changed)
        session.devices_changed.connect(self._show_devices)
        self._process = psutil.Process()
        self._timer = QTimer(self, interval=_MEMORY_MS)
        self._timer.timeout.connect(self._show_memory)
        self._timer.start()
        session.noticed.connect(self.say)
        self._show_memory()

    def say(self, text: str) -> None:
        """Show a message for some seconds; the log keeps it."""
        _log.log(STATUS, "%s", text)
        self._bar.showMessage(text, 6000)

    @Slot()
    def _show_busy(self) -> None:
        """Show the progress of a job that no other part of the window shows."""
        job, session = self._session.job, self._session
        on_page = session.step == "explore" and PAGE_OF_JOB.get(job.kind) == session.page
        shown = job.is_busy and session.is_open and job.kind not in _ON_RAIL and not on_page
        show_all(shown, self.bar, self.cancel)
        if job.status is not None:
            self.bar.show_fraction(job.status.fraction)
        self.work.setText(f"{job.background[:1].upper()}{job.background[1:]}…" if job.background else "")

    @Slot()
    def _show_devices(self) -> None:
        devices = self._session.devices
        if devices is not None:
            self.device.setText(f"Device: {devices.names[devices.automatic]}")

    def _show_memory(self) -> None:
        self.memory.setText(f"Memory: {self._process.memory_info().rss / 2**20:.0f} MB")


def least_inspector() -> int:
    """Return the smallest width of the inspector [pixels]: with large fonts the window fits 1280 pixels."""
    return min(scaled(_INSPECTOR), _INSPECTOR_ENOUGH)


class DockSizes:
    """Minimum sizes of docks; a dock enlarged by one returns to its former size when it decreases."""

    def __init__(self, window: QMainWindow) -> None:
        self._window = window
        self._former: dict[QDockWidget, int] = {}

    def set_least(self, dock: QDockWidget, orientation: Qt.Orientation, least: int) -> None:
        """Set the minimum width or height of a dock."""
        content = dock.widget()
        assert content is not None
        if orientation == Qt.Orientation.Horizontal:
            before, now = content.minimumWidth(), content.width()
            content.setMinimumWidth(least)
        else:
            before, now = content.minimumHeight(), content.height()
            content.setMinimumHeight(least)
        if dock.isHidden():
            return
        if now < least:
            self._former.setdefault(dock, now)
        elif least < before and now == before and dock in self._former:
            self._window.resizeDocks([dock], [max(self._former[dock], least)], orientation)
            if self._former[dock] >= least:
                del self._former[dock]
