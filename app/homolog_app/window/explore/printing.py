"""Printing of a patient's report."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage, QPageSize, QPainter
from PySide6.QtWidgets import QWidget

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.progress import Tick
from homolog_app.window.actions import Actions
from homolog_app.window.widgets import ActionButton, held

if TYPE_CHECKING:
    from PySide6.QtPrintSupport import QPrinter

    from homolog.patient import JointComparison, JointReference, PatientComparison, Reference
    from homolog.patient.findings import GroupRow
    from homolog_app.scenes.follow_up import PatientTimes

__all__ = ["draw_pages", "drawn_report", "print_pages", "report_buttons"]

_DPI = 300.0


def report_buttons(actions: Actions) -> QWidget:
    """Return *Save report…* and *Print…* in a row."""
    texts = {"Save report…": "patient.save", "Print…": "file.print"}
    return held([ActionButton(text, actions[name]) for text, name in texts.items()])


def drawn_report(
    comparison: "PatientComparison | JointComparison",
    reference: "Reference | JointReference",
    groups: Sequence["GroupRow"],
    times: "PatientTimes | None",
    tick: Tick,
) -> list[Array]:
    """Return the pages of a patient's report as pictures (H, W, 3): two, and further ones of a follow-up."""
    from homolog.patient.findings import pairs_of
    from homolog_app.report.follow_up import follow_up_page
    from homolog_app.report.patient import patient_page
    from homolog_app.report.sheets import drawn_sheets, sheets_of

    tick(0.0, "drawing the maps")
    sheets = sheets_of(patient_page(comparison, reference, groups))
    pair = pairs_of(comparison, reference).get("")
    if pair is not None and times is not None and times.follow_up is not None:
        tick(0.3, "drawing the follow-up")
        sheets += sheets_of(follow_up_page(times.follow_up, pair[1]))
    tick(0.6, "drawing the pages")
    return drawn_sheets(sheets, _DPI)


def print_pages(parent: QWidget, title: str, pages: Sequence[Array]) -> bool:
    """Ask for a printer and print pages; return whether they were printed.

    Parameters
    ----------
    parent : QWidget
    title : str
        Title of the document in the printer's queue.
    pages : sequence of (H, W, 3) uint8 arrays
        Whole sheets of A4 with their margins.

    Raises
    ------
    InputError
        If the printer does not accept the document.
    """
    from PySide6.QtPrintSupport import QPrintDialog, QPrinter

    printer = QPrinter(QPrinter.PrinterMode.HighResolution)
    printer.setDocName(title)
    printer.setPageSize(QPageSize(QPageSize.PageSizeId.A4))
    printer.setFullPage(True)
    dialog = QPrintDialog(printer, parent)
    dialog.setWindowTitle(f"Print: {title}")
    dialog.setMinMax(1, len(pages))
    accepted = dialog.exec() == QPrintDialog.DialogCode.Accepted
    dialog.deleteLater()
    if accepted:
        first, last = printer.fromPage() or 1, printer.toPage() or len(pages)
        draw_pages(printer, pages[first - 1 : last])
    return accepted


def draw_pages(printer: "QPrinter", pages: Sequence[Array]) -> None:
    """Draw each page as large as the paper; raises InputError if the printer can't be written to."""
    painter = QPainter()
    if not painter.begin(printer):
        raise InputError(
            f"{printer.printerName() or printer.outputFileName()}: printing failed; choose "
            "another printer, or print to a file"
        )
    for number, page in enumerate(pages):
        if number:
            printer.newPage()
        high, wide = page.shape[:2]
        image = QImage(page.tobytes(), wide, high, 3 * wide, QImage.Format.Format_RGB888)
        room = QRectF(painter.viewport())
        scale = min(room.width() / wide, room.height() / high)
        place = QRectF(0.0, 0.0, scale * wide, scale * high)
        place.moveCenter(room.center())
        painter.drawImage(place, image)
    painter.end()
