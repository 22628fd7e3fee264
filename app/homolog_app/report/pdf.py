"""PDF files of A4 pages: figures embedded as vector graphics, and bookmarks."""

import io
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends import backend_pdf
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_pdf import Op, PdfPages
from matplotlib.figure import Figure

__all__ = ["Bookmark", "EmbeddedFigure", "pdf_of"]

_POINTS = 72.0
"""PDF points per inch."""
_name: Any = backend_pdf.Name  # matplotlib does not type it


class Bookmark(NamedTuple):
    """An entry of the list of contents: its level (1, 2 …), and its page, counted from 1."""

    text: str
    level: int
    page: int


class EmbeddedFigure(Artist):
    """A figure that is drawn as a part of another one: as vector graphics in PDF, as a picture elsewhere.

    Parameters
    ----------
    figure : Figure
        Figure to embed.
    left, bottom : float
        Its lower left corner [inches].
    scale : float
        Its width on the page divided by its own.
    """

    def __init__(self, figure: Figure, left: float, bottom: float, scale: float) -> None:
        super().__init__()
        self.content, self.place = figure, (left * _POINTS, bottom * _POINTS, scale)
        for artist in figure.findobj():
            artist.set_rasterized(False)  # pixels of colour bars would be misplaced

    def draw(self, renderer: Any) -> None:  # noqa: ANN401 - matplotlib does not type it
        """Draw the figure in its own coordinates, to which those of the page are changed temporarily."""
        left, bottom, scale = self.place
        takes_vectors = isinstance(renderer, backend_pdf.RendererPdf | MixedModeRenderer)
        if not takes_vectors:
            self._draw_picture(renderer)
            return
        file, state = renderer.file, renderer.gc
        file.output(*state.finalize())
        before = renderer.new_gc()
        before.copy_properties(state)
        file.output(Op.gsave, scale, 0, 0, scale, left, bottom, Op.concat_matrix)
        dpi = self.content.dpi
        try:
            self.content.dpi = _POINTS
            self.content.draw(renderer)
        finally:
            self.content.dpi = dpi
        file.output(*state.finalize(), Op.grestore)
        state.copy_properties(before)

    def _draw_picture(self, renderer: Any) -> None:  # noqa: ANN401
        left, bottom, scale = self.place
        dpi, page = self.content.dpi, renderer.dpi / _POINTS
        canvas: Any = FigureCanvasAgg(self.content)
        try:
            self.content.dpi = renderer.dpi * scale
            canvas.draw()
            pixels = np.asarray(canvas.buffer_rgba())[::-1]
        finally:
            self.content.dpi = dpi
        renderer.draw_image(renderer.new_gc(), round(left * page), round(bottom * page), pixels)


def pdf_of(figures: Sequence[Figure], title: str, bookmarks: Sequence[Bookmark] = ()) -> bytes:
    """Return a PDF with a page for each figure."""
    drawn = io.BytesIO()
    with _Document(drawn, metadata={"CreationDate": None, "Title": title}) as pages:
        for figure in figures:
            pages.savefig(figure)
        if bookmarks:
            pages.add_bookmarks(bookmarks)
    return drawn.getvalue()


class _Document(PdfPages):
    """A PDF with bookmarks, which matplotlib does not write by itself."""

    def add_bookmarks(self, bookmarks: Sequence[Bookmark]) -> None:
        """Add bookmarks to the existing pages, and show them when the file is opened."""
        file: Any = self._file
        file.endStream()
        outline = file.reserveObject("outline")
        objects = [file.reserveObject("bookmark") for _ in bookmarks]
        parents = _parents([bookmark.level for bookmark in bookmarks])
        for number, bookmark in enumerate(bookmarks):
            parent = parents[number]
            entry: dict[str, object] = {
                "Title": bookmark.text,
                "Parent": outline if parent is None else objects[parent],
                "Dest": [file.pageList[bookmark.page - 1], _name("Fit")],
            }
            siblings = [index for index, other in enumerate(parents) if other == parent]
            place = siblings.index(number)
            if place:
                entry["Prev"] = objects[siblings[place - 1]]
            if place + 1 < len(siblings):
                entry["Next"] = objects[siblings[place + 1]]
            file.writeObject(objects[number], entry | _children(objects, parents, number))
        file.writeObject(outline, {"Type": _name("Outlines")} | _children(objects, parents, None))
        root = {
            "Type": _name("Catalog"),
            "Pages": file.pagesObject,
            "Outlines": outline,
            "PageMode": _name("UseOutlines"),
        }
        file.writeObject(file.rootObject, root)  # replaces the initial one


def _parents(levels: Sequence[int]) -> list[int | None]:
    """Return the index of each entry's parent from the levels."""
    parents: list[int | None] = []
    above: list[int] = []
    for number, level in enumerate(levels):
        while above and levels[above[-1]] >= level:
            above.pop()
        parents.append(above[-1] if above else None)
        above.append(number)
    return parents


def _children(
    objects: Sequence[object], parents: Sequence[int | None], parent: int | None
) -> dict[str, object]:
    """Return the first, the last and the number of an entry's children, collapsed below the first level."""
    below = [index for index, other in enumerate(parents) if other == parent]
    if not below:
        return {}
    count = len(below) if parent is None else -len(below)
    return {"First": objects[below[0]], "Last": objects[below[-1]], "Count": count}
