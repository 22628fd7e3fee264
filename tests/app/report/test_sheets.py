"""A page as sheets of a PDF."""

import re

from homolog_app.plots import new_figure
from homolog_app.rendering.colours import LIGHT, page_colours
from homolog_app.report.figures import ReportFigure
from homolog_app.report.page import Page
from homolog_app.report.pdf import EmbeddedFigure
from homolog_app.report.sheets import sheets_of, wrapped_cells, write_page


def test_an_interval_that_is_wider_than_its_column_breaks_between_its_numbers():
    (lines,) = wrapped_cells(["-9.64 (-11.52 to -7.77)"], [5.9])
    assert len(lines) == 2
    assert " ".join(lines).split() == ["\u22129.64", "(\u221211.52", "to", "\u22127.77)"]


def test_rows_of_a_long_table_are_not_broken_and_every_sheet_repeats_number_and_header():
    page = Page("title", "notice")
    page.paragraph("above")
    page.table(["number", "remark"], [(f"row {row}", "long " * 60) for row in range(40)], caption="Remarks")
    sheets = sheets_of(page)
    assert len(sheets) > 2
    rows = []
    for number, sheet in enumerate(sheets):
        texts = {text.get_text(): text for text in sheet.figure.texts}
        assert ("Table 1. Remarks" if number == 0 else "Table 1 (continued)") in texts
        assert {"number", "remark"} <= set(texts)
        rows += [name for name in texts if name.startswith("row ")]
        sheet.figure.canvas.draw()
        lowest = min(text.get_window_extent().y0 for text in texts.values())
        assert lowest / sheet.figure.dpi > 0.5
        long = [text for text in sheet.figure.texts if text.get_text().startswith("long")]
        assert len({len(text.get_text().splitlines()) for text in long}) == 1
    assert rows == [f"row {row}" for row in range(40)]


def test_a_pdf_has_bookmarks_and_figures_as_vector_graphics(tmp_path):
    page = Page("title", "notice")
    for number in range(9):
        page.heading(f"Chapter {number}")
        page.heading(f"Section {number}", 3)
        page.paragraph("word " * 900)
    figure = new_figure(4.0, 3.0, page_colours(LIGHT))
    figure.subplots().plot([0, 1], [0, 1])
    page.figures([ReportFigure("line", figure, "A line")])
    write_page(tmp_path / "page.pdf", page)
    content = (tmp_path / "page.pdf").read_bytes()
    assert content.count(b"/Type /Outlines") == 1
    assert b"/Count 9" in content
    assert content.count(b"/Dest [") == 18
    assert b"/Subtype /Image" not in content
    assert len(re.findall(rb"/Type /Page\b", content)) == len(sheets_of(page))


def test_figures_of_a_row_stay_together_on_a_sheet():
    page = Page("title", "notice")
    page.paragraph("word " * 840)
    page.figures(
        [
            ReportFigure(f"plot {high}", new_figure(3.0, high, page_colours(LIGHT)), "A caption", small=True)
            for high in (2.0, 3.5)
        ]
    )
    rows = [
        [item.content.get_figheight() for item in sheet.figure.artists if isinstance(item, EmbeddedFigure)]
        for sheet in sheets_of(page)
    ]
    assert rows == [[], [2.0, 3.5]]
