"""Text in pictures: fonts for all characters, short numbers, and anatomical letters at the edges."""

import importlib.util
import math
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.ft2font import FT2Font
    from matplotlib.text import Text

__all__ = [
    "ENERGIES",
    "aligned",
    "complete_text",
    "complete_texts",
    "direction_letters",
    "duration",
    "edge_letters",
    "font_file",
    "legible",
    "millilitres",
    "parse_number",
    "short",
    "shortened",
    "signed",
    "tick_labels",
    "typeset",
    "written",
]


ENERGIES = {
    "Sampling": "evenness on each surface",
    "Ensemble": "agreement across shapes",
    "Normals": "agreement of normals",
}
"""The terms of the objective, and what each stands for."""

_USUAL = "DejaVu Sans"
_BOX = "□"
_ODD = ("bold", "italic", "oblique", "black", "light", "thin", "mono", "serif")


def aligned(rows: Sequence[Sequence[str]], *, to_right: bool = False) -> list[str]:
    """Return the lines of a table in a fixed font, the columns after the first to the left or right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [cell.rjust(w) if to_right else cell.ljust(w) for cell, w in zip(row, widths, strict=True)]
        lines.append("  ".join([row[0].ljust(widths[0]), *cells[1:]]).rstrip())
    return lines


@cache
def font_file(text: str = "") -> Path:
    """Return the first font with all, or otherwise most, characters of a text, starting with DejaVu Sans."""
    best, fewest = usual_file(), signs_lacking(usual_file(), text)
    for path in system_files() if fewest else ():
        if len(missing := signs_lacking(path, text)) < len(fewest):
            best, fewest = path, missing
        if not fewest:
            break
    return best


def written(text: str, font: Path) -> str:
    """Return text with a box for each character that a font lacks: VTK would omit the whole line."""
    missing = signs_lacking(font, text)
    return "".join(_BOX if sign in missing else sign for sign in text)


def legible(text: str) -> str:
    """Return text with a box for each character that no font has."""
    return "".join(written(sign, font_file(sign)) for sign in text)


_TYPESET = (
    (re.compile(r"(?<![\w-])-(?=\d)| - "), lambda match: match[0].replace("-", "\u2212")),
    (re.compile(r" ?[=<>≤≥] (?=[\u2212+]?\d)"), lambda match: match[0].replace(" ", "\u00a0")),
    (re.compile(r"(?<=\d) (?=(mm²|mm|ml|SD|s|%)(?!\w))"), "\u00a0"),
    (re.compile(r"(?<=%) (?=CI)|(?<=CI) (?=[\u2212+]?\d)"), "\u00a0"),
    (
        re.compile(r"F\(\d+, |\d \([\u2212+]?[\d.]+ to [\u2212+]?[\d.]+\)"),
        lambda match: match[0].replace(" ", "\u00a0"),
    ),
)


def typeset(text: str) -> str:
    """Return text with minus signs, and with numbers kept next to their units and intervals."""
    for pattern, instead in _TYPESET:
        text = pattern.sub(instead, text)
    return text


def complete_texts(figure: "Figure") -> None:
    """Apply `complete_text` to all texts of a figure."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        complete_text(text)


def complete_text(text: "Text") -> None:
    """Make matplotlib draw a text literally: without formulas, and with a font or box for each character."""
    text.set_parse_math(False)
    content = legible(text.get_text())
    fonts = {font_file(sign) for sign in content} - {usual_file()}
    if fonts or content != text.get_text():
        text.set_text(content)
        text.set_fontfamily([_USUAL, *sorted(map(_family, fonts))])


@cache
def usual_file() -> Path:
    """Return the file of DejaVu Sans, without loading the rest of matplotlib."""
    home = importlib.util.find_spec("matplotlib")
    assert home is not None
    assert home.origin is not None
    return Path(home.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"


@cache
def system_files() -> tuple[Path, ...]:
    """Return the system's fonts, upright ones of regular weight first."""
    from matplotlib.font_manager import findSystemFonts

    def oddness(path: Path) -> tuple[int, str]:
        return sum(word in path.stem.lower() for word in _ODD), str(path)

    return tuple(sorted(map(Path, findSystemFonts()), key=oddness))


@cache
def _font(path: Path) -> "FT2Font | None":
    from matplotlib.ft2font import FT2Font

    try:
        return FT2Font(str(path))
    except (OSError, RuntimeError):  # damaged, or not supported by FreeType
        return None


def signs_lacking(path: Path, text: str) -> frozenset[str]:
    font = _font(path)
    return frozenset(sign for sign in text if sign != "\n" and not (font and font.get_char_index(ord(sign))))


def _family(path: Path) -> str:
    from matplotlib.font_manager import fontManager

    font = _font(path)
    assert font is not None
    if font.family_name not in fontManager.get_font_names():
        fontManager.addfont(path)
    return font.family_name


def parse_number(text: str) -> float:
    """Return the number of a text with a decimal point or comma; raises ValueError for anything else."""
    if "_" in text:
        raise ValueError(f"{text!r} is not a number")
    return float(text.strip().replace(",", ".").replace("−", "-"))


def duration(seconds: float) -> str:
    """Return a rounded duration as text: ``"about 3 min"``."""
    if seconds < 60:
        return f"about {max(5, round(seconds / 5) * 5)} s"
    if seconds < 5400:
        return f"about {round(seconds / 60)} min"
    return f"about {seconds / 3600:.1f} h"


def signed(value: float, digits: int = 2) -> str:
    """Return a number with its sign, a true minus and fixed digits: ``"+1.50"``, ``"0.00"``."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", "−")


def shortened(text: str, most: int) -> str:
    """Return a text of at most `most` letters; the middle of longer texts is omitted."""
    if len(text) <= most:
        return text
    kept = max(most - 1, 2)
    return f"{text[: kept - kept // 2]}…{text[len(text) - kept // 2 :]}"


def short(value: float) -> str:
    """Return a number with three significant digits, or all digits before the point, and a true minus."""
    if abs(value) <= 1e-12:
        return "0"
    return (f"{value:.0f}" if 1000.0 <= abs(value) < 1e6 else f"{value:.3g}").replace("-", "−")


def millilitres(volume: float) -> str:
    """Return a volume with three or more significant digits: ``"96.0 ml"``, ``"1532 ml"``."""
    digits = 2 - math.floor(math.log10(volume)) if volume > 0.0 else 0
    return f"{volume:.{min(max(digits, 0), 6)}f} ml"


def tick_labels(values: Sequence[float]) -> list[str]:
    """Return the labels of evenly spaced ticks, with enough digits to distinguish them."""
    step = values[1] - values[0] if len(values) > 1 else 1.0
    digits = next(
        digits for digits in range(10) if digits == 9 or abs(round(step, digits) - step) < 1e-3 * step
    )
    return [f"{value + 0.0:.{digits}f}".replace("-", "−") for value in values]


_POSITIVE, _NEGATIVE = "LPS", "RAI"
_OBLIQUE = 0.42  # sine of 25 degrees


def direction_letters(direction: FloatArray) -> str:
    """Name a direction in patient coordinates (LPS): ``"L"``, or ``"LA"`` if it lies between two axes."""
    order = np.argsort(-np.abs(direction))
    named = [axis for axis in order[:2] if abs(direction[axis]) >= _OBLIQUE]
    return "".join(_POSITIVE[axis] if direction[axis] > 0 else _NEGATIVE[axis] for axis in named)


def edge_letters(patient_axes: FloatArray, right: FloatArray, up: FloatArray) -> tuple[str, str, str, str]:
    """Return the letters at the left, right, bottom and top edge.

    Parameters
    ----------
    patient_axes : (3, 3) array
        Columns: the patient's left, back and head in displayed coordinates.
    right, up : (3,) arrays
        The screen's unit directions in the same coordinates.
    """
    across, along = patient_axes.T @ right, patient_axes.T @ up
    return (
        direction_letters(-across),
        direction_letters(across),
        direction_letters(-along),
        direction_letters(along),
    )
