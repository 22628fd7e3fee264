"""What keeps people without a mouse, colours or eyes from using a widget: no name, no key, low contrast."""

import numpy as np

TEXT = 4.5  # WCAG 2.2, level AA
ENLARGED = 3  # texts are measured larger: their strokes are then more than blurred edges


def luminance(colours):
    """Return the relative luminance of colours 0xRRGGBB, by WCAG."""
    parts = np.stack([colours >> 16 & 255, colours >> 8 & 255, colours & 255], axis=-1) / 255.0
    linear = np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def contrast_in(pixels):
    """Return the contrast of text (height, width) of 0xffRRGGBB with its ground, the most common colour."""
    colours, counts = np.unique(pixels, return_counts=True)
    ground, inks = luminance(colours[counts.argmax()]), luminance(colours[counts >= 12])
    return ((np.maximum(inks, ground) + 0.05) / (np.minimum(inks, ground) + 0.05)).max()


def picture_of(root):
    """Return how a widget looks, enlarged, and its pixels (height, width) of 0xffRRGGBB in that image."""
    from PySide6.QtGui import QImage

    image = QImage(root.size() * ENLARGED, QImage.Format.Format_RGB32)
    image.setDevicePixelRatio(ENLARGED)
    window = root.window()
    updates = window.updatesEnabled()
    window.setUpdatesEnabled(True)
    root.render(image)
    window.setUpdatesEnabled(updates)
    return image, np.frombuffer(image.constBits(), np.uint32).reshape(image.height(), image.width())


def texts_of(widget):
    """Return the parts of a widget that are text, as rectangles in it with words to name them by."""
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import (
        QAbstractButton,
        QAbstractItemView,
        QCheckBox,
        QComboBox,
        QHeaderView,
        QLabel,
        QLineEdit,
        QListView,
        QPlainTextEdit,
        QStyle,
        QStyleOptionButton,
        QTabBar,
        QToolButton,
    )

    inner = widget.rect().adjusted(3, 3, -3, -3)
    if isinstance(widget, QHeaderView):
        return []
    if isinstance(widget, QTabBar):
        return [
            (widget.tabRect(at), widget.tabText(at))
            for at in range(widget.count())
            if widget.isTabEnabled(at)
        ]
    if isinstance(widget, QAbstractItemView):
        model = widget.model()
        cells = [
            model.index(row, at)
            for row in range(min(model.rowCount(), 40))
            for at in range(1 if isinstance(widget, QListView) else model.columnCount())
        ]
        seen = [
            (cell, widget.visualRect(cell))
            for cell in cells
            if widget.viewport().rect().contains(widget.visualRect(cell))
        ]
        place = widget.viewport().pos()
        return [
            (box.translated(place), str(cell.data()))
            for cell, box in seen
            if isinstance(cell.data(), str) and cell.data()
        ]
    if isinstance(widget, QCheckBox):
        option = QStyleOptionButton()
        widget.initStyleOption(option)
        return [
            (
                widget.style().subElementRect(QStyle.SubElement.SE_CheckBoxContents, option, widget),
                widget.text(),
            )
        ]
    if isinstance(widget, QComboBox):
        return [(inner.adjusted(0, 0, -28, 0), widget.currentText())]
    if isinstance(widget, QLineEdit):
        return [(inner, widget.text() or widget.placeholderText())]
    if isinstance(widget, QToolButton) and widget.toolButtonStyle() is Qt.ToolButtonStyle.ToolButtonIconOnly:
        return []
    if isinstance(widget, QLabel):
        return [(widget.contentsRect(), widget.text())]
    if isinstance(widget, QAbstractButton):
        return [(inner, widget.text())]
    if isinstance(widget, QPlainTextEdit):
        return [(inner, widget.toPlainText())]
    return []


def controls_in(root):
    """Return what can be operated in a widget."""
    from PySide6 import QtWidgets as Q

    kinds = (
        Q.QAbstractButton,
        Q.QAbstractItemView,
        Q.QAbstractSlider,
        Q.QAbstractSpinBox,
        Q.QComboBox,
        Q.QLineEdit,
        Q.QPlainTextEdit,
        Q.QTabBar,
    )
    parts = (Q.QScrollBar, Q.QHeaderView)
    return [
        widget
        for widget in root.findChildren(Q.QWidget)
        if isinstance(widget, kinds)
        and not isinstance(widget, parts)
        and widget.isVisible()
        and not (isinstance(widget, Q.QTabBar) and not widget.count())
        and not isinstance(widget.parent(), Q.QAbstractSpinBox | Q.QComboBox | Q.QAbstractItemView)
    ]


class Walk:
    """Looks at one place of the program after the other and collects what is wrong there."""

    def __init__(self, window):
        self.window, self.theme = window, window.workspace.theme
        self.seen, self.faults = set(), set()

    def look(self, where, root):
        """Look at what is visible in a widget, in both schemes; the second stays: changes take long."""
        self.look_once(where, root)
        self.change_scheme()
        self.look_once(where, root)

    def change_scheme(self):
        """Show the other scheme."""
        self.theme.choose("light" if self.theme.is_dark else "dark")

    def look_once(self, where, root):
        """Look at what is visible in a widget, in the scheme that is shown."""
        from PySide6.QtWidgets import QWidget

        shown = [widget for widget in [root, *root.findChildren(QWidget)] if widget.isVisible()]
        self.seen |= {kind for item in shown for kind in type(item).__mro__}
        for widget in controls_in(root):
            self.faults |= {f"{where}: {type(widget).__name__} {fault}" for fault in faults_of(widget)}
        _image, picture = picture_of(root)
        for item in shown:
            if item.isEnabled():
                self.measure(where, root, picture, item)

    def measure(self, where, root, picture, widget):
        """Measure the contrast of the texts that a widget shows."""
        from PySide6.QtCore import QPoint

        scheme, corner = "dark" if self.theme.is_dark else "light", widget.mapTo(root, QPoint(0, 0))
        for box, text in texts_of(widget):
            box = (box & widget.visibleRegion().boundingRect()).translated(corner)
            rows, columns = (
                slice(ENLARGED * max(first, 0), ENLARGED * (last + 1))
                for first, last in ((box.top(), box.bottom()), (box.left(), box.right()))
            )
            part = picture[rows, columns]
            if text.strip() and part.size and (result := contrast_in(part)) < TEXT:
                what = f"{type(widget).__name__} {text[:40]!r}"
                self.faults.add(f"{where}, {scheme}: {what} has a contrast of {result:.2f}")


def faults_of(control):
    """Return what keeps people without eyes or mouse from using a control."""
    from PySide6.QtCore import Qt
    from PySide6.QtGui import QAccessible

    name = QAccessible.queryAccessibleInterface(control).text(QAccessible.Text.Name).strip()
    if not name:
        yield f"{control.objectName()} in {type(control.parent()).__name__} has no name"
    if not control.focusPolicy() & Qt.FocusPolicy.TabFocus:
        yield f"{name!r} can't be reached by key"
