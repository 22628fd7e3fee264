"""The display of a run: its particles (live, replayed or final), and its energies."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, QPointF, QRectF, Qt, Signal, Slot
from PySide6.QtGui import QAction, QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.text import ENERGIES, short
from homolog_app.scenes.subjects import moment_of, realigned
from homolog_app.window.explore.controls import Pace
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme
from homolog_app.window.widgets import GRID
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from homolog.correspondence.types import Frame
    from homolog_app.window.stage import Stage

__all__ = ["EnergyCurves", "RunParticles"]

_MOST_POINTS = 400
_JUMPS = 20  # the first twentieth of the iterations, whose jumps may leave the frame


class RunParticles(QObject):
    """Particles of a run for the views. A timer polls its newest frame; `moved` says whether the run is live.

    `began` is emitted when a run begins.

    Attributes
    ----------
    particles : mapping of str to (N, 3) array
        Positions by subject [mm].
    tints : (N, 3) array or None
        Colours; None for colours by position.
    frame : Frame or None
        The newest frame of the run.
    """

    moved = Signal(bool)
    began = Signal()

    def __init__(self, workspace: Workspace, play: QAction, stage: "Stage", curves: "EnergyCurves") -> None:
        super().__init__(stage)
        self._play, self._stage, self._curves = play, stage, curves
        self._session, self._work = workspace.session, workspace.work
        self.particles: Mapping[str, FloatArray] = {}
        self.tints: Array | None = None
        self.frame: Frame | None = None
        self._look, self._player = (Pace(self, lambda: stage.scene.plot.draw_ms) for _ in range(2))
        self._look.timeout.connect(self._show_newest_frame)
        self._player.timeout.connect(self._step_on)
        stage.footer.frame_chosen.connect(self._show_moment)
        self._session.job_changed.connect(self._watch)

    @property
    def moment(self) -> int | None:
        """Index of the recorded frame shown; None at the end of the run."""
        time = self._stage.footer.time
        return time.value() if time.value() < time.maximum() else None

    @property
    def is_playing(self) -> bool:
        """Whether recorded frames are being replayed."""
        return self._player.isActive()

    def set_result(self) -> None:
        """Show the particles of the session's result, unless a run is shown."""
        if self._session.job.run is None:
            result = self._session.part
            self.particles, self.tints = (result.particles if result else {}), None
            self._stage.footer.show_frames(len(result.frames) if result else 0)

    def play_or_stop(self) -> None:
        """Play from the first frame, or pause."""
        if self.is_playing:
            self.stop()
            return
        time = self._stage.footer.time
        if time.value() == time.maximum():
            time.setValue(0)
        self._player.start()
        self._play.setText("Pause")

    def stop(self) -> None:
        """Stop."""
        self._player.stop()
        self._play.setText("Play")

    def close(self) -> None:
        """Stop the timers."""
        self._look.stop()
        self._player.stop()

    @Slot()
    def _watch(self) -> None:
        running = self._session.job.run is not None
        if running and not self._look.isActive():
            self.stop()
            self._stage.footer.show_frames(0)
            self.frame = None
            self._look.start()
            self.began.emit()
        elif not running and self._look.isActive():
            self._look.stop()
            self.set_result()
            self.moved.emit(False)

    @Slot()
    def _show_newest_frame(self) -> None:
        """Show the newest frame if there is one."""
        job = self._session.job.run
        frame = job.frame if job is not None else None
        if job is not None and frame is not None and frame is not self.frame:
            self.frame = frame
            self.particles, self.tints = self._on_surfaces(job.names, frame), None
            self.moved.emit(True)
            if job.recorder.energies:  # before the first iteration there are none
                self._curves.show_rows(list(job.recorder.energies), is_live=True)

    def _on_surfaces(self, names: Sequence[str], frame: "Frame") -> dict[str, FloatArray]:
        """Return the particles on the surfaces shown; the run has an alignment of its own."""
        result, groomed = self._session.result, self._session.groomed
        own = dict(zip(result.result.names, result.result.alignments, strict=True)) if result else {}
        own = {name: smooth.alignment for name, smooth in groomed.items()} | own
        after = np.array([own.get(name, now) for name, now in zip(names, frame.alignments, strict=True)])
        return dict(zip(names, realigned(frame.world, frame.alignments, after), strict=True))

    @Slot()
    def _step_on(self) -> None:
        time = self._stage.footer.time
        if time.value() >= time.maximum():
            self.stop()
        else:
            time.setValue(time.value() + 1)

    @Slot(int)
    def _show_moment(self, index: int) -> None:
        result = self._session.part
        if result is None or index >= len(result.frames):
            return
        self.particles, self.tints = moment_of(result, index)
        self.moved.emit(index < len(result.frames) - 1)
        count = len(next(iter(self.particles.values())))
        self._stage.footer.moment.setText(f"iteration {result.frames[index].iteration} · {count} particles")


class EnergyCurves(Plot):
    """The terms of the objective over the iterations; those of a run in progress are painted without axes.

    Matplotlib would take half a second for each picture of a run, whose computation holds Python's lock.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__(
            theme, "Energies", "The three energies appear here while particles are being placed."
        )
        self._rows: FloatArray = np.empty((0, 4))
        self._sketch = _Sketch(theme)
        self._layers.addWidget(self._sketch)
        self._is_live = False

    @property
    def is_empty(self) -> bool:
        """Whether there are fewer than two iterations."""
        return len(np.unique(self._rows[:, 0])) < 2

    def show_rows(self, rows: FloatArray | Sequence[Sequence[float]], *, is_live: bool = False) -> None:
        """Show energies (T, 4), iteration and three terms, of a run that has ended or is live."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
        is_new = np.diff(table[:, 1:], axis=0).any(axis=1)  # frames repeat values between evaluations
        table = table[np.concatenate([np.ones(min(len(table), 1), dtype=bool), is_new])]
        every = max(1, len(table) // _MOST_POINTS)
        self._rows = np.concatenate([table[::every], table[-1:]]) if len(table) else table
        self._is_live = is_live
        if is_live:
            self._sketch.show_rows(self._rows)
            self._show_layer()
        else:
            self.redraw()

    def _show_layer(self) -> None:
        if self._is_live and not self.is_empty:
            self._layers.setCurrentWidget(self._sketch)
        else:
            super()._show_layer()

    def draw(self, figure: "Figure") -> None:
        """Draw the curves with their axes."""
        from homolog_app.plots import draw_energies

        draw_energies(figure.subplots(1, 3), self._rows, self.theme.colours)


class _Sketch(QWidget):
    """Three curves side by side, each with its name and last value."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._rows: FloatArray = np.empty((0, 4))

    def show_rows(self, rows: FloatArray) -> None:
        """Show energies (T, 4)."""
        self._rows = rows
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the curves."""
        painter, colours = QPainter(self), self._theme.colours
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        line, width = painter.fontMetrics().height(), self.width() / len(ENERGIES)
        for place, (name, meaning) in enumerate(ENERGIES.items()):
            values = self._rows[:, 1 + place]
            known = np.isfinite(values)
            box = QRectF(place * width + GRID, GRID, width - 2 * GRID, self.height() - 2 * GRID)
            painter.setPen(QColor(colours.text))
            painter.drawText(box, Qt.AlignmentFlag.AlignTop, name)
            painter.setPen(QColor(colours.dim))
            painter.drawText(box.adjusted(0, line, 0, 0), Qt.AlignmentFlag.AlignTop, meaning)
            if not known.any() or not values[known].any():
                continue
            last = short(float(values[known][-1]))
            painter.drawText(box, Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignRight, last)
            field = box.adjusted(0, 2 * line + GRID, 0, 0)
            later = values[known][np.count_nonzero(known) // _JUMPS :]
            low, high = float(later.min()), float(later.max())
            shares = (np.clip(values[known], low, high) - low) / ((high - low) or 1.0)
            times = self._rows[known, 0]
            across = (times - times[0]) / max(float(times[-1] - times[0]), 1.0)
            xs, ys = field.left() + across * field.width(), field.bottom() - shares * field.height()
            painter.setPen(QPen(QColor(colours.line), 1.0))
            painter.drawLine(field.bottomLeft(), field.bottomRight())
            painter.setPen(QPen(QColor(colours.groups[0]), 1.6))
            painter.drawPolyline(QPolygonF([QPointF(x, y) for x, y in zip(xs, ys, strict=True)]))
        painter.end()
