"""Opening the export dialogs."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from homolog.files.names import file_stems
from homolog_app.window.asking import Part, reported
from homolog_app.window.explore.modes_page import ModesPage
from homolog_app.window.export.kinds import KINDS

if TYPE_CHECKING:
    from homolog_app.window.export.dialog import Exported

__all__ = ["Exporting"]


class Exporting(Part):
    """The commands of File > Export."""

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return what the commands of exports do."""
        return {f"export.{name}": partial(self.open, name) for name in KINDS}

    @reported
    def open(self, name: str) -> None:
        """Open the dialog of an export."""
        from homolog_app.window.export.dialog import ExportDialog

        ExportDialog(self._window, KINDS[name], self._exported()).show()

    def _exported(self) -> "Exported":
        from homolog_app.report.study import column_of
        from homolog_app.window.export.dialog import Exported

        session, project = self._desk.session, self._desk.project
        assert session.result is not None, "the commands need a result"
        result = session.result.result
        columns = list(dict.fromkeys(name for one in result.columns for name in one))
        explore = self._window.inspector.explore
        shape = explore.fitted.shape
        modes = shape.modes if shape else len(result.names) - 1
        (stem,) = file_stems([session.title])
        return Exported(
            project=project.folder,
            name=stem,
            folder=project.folder.parent if session.folder else Path.home(),
            modes=modes,
            mode=min(explore.page_of(ModesPage).sliders.chosen + 1, modes),
            columns={name: column_of(result, name) for name in ("group", *columns)},
        )
