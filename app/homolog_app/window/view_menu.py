"""The menu of a view: what can be done with the shape under the pointer."""

from typing import TYPE_CHECKING

from PySide6.QtWidgets import QMenu

from homolog_app.views.cell import VIEWS

if TYPE_CHECKING:
    from homolog_app.window.main_window import MainWindow

__all__ = ["view_menu"]

_SHOWN = ("view.raw", "view.groomed", "view.particles", "view.clip")
_PICTURES = ("view.copy", "view.screenshot", "view.range")


def view_menu(window: "MainWindow", name: str) -> QMenu:
    """Return the menu of a view.

    Parameters
    ----------
    window : MainWindow
    name : str
        Of the subject or shape that the view shows; nothing if it shows none.
    """
    menu, views = QMenu(window), window.views
    subjects = {member.name for member in window.workspace.session.study.included}
    if name in subjects and views is not None:
        menu.addAction(f"Select {name.replace('&', '&&')}", lambda: window.workspace.session.select([name]))
        only = menu.addAction("Show only this subject", lambda: views.show_only(name))
        only.setEnabled(not views.shows_model)
        menu.addSeparator()
    camera = menu.addMenu("Look from")
    for view in VIEWS:
        camera.addAction(window.commands[f"view.{view}"])
    menu.addAction(window.commands["view.reset"])
    menu.addSeparator()
    for part in (_SHOWN, _PICTURES):
        for identifier in part:
            menu.addAction(window.commands[identifier])
        menu.addSeparator()
    return menu
