"""How far a job is."""

from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QVBoxLayout, QWidget

from homolog_app.rendering.text import duration
from homolog_app.window.actions import Actions
from homolog_app.window.runner import Status
from homolog_app.window.widgets import GRID, button, label

__all__ = ["Progress", "progress_text"]


class Progress(QWidget):
    """A bar, what is being done, the time left, and Cancel."""

    def __init__(self, actions: Actions) -> None:
        super().__init__()
        self.bar = QProgressBar(maximum=1000)
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName("Progress")
        self.message: QLabel = label("", "Hint", wrap=True)
        self.cancel = button("Cancel")
        self.cancel.clicked.connect(actions["run.cancel"].trigger)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(GRID)
        self.buttons = QHBoxLayout()
        self.buttons.setSpacing(GRID)
        self.buttons.addWidget(self.cancel)
        layout.addWidget(self.bar)
        layout.addWidget(self.message)
        layout.addLayout(self.buttons)
        self.hide()

    def show_status(self, status: Status | None) -> None:
        """Show how far a job is; hide if there is none."""
        self.setVisible(status is not None)
        if status is not None:
            self.bar.setValue(round(1000 * status.fraction))
            self.message.setText(progress_text(status))


def progress_text(status: Status) -> str:
    """Return a status as one line for people."""
    message = status.message[:1].upper() + status.message[1:]
    if status.paused:
        return f"Paused · {message}"
    left = f" · {duration(status.eta_s)} left" if status.eta_s is not None else ""
    return f"{message}{left}"
