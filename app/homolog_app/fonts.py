"""What writes in pictures: DejaVu Sans, alike on all machines, and fonts of the system for signs it lacks."""

import importlib.util
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.ft2font import FT2Font

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

__all__ = ["complete_text", "complete_texts", "font_file", "legible", "written"]

_USUAL = "DejaVu Sans"
_BOX = "□"
_ODD = ("bold", "italic", "oblique", "black", "light", "thin", "mono", "serif")


@cache
def font_file(text: str = "") -> Path:
    """Return the first font that has all signs of some words, or else most: DejaVu Sans before others."""
    best, fewest = _usual_file(), _lacking(_usual_file(), text)
    for path in _system_files() if fewest else ():
        if len(lacking := _lacking(path, text)) < len(fewest):
            best, fewest = path, lacking
        if not fewest:
            break
    return best


def written(text: str, font: Path) -> str:
    """Return words with a box for each sign that a font lacks: VTK would leave out the whole line."""
    lacking = _lacking(font, text)
    return "".join(_BOX if sign in lacking else sign for sign in text)


def legible(text: str) -> str:
    """Return words with a box for each sign that no font has."""
    return "".join(written(sign, font_file(sign)) for sign in text)


def complete_texts(figure: "Figure") -> None:
    """Let all that a figure says be `complete_text`."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        complete_text(text)


def complete_text(text: "Text") -> None:
    """Let matplotlib write a text as it is: no part is a formula, each sign has a font or is a box."""
    text.set_parse_math(False)
    content = legible(text.get_text())
    fonts = {font_file(sign) for sign in content} - {_usual_file()}
    if fonts or content != text.get_text():
        text.set_text(content)
        text.set_fontfamily([_USUAL, *sorted(map(_family, fonts))])


@cache
def _usual_file() -> Path:
    """Return the file of DejaVu Sans, without loading the rest of matplotlib."""
    home = importlib.util.find_spec("matplotlib")
    assert home is not None
    assert home.origin is not None
    return Path(home.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"


@cache
def _system_files() -> tuple[Path, ...]:
    """Return the system's fonts, upright ones of usual weight first."""
    from matplotlib.font_manager import findSystemFonts

    def oddness(path: Path) -> tuple[int, str]:
        return sum(word in path.stem.lower() for word in _ODD), str(path)

    return tuple(sorted(map(Path, findSystemFonts()), key=oddness))


@cache
def _font(path: Path) -> FT2Font | None:
    try:
        return FT2Font(str(path))
    except (OSError, RuntimeError):  # damaged, or of a kind that FreeType doesn't know
        return None


def _lacking(path: Path, text: str) -> frozenset[str]:
    font = _font(path)
    return frozenset(sign for sign in text if sign != "\n" and not (font and font.get_char_index(ord(sign))))


def _family(path: Path) -> str:
    from matplotlib.font_manager import fontManager

    font = _font(path)
    assert font is not None
    if font.family_name not in fontManager.get_font_names():
        fontManager.addfont(path)
    return font.family_name
