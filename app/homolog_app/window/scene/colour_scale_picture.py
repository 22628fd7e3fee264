"""The colour scale as a picture: title, unit, ticks and what its ends mean. The window shows it, too."""

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from homolog_app.rendering.colours import GREY, ColourScale
from homolog_app.rendering.scheme import Colours
from homolog_app.rendering.text import font_file, tick_labels, written

__all__ = ["HEIGHT", "MOST", "SIDE", "scale_picture"]

HEIGHT, MOST, SIDE = 64, 520, 120
"""Height of the strip, most of the bar's length, and room at its sides [pixels of a usual screen]."""

_BAR, _TOP = 12, 24
_TICKS = 5
_LETTERS, _PATCH = 12, 18


def scale_picture(
    scale: ColourScale, colours: Colours, width: int, ratio: float, *, transparent: bool = False
) -> NDArray[np.uint8]:
    """Return the scale as a strip of a picture, shape (height, width, 4).

    Parameters
    ----------
    scale : ColourScale
    colours : Colours
        Of the scheme.
    width : int
        Of the picture [pixels].
    ratio : float
        How many times as large as on a usual screen.
    transparent : bool
        Whether there is no background.
    """
    paper = "#00000000" if transparent else colours.scene
    page = Image.new("RGBA", (width, round(HEIGHT * ratio)), paper)
    draw = ImageDraw.Draw(page)
    size = round(_LETTERS * ratio)
    line = f"{scale.title} ({scale.unit})" if scale.unit else scale.title
    line += f" · {scale.note}" if scale.note else ""
    own = font_file(line + scale.grey_words)  # groups may be named in any script
    grey = f" · {scale.grey_words}" if scale.grey_words else ""
    patch = round(_PATCH * ratio) if grey else 0
    text, letters = written(line, own), _font(own, size)
    tail = written(grey, own)
    start = (width - draw.textlength(text, letters) - draw.textlength(tail, letters) - patch) / 2
    draw.text((start, 12 * ratio), text, colours.text, letters, anchor="lm")
    font = _font(font_file(), size)
    if grey:
        start += draw.textlength(f"{text} · ", letters)
        side = _LETTERS * ratio
        box = (start, 12 * ratio - side / 2, start + side, 12 * ratio + side / 2)
        draw.rectangle(box, GREY, colours.dim, max(1, round(ratio)))
        draw.text(
            (start + patch, 12 * ratio), written(scale.grey_words, own), colours.text, letters, anchor="lm"
        )
    length = round(min(MOST * ratio, width - 2 * SIDE * ratio))
    left, top = round((width - length) / 2), round(_TOP * ratio)
    bottom = top + round(_BAR * ratio)
    thin = max(1, round(ratio))
    table = Image.fromarray(np.ascontiguousarray(scale.table[None]))
    page.paste(table.resize((length, bottom - top), Image.Resampling.BILINEAR), (left, top))
    draw.rectangle((left, top, left + length, bottom), outline=colours.dim, width=thin)
    middle = (top + bottom) / 2
    draw.text((left - 8 * ratio, middle), scale.low_words, colours.text, font, anchor="rm")
    draw.text((left + length + 8 * ratio, middle), scale.high_words, colours.text, font, anchor="lm")
    values = np.linspace(scale.low, scale.high, _TICKS).tolist()
    for value, text in zip(values, _words(values), strict=True):
        x = left + length * (value - scale.low) / (scale.high - scale.low)
        draw.line((x, bottom, x, bottom + 4 * ratio), colours.text, thin)
        draw.text((x, bottom + 13 * ratio), text, colours.text, font, anchor="mm")
    return np.array(page)


def _words(values: list[float]) -> list[str]:
    """Return the ticks' words with three digits at the ends, and as many places in all."""
    most = max(abs(value) for value in values)
    places = max(0, 2 - int(np.floor(np.log10(most)))) if most else 0
    return tick_labels([round(value, places) for value in values])


@cache
def _font(path: Path, size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(path), max(size, 6))
