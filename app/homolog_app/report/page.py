"""The report's page: one HTML file that opens without a network. Its template escapes every text."""

import base64
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from homolog_app.rendering.text import complete_texts, typeset
from homolog_app.report.figures import ReportFigure

__all__ = ["Link", "Page", "Picture"]

_DPI = 150


@dataclass(frozen=True, slots=True)
class Link:
    """Words that lead to a file, by its path from the page."""

    text: str
    target: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture beside the page, by its path from there, its caption, and the file that it leads to."""

    source: str
    caption: str
    target: str


class Page:
    """A page that grows from top to bottom. Texts are plain: markup in them is shown as it is."""

    def __init__(self, title: str, notice: str, *, footer: str = "") -> None:
        self.title, self.notice, self._footer = title, notice, footer
        self.parts: list[dict[str, object]] = []

    def heading(self, text: str, level: int = 2) -> None:
        """Add a heading."""
        self._add("heading", text=text, level=level)

    def paragraph(self, text: str) -> None:
        """Add a paragraph."""
        self._add("paragraph", text=text)

    def caution(self, text: str) -> None:
        """Add a paragraph that stands out."""
        self._add("caution", text=text)

    def points(self, points: Iterable[tuple[str, str]]) -> None:
        """Add a list of points: what stands out, and what follows."""
        self._add("points", points=list(points))

    def table(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[str | Link]],
        *,
        as_text: bool = False,
        summary: str = "",
        omit: str | None = None,
    ) -> None:
        """Add a table; of text its cells are set to the left, with a summary it is folded away.

        Columns whose cells all are `omit` are left out.
        """
        rows = list(rows)
        kept = [index for index in range(len(columns)) if any(row[index] != omit for row in rows)]
        columns = [columns[index] for index in kept]
        rows = [[row[index] for index in kept] for row in rows]
        self._add("table", columns=columns, rows=rows, as_text=as_text, summary=summary)

    def figures(self, figures: Sequence[ReportFigure]) -> None:
        """Add figures, beside each other where they fit."""
        self._add("figures", figures=[_embedded(figure) for figure in figures])

    def pictures(self, pictures: Sequence[Picture]) -> None:
        """Add small pictures that lie beside the page, as many in a row as fit."""
        if pictures:
            self._add("pictures", pictures=pictures)

    def links(self, targets: Iterable[str], summary: str) -> None:
        """Add a list of files, by their paths from the page, folded away."""
        self._add("links", targets=list(targets), summary=summary)

    @property
    def html(self) -> str:
        """The whole page."""
        resources = files("homolog_resources")
        source, style = (
            (resources / name).read_text(encoding="utf-8") for name in ("report.html", "report.css")
        )
        environment = Environment(autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)
        environment.filters["typeset"] = _typeset
        return environment.from_string(source).render(
            title=self.title, notice=self.notice, footer=self._footer, parts=self.parts, style=style
        )

    def _add(self, kind: str, **content: object) -> None:
        self.parts.append({"kind": kind, **content})


_OPTION = re.compile(r"(?<!\S)--[a-z][\w-]*(?: \d+)?")


def _typeset(text: str) -> Markup:
    """Return an escaped text with the signs of print, and options of commands on one line."""
    return Markup(_OPTION.sub(r'<span class="unbroken">\g<0></span>', str(escape(typeset(text)))))


def _embedded(report_figure: ReportFigure) -> dict[str, object]:
    """Return a figure as the template takes it: its picture as text, its width [pixels], its caption."""
    picture, figure = io.BytesIO(), report_figure.figure
    complete_texts(figure)
    figure.savefig(picture, format="png", dpi=_DPI, facecolor=figure.get_facecolor())
    data = base64.b64encode(picture.getvalue()).decode("ascii")
    return {"data": data, "width": round(figure.get_figwidth() * 96), "caption": report_figure.caption}
