"""The display of a run: its particles (live, replayed or final), and its energies."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, Signal, Slot
from PySide6.QtGui import QAction

from homolog.arrays import Array, FloatArray
from homolog_app.scenes.subjects import moment_of, realigned
from homolog_app.window.explore.controls import Pace
from homolog_app.window.explore.plot import Plot
from homolog_app.window.theme import Theme
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from homolog.correspondence.types import Frame
    from homolog_app.window.stage import Stage

__all__ = ["EnergyCurves", "RunParticles"]

_MOST_POINTS = 400
_AHEAD = 0.25  # space for further iterations, as a fraction of those done


class RunParticles(QObject):
    """Particles of a run for the views. A timer polls its newest frame; `moved` says whether the run is live.

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
            result = self._session.result
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
        result = self._session.result
        if result is None or index >= len(result.frames):
            return
        self.particles, self.tints = moment_of(result, index)
        self.moved.emit(index < len(result.frames) - 1)
        count = len(next(iter(self.particles.values())))
        self._stage.footer.moment.setText(f"iteration {result.frames[index].iteration} · {count} particles")


class EnergyCurves(Plot):
    """The terms of the objective over the iterations."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(
            theme, "Energies", "The three energies appear here while particles are being placed."
        )
        self._rows: FloatArray = np.empty((0, 4))
        self._ahead = 0.0

    @property
    def is_empty(self) -> bool:
        """Whether there are fewer than two iterations."""
        return len(np.unique(self._rows[:, 0])) < 2

    def show_rows(self, rows: FloatArray | Sequence[Sequence[float]], *, is_live: bool = False) -> None:
        """Show energies (T, 4): iteration and three terms; live ones leave room for further iterations."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
        is_new = np.diff(table[:, 1:], axis=0).any(axis=1)  # frames repeat values between evaluations
        table = table[np.concatenate([np.ones(min(len(table), 1), dtype=bool), is_new])]
        every = max(1, len(table) // _MOST_POINTS)
        self._rows = np.concatenate([table[::every], table[-1:]]) if len(table) else table
        if is_live and self._ahead and self._fits():
            self.follow()
        else:
            self._ahead = _AHEAD if is_live else 0.0
            self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the frames."""
        from homolog_app.plots import draw_energy_frames

        draw_energy_frames(figure.subplots(1, 3), self._rows, self.theme.colours, self._ahead)

    def draw_moving(self, figure: "Figure") -> "Sequence[Artist]":
        """Draw the curves."""
        from homolog_app.plots import draw_energy_curves

        return draw_energy_curves(figure.axes, self._rows, self.theme.colours)

    def _fits(self) -> bool:
        """Whether the newest values are within the frames that were drawn."""
        axes = self.canvas.figure.axes if self.canvas is not None else []
        iteration, *values = self._rows[-1].tolist()
        return bool(axes) and all(
            frame.viewLim.x0 <= self._rows[0, 0] and frame.viewLim.contains(iteration, value)
            for frame, value in zip(axes, values, strict=True)
            if np.isfinite(value) and value
        )
