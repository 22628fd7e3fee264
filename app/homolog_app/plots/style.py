"""Style of plots: colours and markers of groups, fonts, frames, texts shortened to the room."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from homolog_app.rendering.colours import Colours
from homolog_app.rendering.text import shortened

__all__ = [
    "DPI", "FONT_PT", "LETTER", "LINE_PT", "TICK_PT", "dress", "group_order", "group_style", "legend_above",
    "letters", "new_figure", "points_in", "width_of",
]  # fmt: skip

DPI = 96
"""Pixels per inch on the screen."""
FONT_PT, TICK_PT, LINE_PT = 9.0, 8.0, 1.2
LETTER = 0.55
"""Mean width of a letter, in sizes of the font."""

_LABEL, _KEY = 30, 4  # letters of a label in a legend, and what its marker takes
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def new_figure(width: float, height: float, colours: Colours) -> Figure:
    """Return an empty page of a report, in inches."""
    figure = Figure(figsize=(width, height), dpi=150, facecolor=colours.surface, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def group_order(groups: Sequence[str]) -> list[str]:
    """Return the groups in the order of their colours: by name, subjects without a group last."""
    return sorted(set(groups), key=lambda name: (not name, name))


def group_style(index: int, colours: Colours) -> tuple[str, str]:
    """Return the colour and the marker of a group by its place in `group_order`; no two look alike."""
    count = len(_MARKERS)
    return colours.groups[(index + index // count) % count], _MARKERS[index % count]


def dress(axes: Axes, colours: Colours, title: str = "", x_label: str = "", y_label: str = "") -> None:
    """Give axes the scheme's colours, and title and labels shortened to the room."""
    axes.set_facecolor(colours.surface)
    axes.tick_params(labelsize=TICK_PT, color=colours.faint, labelcolor=colours.dim, length=3.0)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(colours.faint)
    across, up = letters(axes, axes.bbox.width), letters(axes, 1.3 * axes.bbox.height)
    if title:
        lines = [shortened(line, across) for line in title.splitlines()]
        axes.set_title("\n".join(lines), loc="left", fontsize=FONT_PT, color=colours.text)
    axes.set_xlabel(shortened(x_label, across), fontsize=FONT_PT, color=colours.dim)
    axes.set_ylabel(shortened(y_label, up), fontsize=FONT_PT, color=colours.dim)


def points_in(axes: Axes, pixels: float) -> float:
    """Return a length on the figure in points."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return pixels * 72.0 / figure.dpi


def letters(axes: Axes, pixels: float) -> int:
    """Return the number of letters of a tick label that fit into a length."""
    return int(points_in(axes, pixels) / (LETTER * TICK_PT))


def width_of(text: str) -> float:
    """Return the width of a tick label in points, of its widest line."""
    font = FontProperties(size=TICK_PT)
    lines = text.splitlines()
    widths = [text_to_path.get_text_width_height_descent(line, font, ismath=False)[0] for line in lines]
    return float(max(widths, default=0.0))


def legend_above(axes: Axes, colours: Colours) -> None:
    """Put the legend above the frame, in a row if there is room for eight letters of each label."""
    handles, labels = axes.get_legend_handles_labels()
    room = letters(axes, axes.bbox.width)

    def row(most: int) -> int:
        return sum(min(len(label), most) + _KEY for label in labels)

    most = next((most for most in range(_LABEL, 8, -1) if row(most) <= room), 8)
    axes.legend(
        handles, [shortened(label, most) for label in labels], loc="lower left", bbox_to_anchor=(0.0, 1.0),
        ncols=len(labels) if row(most) <= room else max(room // (most + _KEY), 1), fontsize=TICK_PT,
        frameon=False, labelcolor=colours.text, borderpad=0.2, borderaxespad=0.0, handletextpad=0.2,
        columnspacing=1.0, handlelength=1.4,
    )  # fmt: skip
