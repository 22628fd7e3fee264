"""The middle of the window: the views, what to do while there is nothing to see, and the strips around."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QSplitter, QStackedWidget, QVBoxLayout, QWidget

from homolog_app.window.actions import Actions
from homolog_app.window.clip_bar import ClipBar
from homolog_app.window.icons import pixmap
from homolog_app.window.scene import Scene
from homolog_app.window.slice_view import SliceView
from homolog_app.window.theme import Theme
from homolog_app.window.view_bar import ViewBar, ViewFooter
from homolog_app.window.widgets import GRID, label

__all__ = ["Stage"]

_NARROWEST = 160


class Stage(QWidget):
    """Holds the scene and the slices; one of them, both, or a hint, are seen."""

    def __init__(self, theme: Theme, actions: Actions) -> None:
        super().__init__()
        self.bar = ViewBar(actions)
        self.footer = ViewFooter(actions)
        self.clip = ClipBar()
        self.slices = SliceView(theme)
        self.scene = Scene(self)
        self._theme = theme
        self._sign = QLabel(alignment=Qt.AlignmentFlag.AlignHCenter)
        self._title = label("", "EmptyTitle")
        self._text = label("", "Hint", wrap=True)
        self._text.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        self._text.setFixedWidth(420)
        self._pages = QStackedWidget()
        self._split = QSplitter()
        self._split.setChildrenCollapsible(False)
        self.scene.setMinimumWidth(_NARROWEST)
        for widget in (self.scene, self.slices):
            self._split.addWidget(widget)
        for page in (self._empty(), self._split):
            self._pages.addWidget(page)
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(0, 0, 0, 0)
        self._column.setSpacing(0)
        self._column.addWidget(self.bar)
        self._column.addWidget(self.clip)
        self._column.addWidget(self._pages, 1)
        self._column.addWidget(self.footer)
        theme.changed.connect(self._paint)
        self._paint()

    def show_hint(self, title: str, text: str) -> None:
        """Show what to do instead of the views."""
        self._title.setText(title)
        self._text.setText(text)
        self._pages.setCurrentIndex(0)

    def show_views(self) -> None:
        """Show the 3-D views."""
        self.slices.hide()
        self.scene.show()
        self._pages.setCurrentWidget(self._split)

    def show_slices(self) -> None:
        """Show the slices, alone or beside the views."""
        self.slices.show()
        self._split.setSizes([1, 1])
        self.scene.setVisible(self.slices.beside.isChecked())
        self._pages.setCurrentWidget(self._split)

    def place_card(self, card: QWidget) -> None:
        """Put a card between the views and the strip below them."""
        self._column.insertWidget(self._column.indexOf(self.footer), card)

    def _empty(self) -> QWidget:
        page = QWidget()
        page.setObjectName("Workspace")
        page.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        layout = QVBoxLayout(page)
        layout.setSpacing(GRID)
        layout.addStretch()
        for widget in (self._sign, self._title, self._text):
            layout.addWidget(widget, alignment=Qt.AlignmentFlag.AlignHCenter)
        layout.addStretch()
        return page

    def _paint(self) -> None:
        self._sign.setPixmap(pixmap("cohort", self._theme.colours.faint, 56))
        self.scene.paint(self._theme.colours)
