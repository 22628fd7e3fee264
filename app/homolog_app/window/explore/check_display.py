"""The display options of the page *Check*, and the sphere of normals."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor, QFont, QHelpEvent, QMouseEvent, QPainter, QPaintEvent, QPen, QRadialGradient
from PySide6.QtWidgets import QToolTip, QWidget

from homolog.arrays import FloatArray, IntArray
from homolog.progress import Tick
from homolog_app.scenes.check import (
    ALONG,
    ENERGIES,
    STRAIGHT,
    Distances,
    Marks,
    distances_on,
    energies_of,
    seen_from_mean,
    textures_of,
)
from homolog_app.scenes.states import CheckView
from homolog_app.window.theme import Theme, scaled
from homolog_app.window.widgets import NumberBox, choice, column, having, label, link, named_rows, offer
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog.inspection import Inspection, ParticleEnergies
    from homolog_app.window.scene import Pick

__all__ = ["CheckDisplay", "NormalSphere"]


_RINGS = (30.0, 60.0)
_MARGIN, _DOT = 12.0, 5.0
_LISTED = 5


class NormalSphere(QWidget):
    """The unit sphere seen from the Fréchet mean; markers behind it are hollow. A click selects a subject."""

    subject_chosen = Signal(str)

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._particle: int | None = None
        self._names: Sequence[str] = ()
        self.points: FloatArray = np.empty((0, 3))
        self._angles: FloatArray = np.empty(0)
        self._selected: Sequence[str] = ()
        self.setMinimumSize(360, 180)
        self.setAccessibleName("Normals of the particle")
        theme.changed.connect(self.update)

    def show_normals(
        self, particle: int, names: Sequence[str], normals: FloatArray, mean: FloatArray
    ) -> None:
        """Show the unit normals (M, 3) of a particle and their Fréchet mean (3,)."""
        self._particle, self._names = particle, names
        self.points, self._angles = seen_from_mean(normals, mean)
        self.setAccessibleDescription(f"particle {particle}: {'; '.join(self._list())}")
        self.update()

    def show_nothing(self) -> None:
        """Show a hint to choose a particle."""
        self._particle = None
        self.setAccessibleDescription("")
        self.update()

    def show_selection(self, names: Sequence[str]) -> None:
        """Mark the selected subjects."""
        self._selected = names
        self.update()

    def _list(self) -> list[str]:
        order = np.argsort(-self._angles)[:_LISTED]
        return [f"{self._names[m]} {self._angles[m]:.0f}°" for m in order]

    @property
    def _disc(self) -> QRectF:
        side = min(self.height(), self.width() // 2) - 2 * _MARGIN
        return QRectF(_MARGIN, (self.height() - side) / 2, side, side)

    def _place(self, point: FloatArray) -> QPointF:
        disc = self._disc
        return disc.center() + QPointF(point[0], -point[1]) * (disc.width() / 2)

    def _at(self, position: QPointF) -> int | None:
        if self._particle is None or not len(self.points):
            return None
        apart = [(self._place(point) - position).manhattanLength() for point in self.points]
        nearest = int(np.argmin(apart))
        return nearest if apart[nearest] <= 2 * _DOT else None

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Select the clicked subject."""
        hit = self._at(event.position())
        if hit is not None:
            self.subject_chosen.emit(self._names[hit])

    def event(self, event: QEvent) -> bool:
        """Name the subject under the mouse."""
        if isinstance(event, QHelpEvent):
            hit = self._at(QPointF(event.pos()))
            text = f"{self._names[hit]}: {self._angles[hit]:.1f}°" if hit is not None else ""
            QToolTip.showText(event.globalPos(), text, self)
            return True
        return super().event(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the sphere, the normals and the list of the largest angles."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = QFont(self.font())
        font.setPixelSize(scaled(12))
        painter.setFont(font)
        colours = self._theme.colours
        painter.fillRect(self.rect(), QColor(colours.surface))
        if self._particle is None:
            painter.setPen(QColor(colours.dim))
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
            text = "Choose a particle: its normals on all shapes appear here."
            painter.drawText(self.rect().adjusted(24, 0, -24, 0), flags, text)
        else:
            self._paint_globe(painter)
            self._paint_normals(painter)
            self._paint_text(painter)
        painter.end()

    def _paint_globe(self, painter: QPainter) -> None:
        colours, disc = self._theme.colours, self._disc
        light = QRadialGradient(disc.center() - QPointF(disc.width(), disc.width()) / 6, disc.width() * 0.75)
        light.setColorAt(0.0, QColor(colours.raised))
        light.setColorAt(1.0, QColor(colours.sunken))
        painter.setPen(QPen(QColor(colours.dim), 1))
        painter.setBrush(light)
        painter.drawEllipse(disc)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for ring in _RINGS:
            painter.setPen(QPen(QColor(colours.line), 1))
            radius = disc.width() / 2 * np.sin(np.radians(ring))
            painter.drawEllipse(disc.center(), radius, radius)

    def _paint_normals(self, painter: QPainter) -> None:
        colours = self._theme.colours
        text, accent = QColor(colours.text), QColor(colours.accent)
        for m in np.argsort(self.points[:, 2]):
            chosen = self._names[m] in self._selected
            ink = accent if chosen else text
            painter.setPen(QPen(ink, 1.6))
            in_front = self.points[m, 2] >= 0.0
            painter.setBrush(ink if in_front else Qt.BrushStyle.NoBrush)
            at, radius = self._place(self.points[m]), _DOT if chosen else 0.7 * _DOT
            painter.drawEllipse(at, radius, radius)
            if chosen:
                painter.setBrush(Qt.BrushStyle.NoBrush)
                painter.drawEllipse(at, radius + 4, radius + 4)
        painter.setPen(QPen(accent, 2))
        middle = self._disc.center()
        for arm in (QPointF(8, 0), QPointF(0, 8)):
            painter.drawLine(middle - arm, middle + arm)

    def _paint_text(self, painter: QPainter) -> None:
        colours, disc = self._theme.colours, self._disc
        area = QRectF(self.rect())
        area.adjust(disc.right() + 2 * _MARGIN, disc.top(), -_MARGIN, 0.0)
        lines = "\n".join(f"  {line}" for line in self._list())
        for colour, text in (
            (colours.text, f"Normals of particle {self._particle} on {len(self._names)} shapes"),
            (colours.dim, "+ mean normal. Rings: 30°, 60°, 90° from it. Hollow: more than 90°."),
            (colours.dim, "Farthest from the mean:"),
            (colours.text, lines),
        ):
            painter.setPen(QColor(colour))
            painter.drawText(area, int(Qt.TextFlag.TextWordWrap), text)
            area.setTop(painter.boundingRect(area, int(Qt.TextFlag.TextWordWrap), text).bottom() + 6.0)


_NOBODY: IntArray = np.empty(0, np.int64)
_TORN = "A pattern that the particles transfer from the average shape; it is torn where they are wrong."
_SHARE = "Contribution of each particle to this term of the objective: compare places, not absolute values."
_SHOW = {
    "Particles by place": ("places", "Click a particle in a view: it is ringed on every shape."),
    "Neighbours of the particle": (
        "neighbours",
        "Click a particle: others are coloured by distance from it.",
    ),
    "Distance from a point": ("distances", "Click a point on a surface, or choose a particle."),
    **{f"Energy: {part} ({meaning})": (part, _SHARE) for part, meaning in ENERGIES.items()},
    "Texture: checkerboard": ("checkerboard", _TORN),
    "Texture: stripes": ("stripes", _TORN),
}


class CheckDisplay(QWidget):
    """What the views show. The data are computed in the computing thread when they are first shown."""

    changed = Signal()
    wanted = Signal(int, object)

    def __init__(self, workspace: Workspace) -> None:
        super().__init__()
        self._workspace = workspace
        self._inspection: Inspection | None = None
        self._names: tuple[str, ...] = ()
        self._others = _NOBODY
        self._picked: tuple[int, FloatArray] | None = None
        self._distances: Distances | None = None
        self._energies: ParticleEnergies | None = None
        self._textures: dict[str, dict[str, FloatArray]] = {}
        self.particle = having(NumberBox(-1, -1), specialValueText="none", accessibleName="Particle")
        self.subject = choice("Subject to look at")
        self.show_what = choice("What the views show", {text: value for text, (value, _) in _SHOW.items()})
        self.advice = label("", "Hint", wrap=True)
        rows = (("&Particle", self.particle), ("&On", self.subject), ("&Show", self.show_what))
        column(label("Look at", "SectionTitle"), named_rows(rows), self.advice, on=self)
        link(self._look, self.particle.valueChanged, self.subject.activated)
        self.show_what.currentIndexChanged.connect(self._refresh)
        workspace.session.job_changed.connect(self._compute)

    @property
    def chosen(self) -> int | None:
        """The chosen particle."""
        return self.particle.value() if self.particle.value() >= 0 else None

    @property
    def marks(self) -> Marks:
        """What the views are to show."""
        texture = self._textures.get(self._mode)
        return Marks(
            show="texture" if texture else self._mode,
            particle=self.chosen,
            subject=self.subject.currentIndex(),
            others=self._others,
            distances=self._distances if self._is_measured else None,
            energies=self._energies,
            texture=texture,
        )

    @property
    def view(self) -> CheckView:
        """What is chosen, in words and numbers."""
        place = None if self._picked is None else tuple(self._picked[1].tolist())
        return CheckView(
            show=self._mode,
            particle=self.chosen,
            subject=self.subject.currentText(),
            others=tuple(self._others.tolist()),
            place=place,
        )

    def show_inspection(self, inspection: "Inspection | None", names: tuple[str, ...]) -> None:
        """Look at another inspection, or at none."""
        self._inspection, self._others = inspection, _NOBODY
        self._picked, self._distances, self._energies, self._textures = None, None, None, {}
        if names != self._names:
            self._names = names
            offer(self.subject, dict.fromkeys(names))
        with QSignalBlocker(self.particle):
            self.particle.setRange(-1, len(inspection.consensus.shape) - 1 if inspection else -1)
        self.setEnabled(inspection is not None)
        self._refresh()

    def mark(self, particle: int, subject: int, others: IntArray = _NOBODY) -> None:
        """Mark a particle on all shapes, and others on one subject."""
        self._others, self._picked = others, None
        self.subject.setCurrentIndex(subject)
        with QSignalBlocker(self.particle):
            self.particle.setValue(particle)
        self._refresh()

    def handle_pick(self, pick: "Pick") -> None:
        """Choose the clicked particle or point."""
        name = pick.name.removesuffix(f": {ALONG}").removesuffix(f": {STRAIGHT}")
        at = self.subject.findText(name)
        if self._inspection is None or at < 0:
            return
        if self._mode == "distances":
            self.subject.setCurrentIndex(at)
            self._picked = at, pick.place
            self._refresh()
        elif pick.particle is not None:
            self.mark(pick.particle, at)

    @property
    def _origin(self) -> tuple[int, FloatArray] | None:
        """Subject and origin of the distances: the clicked point, or the chosen particle."""
        if self._picked is not None or self._inspection is None or self.chosen is None:
            return self._picked
        m = self.subject.currentIndex()
        return m, self._inspection.located.world[m, self.chosen]

    @property
    def _is_measured(self) -> bool:
        """Whether the distances are up to date."""
        known, origin = self._distances, self._origin
        if known is None or origin is None:
            return False
        return known.subject == origin[0] and np.array_equal(known.place, origin[1])

    @property
    def _mode(self) -> str:
        return str(self.show_what.currentData())

    def _look(self) -> None:
        """Show another particle or subject, and look at it."""
        self._others, self._picked = _NOBODY, None
        self._refresh()
        if self._inspection is not None and self.chosen is not None:
            m = self.subject.currentIndex()
            self.wanted.emit(m, self._inspection.located.world[m, self.chosen])

    def _refresh(self) -> None:
        self.advice.setText(_SHOW[self.show_what.currentText()][1])
        self.changed.emit()
        self._compute()

    def _compute(self) -> None:
        """Compute what the choice needs, if it is not known yet."""
        inspection, mode, origin = self._inspection, self._mode, self._origin
        if inspection is None or self._workspace.session.job.is_busy or not self.isVisible():
            return
        names, project = self._names, self._workspace.shown_project
        work: Callable[[Tick], object] | None = None
        if mode == "distances" and origin is not None and not self._is_measured:
            m, place = origin
            work = partial(distances_on, inspection, m, place, names[m])
        elif mode in ENERGIES and self._energies is None:
            work = partial(energies_of, inspection, project)
        elif mode in ("checkerboard", "stripes") and not self._textures:
            work = partial(textures_of, inspection, names)
        if work is not None:
            kind = mode if mode == "distances" else "energies" if mode in ENERGIES else "texture"
            self._workspace.work.compute(kind, work, kind, partial(self._receive, kind))

    def _receive(self, kind: str, computed: object) -> None:
        setattr(self, {"distances": "_distances", "energies": "_energies"}.get(kind, "_textures"), computed)
        self.changed.emit()
