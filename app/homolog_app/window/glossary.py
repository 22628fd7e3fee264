"""Sentences on technical words, shown where the pointer rests on a text that has them."""

import re
from functools import cache
from importlib.resources import files

from PySide6.QtCore import QPoint
from PySide6.QtWidgets import QAbstractButton, QComboBox, QLabel, QTabBar, QWidget

__all__ = ["explanation", "sentences", "text_of"]

_SECTIONS = ("Surfaces", "Correspondence", "Shape model and statistics")
_MOST = 3
_LINK, _SIGN = re.compile(r"\[([^\]]*)\]\([^)]*\)"), re.compile(r"[*`]|\s*\([^)]*\)$")


@cache
def sentences() -> dict[str, str]:
    """Return the meaning of each term of the glossary that the window uses."""
    source = (files("homolog_resources") / "glossary.md").read_text(encoding="utf-8")
    result = {}
    for section in source.split("\n## ")[1:]:
        title, _, body = section.partition("\n")
        rows = [line.strip("| ").split(" | ", 1) for line in body.splitlines() if line.startswith("| ")]
        for terms, meaning in rows[1:] if title in _SECTIONS else ():
            plain = _LINK.sub(r"\1", meaning).replace("*", "").replace("`", "")
            for term in terms.split(", "):
                result[_SIGN.sub("", term).strip()] = re.sub(r"\s*\([\w.]+\.md\)", "", plain)
    return result


def explanation(text: str) -> str:
    """Return a line for each of the first terms of the glossary in a text; empty if there are none."""
    places: dict[str, tuple[int, str]] = {}
    for term, meaning in sentences().items():
        plain = 0 if len(term) == 1 else re.IGNORECASE
        place = re.search(rf"(?<![\w-]){re.escape(term)}(?:s|es)?\b", text, plain)
        if place is not None:
            places[meaning] = min(places.get(meaning, (len(text), "")), (place.start(), term))
    first = sorted((*place, meaning) for meaning, place in places.items())[:_MOST]
    heads = (term if len(term) == 1 else f"{term[:1].upper()}{term[1:]}" for _, term, _ in first)
    return "\n".join(f"{head}: {meaning}." for head, (*_, meaning) in zip(heads, first, strict=True))


def text_of(widget: QWidget | None, at: QPoint) -> str:
    """Return what a label, button, box or tab says at a place of the screen."""
    if isinstance(widget, QComboBox):
        return widget.currentText()
    if isinstance(widget, QLabel | QAbstractButton):
        return widget.text().replace("&", "")
    if isinstance(widget, QTabBar):
        return widget.tabText(widget.tabAt(widget.mapFromGlobal(at)))
    return ""
