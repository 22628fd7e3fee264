"""Controls of a page of the window: the manual's pictures keep those that were there when they were made."""

import re
from typing import TYPE_CHECKING

from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QCheckBox,
    QComboBox,
    QLineEdit,
    QPushButton,
    QSlider,
    QWidget,
)

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["KEY", "controls_of", "open_page", "recorded"]

KEY = "controls"
"""Of the text in a picture's file: the name of the page, and its controls, one in a line."""

_NUMBER = re.compile(r"\d+ | · \d+$")  # such as of the particles that can be added, or of a list
_INNER = (QComboBox, QAbstractSpinBox)
_KINDS = (QCheckBox, QComboBox, QLineEdit, QPushButton, QSlider)


def controls_of(page: QWidget, *, primary: bool) -> set[str]:
    """Return the kinds and names of the controls of a page, visible or not.

    Parameters
    ----------
    page : QWidget
    primary : bool
        With primary buttons, whose text may follow the state of the study.
    """
    return {
        _NUMBER.sub(
            "", f"{kind.__name__} {control.accessibleName() or getattr(control, 'text', str)()}".strip()
        )
        for kind in _KINDS
        for control in page.findChildren(kind)
        if not isinstance(control.parentWidget(), _INNER) and (primary or control.property("primary") is None)
    }


def recorded(text: str) -> tuple[str, set[str]]:
    """Return the name and the controls of a page from the text of a picture; nothing if it shows none."""
    page, *controls = text.splitlines() or [""]
    return page, {_NUMBER.sub("", control) for control in controls}


def open_page(window: "MainWindow") -> QWidget:
    """Return the page that is open beside the views."""
    inspector = window.inspector
    panels: dict[str, QWidget] = {
        "cohort": inspector.cohort,
        "groom": inspector.groom,
        "correspond": inspector.correspond,
        "explore": inspector.explore.page,
    }
    return panels[window.workspace.session.step]
