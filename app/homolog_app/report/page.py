"""The report's page: one HTML file that opens without a network. Every text is escaped here."""

import base64
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from urllib.parse import quote

from homolog_app.fonts import complete_texts
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
        self._title = title
        self._footer = f'<p class="footer">{escape(footer)}</p>' if footer else ""
        self._parts = [f"<h1>{escape(title)}</h1>", f'<p class="notice">{escape(notice)}</p>']

    def heading(self, text: str, level: int = 2) -> None:
        """Add a heading."""
        self._parts.append(f"<h{level}>{escape(text)}</h{level}>")

    def paragraph(self, text: str) -> None:
        """Add a paragraph."""
        self._parts.append(f"<p>{_text(text)}</p>")

    def caution(self, text: str) -> None:
        """Add a paragraph that stands out."""
        self._parts.append(f'<p class="caution">{_text(text)}</p>')

    def points(self, points: Iterable[tuple[str, str]]) -> None:
        """Add a list of points: what stands out, and what follows."""
        items = "".join(f"<li><b>{_text(first)}</b> {_text(rest)}</li>" for first, rest in points)
        self._parts.append(f"<ul>{items}</ul>")

    def table(
        self,
        columns: Sequence[str],
        rows: Iterable[Sequence[str | Link]],
        *,
        as_text: bool = False,
        summary: str = "",
    ) -> None:
        """Add a table; of text its cells are set to the left, with a summary it is folded away."""
        head = "".join(f"<th>{escape(column)}</th>" for column in columns)
        body = "".join("<tr>" + "".join(f"<td>{_cell(cell)}</td>" for cell in row) + "</tr>" for row in rows)
        kind = ' class="words"' if as_text else ""
        table = f'<div class="scroll"><table{kind}><tr>{head}</tr>{body}</table></div>'
        if summary:
            table = f"<details><summary>{escape(summary)}</summary>{table}</details>"
        self._parts.append(table)

    def figures(self, figures: Sequence[ReportFigure]) -> None:
        """Add figures, beside each other where they fit."""
        inner = "".join(_figure(figure) for figure in figures)
        self._parts.append(f'<div class="row">{inner}</div>' if len(figures) > 1 else inner)

    def pictures(self, pictures: Sequence[Picture]) -> None:
        """Add small pictures that lie beside the page, as many in a row as fit."""
        inner = "".join(
            f'<figure><a href="{_address(picture.target)}"><img src="{_address(picture.source)}" width="240" '
            f'alt="{escape(picture.caption)}"></a><figcaption>{escape(picture.caption)}</figcaption></figure>'
            for picture in pictures
        )
        self._parts.append(f'<div class="tiles">{inner}</div>' if inner else "")

    def links(self, targets: Iterable[str], summary: str) -> None:
        """Add a list of files, by their paths from the page, folded away."""
        items = "".join(f'<li><a href="{escape(target)}">{escape(target)}</a></li>' for target in targets)
        self._parts.append(f"<details><summary>{escape(summary)}</summary><ul>{items}</ul></details>")

    @property
    def html(self) -> str:
        """The whole page."""
        style = (files("homolog_resources") / "report.css").read_text(encoding="utf-8")
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self._title)}</title><style>\n{style}</style></head>\n<body>\n"
            + "\n".join(self._parts)
            + self._footer
            + "\n</body></html>\n"
        )


def _cell(cell: str | Link) -> str:
    if isinstance(cell, Link):
        return f'<a href="{_address(cell.target)}">{escape(cell.text)}</a>'
    return escape(cell)


def _address(path: str) -> str:
    return escape(quote(path))


def _text(text: str) -> str:
    """Escape text, and keep both sides of an equation on one line."""
    return escape(text.replace(" = ", "\u00a0=\u00a0").replace(" %", "\u00a0%"))


def _figure(report_figure: ReportFigure) -> str:
    picture = io.BytesIO()
    complete_texts(report_figure.figure)
    report_figure.figure.savefig(
        picture, format="png", dpi=_DPI, facecolor=report_figure.figure.get_facecolor()
    )
    data = base64.b64encode(picture.getvalue()).decode("ascii")
    width = round(report_figure.figure.get_figwidth() * 96)
    return (
        f'<figure><img src="data:image/png;base64,{data}" width="{width}" '
        f'alt="{escape(report_figure.caption)}">'
        f"<figcaption>{_text(report_figure.caption)}</figcaption></figure>"
    )
