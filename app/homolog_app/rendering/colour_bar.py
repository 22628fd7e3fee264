"""The colour scale as a picture: below the views, and below saved pictures."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from homolog_app.rendering.colours import GREY, Colours, ColourScale
from homolog_app.rendering.text import font_file, tick_labels, written

__all__ = ["HEIGHT", "SIDE", "WIDEST", "legend_picture", "scale_height", "scale_picture"]

_DOT = " · "

HEIGHT, WIDEST, SIDE = 64, 520, 120
"""Height of the strip, maximum length of the bar, and margins at its sides [pixels at a ratio of 1]."""

_BAR, _TOP = 12, 24
_TICKS = 5
_LETTERS, _PATCH, _SECOND = 12, 18, 16  # last: distance to a second line


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
        Pixels of the picture per pixel of a screen without scaling.
    transparent : bool
        Whether the background is transparent.
    """
    paper = "#00000000" if transparent else colours.scene
    page = Image.new("RGBA", (width, scale_height(scale, width, ratio)), paper)
    draw = ImageDraw.Draw(page)
    size, middle = round(_LETTERS * ratio), 12 * ratio
    for parts in _title_lines(scale, width, ratio):
        _draw_title(draw, parts, colours, width, middle, ratio)
        middle += _SECOND * ratio
    down = middle - (12 + _SECOND) * ratio  # because of a second line
    font = _font(font_file(), size)
    beside = max(font.getlength(text) for text in (scale.low_label, scale.high_label)) + 12 * ratio
    length = round(min(WIDEST * ratio, width - 2 * max(SIDE * ratio, beside)))
    left, top = round((width - length) / 2), round(_TOP * ratio + down)
    bottom = top + round(_BAR * ratio)
    thin = max(1, round(ratio))
    table = Image.fromarray(np.ascontiguousarray(scale.table[None]))
    page.paste(table.resize((length, bottom - top), Image.Resampling.BILINEAR), (left, top))
    draw.rectangle((left, top, left + length, bottom), outline=colours.dim, width=thin)
    middle = (top + bottom) / 2
    draw.text((left - 8 * ratio, middle), scale.low_label, colours.text, font, anchor="rm")
    draw.text((left + length + 8 * ratio, middle), scale.high_label, colours.text, font, anchor="lm")
    values = np.linspace(scale.low, scale.high, _TICKS).tolist()
    labels = _tick_labels(values)
    if sum(map(font.getlength, labels)) + 4 * size > length:  # only every second label fits
        values, labels = values[::2], labels[::2]
    for value, text in zip(values, labels, strict=True):
        x = left + length * (value - scale.low) / (scale.high - scale.low)
        draw.line((x, bottom, x, bottom + 4 * ratio), colours.text, thin)
        draw.text((x, bottom + 13 * ratio), text, colours.text, font, anchor="mm")
    return np.array(page)


def legend_picture(
    entries: Mapping[str, tuple[int, int, int]],
    colours: Colours,
    width: int,
    ratio: float,
    *,
    transparent: bool = False,
) -> NDArray[np.uint8]:
    """Return names beside patches of their colours as a strip of a picture, shape (height, width, 4).

    Names that don't fit into a line continue in the next one. Other parameters as for `scale_picture`.
    """
    size, own = round(_LETTERS * ratio), font_file("".join(entries))
    font, line = _font(own, size), round(_TOP * ratio)
    lines: list[list[tuple[str, float]]] = [[]]
    for name in entries:
        taken = _PATCH * ratio + font.getlength(written(name, own)) + 2 * size
        if lines[-1] and sum(part for _, part in lines[-1]) + taken > width:
            lines.append([])
        lines[-1].append((name, taken))
    page = Image.new("RGBA", (width, line * len(lines)), "#00000000" if transparent else colours.scene)
    draw = ImageDraw.Draw(page)
    for number, row in enumerate(lines):
        left, middle = (width - sum(part for _, part in row)) / 2 + size, (number + 0.5) * line
        for name, taken in row:
            box = (left, middle - size / 2, left + size, middle + size / 2)
            draw.rectangle(box, entries[name], colours.dim, max(1, round(ratio)))
            place = left + _PATCH * ratio, middle
            draw.text(place, written(name, own), colours.text, font, anchor="lm")
            left += taken
    return np.array(page)


def scale_height(scale: ColourScale, width: int, ratio: float) -> int:
    """Return the height of the picture of a scale; parameters as for `scale_picture`."""
    further = len(_title_lines(scale, width, ratio)) - 1
    return round((HEIGHT + further * _SECOND) * ratio)


def _title_lines(scale: ColourScale, width: int, ratio: float) -> list[tuple[str, str]]:
    """Return the title and the meaning of grey, in one line, or in two if they are wider than the picture."""
    line = f"{scale.title} ({scale.unit})" if scale.unit else scale.title
    line += f" · {scale.note}" if scale.note else ""
    whole = line, scale.grey_label
    is_wide = _title_width(whole, round(_LETTERS * ratio), ratio) > width - _LETTERS * ratio
    return [(line, ""), ("", scale.grey_label)] if is_wide and line and scale.grey_label else [whole]


def _title_font(parts: tuple[str, str], size: int) -> ImageFont.FreeTypeFont:
    return _font(font_file("".join(parts)), size)  # groups may be named in any script


def _title_width(parts: tuple[str, str], size: int, ratio: float) -> float:
    text, grey = parts
    letters = _title_font(parts, size)
    own = font_file("".join(parts))
    gap = letters.getlength(_DOT) if text and grey else 0.0
    return sum(letters.getlength(written(part, own)) for part in parts) + gap + _PATCH * ratio * bool(grey)


def _draw_title(
    draw: ImageDraw.ImageDraw,
    parts: tuple[str, str],
    colours: Colours,
    width: int,
    middle: float,
    ratio: float,
) -> None:
    """Draw a line of the title in the middle, in smaller letters if it is too wide."""
    size, room, (text, grey) = round(_LETTERS * ratio), width - _LETTERS * ratio, parts
    if (whole := _title_width(parts, size, ratio)) > room:
        size = int(size * room / whole)
        whole = _title_width(parts, size, ratio)
    letters, own, start = _title_font(parts, size), font_file("".join(parts)), (width - whole) / 2
    draw.text((start, middle), written(text, own), colours.text, letters, anchor="lm")
    if grey:
        start += letters.getlength(written(text, own)) + (letters.getlength(_DOT) if text else 0.0)
        side = _LETTERS * ratio
        box = (start, middle - side / 2, start + side, middle + side / 2)
        draw.rectangle(box, GREY, colours.dim, max(1, round(ratio)))
        place = start + _PATCH * ratio, middle
        draw.text(place, written(grey, own), colours.text, letters, anchor="lm")


def _tick_labels(values: list[float]) -> list[str]:
    """Return the labels of ticks: three digits at the ends, the same number of decimals in all."""
    most = max(abs(value) for value in values)
    places = max(0, 2 - int(np.floor(np.log10(most)))) if most else 0
    return tick_labels([round(value, places) for value in values])


@cache
def _font(path: Path, size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(path), max(size, 6))
