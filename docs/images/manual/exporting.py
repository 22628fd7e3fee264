"""The manual's picture of an export."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QWidget

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["keep_exporting"]


def keep_exporting(
    window: "MainWindow", until: Callable[[Callable[[], object]], None], keep: Callable[[str, QWidget], None]
) -> None:
    """Keep the dialog of a film of two modes, with its preview; the window has a result."""
    from homolog_app.window.export.dialog import ExportDialog

    window.commands["export.film"].trigger()
    (dialog,) = window.findChildren(ExportDialog)
    dialog.chooser.modes.setText("1 2")
    dialog.place.setText("beans.mp4")
    until(lambda: not dialog.preview.pixmap().isNull())
    keep("export", dialog)
    dialog.close()
