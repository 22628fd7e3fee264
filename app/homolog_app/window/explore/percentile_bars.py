"""A patient's numbers among those of the controls, a line each."""

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from homolog_app.window.explore.plot import marker
from homolog_app.window.theme import Theme

if TYPE_CHECKING:
    from homolog.patient import PatientComparison, Reference

__all__ = ["PercentileBars"]

_ROW, _LINE, _FONT_PX = 52, 34, 12
_UNUSUAL = 0.05


class PercentileBars(QWidget):
    """Controls as ticks, their middle 90 % as a band, the patient as a diamond."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._rows: list[tuple[str, str, float, np.ndarray, bool, float | None]] = []
        self.setAccessibleName("The patient among the controls")
        theme.changed.connect(self.update)

    def show_patient(self, comparison: "PatientComparison | None", reference: "Reference | None") -> None:
        """Show a patient, or nothing."""
        self._rows = []
        if comparison is not None and reference is not None:
            for name, form, item, controls, limit in (
                ("Distance in the modes", "{:.1f} SD", comparison.mahalanobis, reference.mahalanobis, None),
                ("Distance outside of them", "{:.2f} mm", comparison.outside, reference.outside, None),
                ("Size, of the expected", "{:.2f}", comparison.size, reference.size, None),
                ("Largest |z|", "{:.1f}", comparison.local, reference.maxima, reference.limit),
            ):
                interval = f"({item.low:.0f} to {item.high:.0f})"
                words = f"{form.format(item.value)}, percentile {item.percent:.0f} {interval}"
                self._rows.append((name, words, item.value, controls, item.p <= _UNUSUAL, limit))
        self.setAccessibleDescription("; ".join(f"{row[0]}: {row[1]}" for row in self._rows))
        self.setFixedHeight(_ROW * len(self._rows))
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the lines."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = QFont(self.font())
        font.setPixelSize(_FONT_PX)
        painter.setFont(font)
        for number, row in enumerate(self._rows):
            self._paint_row(painter, number * _ROW, row)
        painter.end()

    def _paint_row(
        self,
        painter: QPainter,
        top: int,
        row: tuple[str, str, float, np.ndarray, bool, float | None],
    ) -> None:
        name, words, value, controls, unusual, limit = row
        colours = self._theme.colours
        painter.setPen(QColor(colours.dim))
        painter.drawText(QRectF(0, top, self.width(), 16), Qt.AlignmentFlag.AlignLeft, name)
        painter.setPen(QColor(colours.text))
        painter.drawText(QRectF(0, top, self.width(), 16), Qt.AlignmentFlag.AlignRight, words)
        ends = [*controls[[0, -1]].tolist(), value, *([] if limit is None else [limit])]
        low, high = float(min(ends)), float(max(ends))
        span = max(high - low, 1e-9)

        def x(of: float) -> float:
            return 8.0 + (self.width() - 16.0) * (of - low) / span

        middle = top + _LINE
        first, last = np.quantile(controls, [0.05, 0.95]).tolist()
        painter.fillRect(QRectF(x(first), middle - 6, x(last) - x(first), 12), QColor(colours.selected))
        painter.setPen(QPen(QColor(colours.dim), 1))
        for control in controls.tolist():
            painter.drawLine(QPointF(x(control), middle - 4), QPointF(x(control), middle + 4))
        if limit is not None:
            painter.setPen(QPen(QColor(colours.danger), 1, Qt.PenStyle.DashLine))
            painter.drawLine(QPointF(x(limit), middle - 9), QPointF(x(limit), middle + 9))
        painter.setPen(QPen(QColor(colours.surface), 1))
        painter.setBrush(QColor(colours.danger if unusual else colours.accent))
        painter.drawPath(marker(3, QPointF(x(value), middle), 6.0))
