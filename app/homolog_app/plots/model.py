"""Style of plots (fonts, frames, colours and markers of groups); plots of a shape model and of its run."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.textpath import text_to_path
from matplotlib.ticker import MaxNLocator

from homolog.arrays import FloatArray
from homolog.statistics.design import names_reference
from homolog_app.rendering.colours import Colours
from homolog_app.rendering.text import ENERGIES, shortened

__all__ = [
    "DPI",
    "FONT_PT",
    "LETTER",
    "LINE_PT",
    "TICK_PT",
    "draw_energies",
    "draw_place",
    "draw_quality",
    "draw_scores",
    "draw_scree",
    "dress",
    "fitting",
    "group_order",
    "group_style",
    "legend_above",
    "letters",
    "new_figure",
    "points_in",
    "width_of",
]

DPI = 96
"""Pixels per inch on the screen."""
FONT_PT, TICK_PT, LINE_PT = 9.0, 8.0, 1.2
LETTER = 0.55
"""Mean width of a letter relative to the font size."""

_LABEL, _KEY = 30, 4  # letters of a label in a legend, and width of its marker in letters
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_MOST_BARS = 16
_QUANTILE = 5.991464547107979  # 95 % of the chi-squared distribution with two degrees of freedom
_LEAST = 3  # least number of subjects for an ellipse
_FIRST = 20  # number of first iterations, whose jumps may leave the frame
_RISES = "Energies rise while the regularization decreases; the run has converged where they are flat."


def new_figure(width: float, height: float, colours: Colours) -> Figure:
    """Return an empty page of a report, in inches."""
    figure = Figure(figsize=(width, height), dpi=150, facecolor=colours.surface, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def group_order(groups: Sequence[str]) -> list[str]:
    """Return the groups in the order of their colours: controls, others by name, no group last."""
    return sorted(set(groups), key=lambda name: (not name, not names_reference(name), name))


def group_style(index: int, colours: Colours) -> tuple[str, str]:
    """Return the colour and the marker of a group by its place in `group_order`; all combinations differ."""
    count = len(_MARKERS)
    return colours.groups[(index + index // count) % count], _MARKERS[index % count]


def dress(axes: Axes, colours: Colours, title: str = "", x_label: str = "", y_label: str = "") -> None:
    """Apply the scheme's colours to axes, and set title and labels, shortened to the available width."""
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


def fitting(text: str, room: float) -> str:
    """Return a tick label, shortened to a width in points."""
    most = len(text)
    while most > 1 and width_of(shortened(text, most)) > room:
        most -= 1
    return shortened(text, most)


def legend_above(axes: Axes, colours: Colours) -> None:
    """Put the legend above the frame, in a row if eight letters of each label fit."""
    handles, labels = axes.get_legend_handles_labels()
    room = letters(axes, axes.bbox.width)

    def row(most: int) -> int:
        return sum(min(len(label), most) + _KEY for label in labels)

    most = next((most for most in range(_LABEL, 8, -1) if row(most) <= room), 8)
    axes.legend(
        handles,
        [shortened(label, most) for label in labels],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=len(labels) if row(most) <= room else max(room // (most + _KEY), 1),
        fontsize=TICK_PT,
        frameon=False,
        labelcolor=colours.text,
        borderpad=0.2,
        borderaxespad=0.0,
        handletextpad=0.2,
        columnspacing=1.0,
        handlelength=1.4,
    )


def draw_scree(
    axes: Axes,
    eigenvalues: FloatArray,
    threshold: FloatArray,
    n_retained: int,
    percentile: float,
    colours: Colours,
) -> None:
    """Draw the eigenvalues, filled if retained, with the threshold of parallel analysis.

    Parameters
    ----------
    axes : Axes
    eigenvalues, threshold : (K,) array
        Eigenvalues of the data, and their percentile under the null [mm²].
    n_retained : int
        Number of retained modes.
    percentile : float
        Percentile of the null distribution.
    colours : Colours
    """
    noun = "mode" if n_retained == 1 else "modes"
    dress(axes, colours, f"{n_retained} {noun} retained", "mode", "share of variance (%)")
    shown = min(len(eigenvalues), _MOST_BARS)
    share = 100.0 / eigenvalues.sum()
    bars = axes.bar(np.arange(1, shown + 1), eigenvalues[:shown] * share, width=0.64)
    for index, bar in enumerate(bars):
        bar.set_color(colours.groups[0] if index < n_retained else colours.dim)
        if index >= n_retained:
            bar.set(facecolor="none", hatch="////", linewidth=0.6)
    chance = f"chance ({percentile:g}th percentile)"
    if len(chance) + 6 > letters(axes, axes.bbox.width):
        chance = "chance"
    (line,) = axes.plot(np.arange(1, shown + 1), threshold[:shown] * share, linestyle="--", label=chance)
    line.set(color=colours.groups[1], linewidth=1.5)
    axes.set(xlim=(0.4, shown + 0.6), ylim=(0.0, None))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(fontsize=TICK_PT, frameon=False, labelcolor=colours.text, loc="upper right")


def draw_scores(
    axes: Axes,
    points: FloatArray,
    groups: Sequence[str],
    labels: tuple[str, str],
    colours: Colours,
    *,
    ellipses: bool = False,
) -> None:
    """Draw subjects in the plane of two modes, and each group's mean as a large open marker.

    Parameters
    ----------
    axes : Axes
    points : (M, 2) array
        Scores.
    groups : sequence of str
        Group of each subject; empty without one.
    labels : (str, str)
        Axis labels with units.
    colours : Colours
    ellipses : bool
        Whether to draw the 95 % region of a normal distribution with each group's mean and covariance.
    """
    is_grouped = any(groups)
    dress(axes, colours, "" if is_grouped else "Subjects", *labels)
    for line in (axes.axhline, axes.axvline):
        line(0.0, color=colours.line, linewidth=0.8, zorder=0)
    for index, group in enumerate(group_order(groups)):
        own = points[np.array([item == group for item in groups], dtype=bool)]
        colour, marker = group_style(index, colours)
        label = f"{group or 'no group'} ({len(own)})"
        axes.scatter(
            own[:, 0], own[:, 1], s=26, linewidths=0.0, alpha=0.85, color=colour, marker=marker, label=label
        )
        if is_grouped:  # without groups the mean is the origin
            at = own.mean(axis=0)
            axes.plot(*at, marker=marker, markersize=10, mfc="none", mec=colour, mew=1.6, linestyle="none")
        if ellipses and len(own) >= _LEAST:
            values, vectors = np.linalg.eigh(np.cov(own.T))
            across, along = 2.0 * np.sqrt(_QUANTILE * values.clip(0.0))
            angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
            axes.add_patch(
                Ellipse(own.mean(axis=0), across, along, angle=angle, fill=False, ec=colour, lw=LINE_PT)
            )
    if is_grouped:
        legend_above(axes, colours)


def draw_place(axes: Axes, x: float, y: float | None, colours: Colours) -> Line2D:
    """Draw and return the position of the shown shape: a cross, or a line if the height has no meaning.

    The axes keep their limits.
    """
    if y is None:
        line = Line2D([x, x], [0.0, 1.0], transform=axes.get_xaxis_transform())
    else:
        line = Line2D([x], [y], marker="+", markersize=14, mew=1.8)
    line.set(color=colours.accent, linewidth=1.5, zorder=6)
    axes.add_artist(line)
    return line


def draw_energies(places: Sequence[Axes], rows: FloatArray, colours: Colours) -> None:
    """Draw the three terms of the objective during a run, each on its own axes.

    Jumps of the first iterations may leave the frame. A term that is not part of the method is labelled as
    such.

    Parameters
    ----------
    places : sequence of Axes
        Three axes.
    rows : (T, 4) array
        Iteration, and the entropies of sampling, ensemble and normals.
    colours : Colours
    """
    figure = places[0].get_figure(root=True)
    assert figure is not None
    note = shortened(_RISES, letters(places[0], figure.bbox.width))
    figure.supxlabel(note, x=0.01, ha="left", fontsize=TICK_PT, color=colours.dim)
    for axes, (name, meaning), values in zip(places, ENERGIES.items(), rows.T[1:], strict=True):
        label = "energy" if axes is places[0] else ""
        dress(axes, colours, f"{name}\n{meaning}", "iteration", label)
        known = values[np.isfinite(values)]
        axes.set_xlim(float(rows[0, 0]), float(rows[-1, 0]))
        if not _counts(values):
            axes.set(xticks=(), yticks=())
            axes.text(
                0.5,
                0.5,
                "not part of this method",
                transform=axes.transAxes,
                ha="center",
                fontsize=FONT_PT,
                color=colours.dim,
            )
            continue
        later = known[len(known) // _FIRST :]
        low, high = float(later.min()), float(later.max())
        room = 0.05 * (high - low) or abs(high) * 0.05 or 1.0
        axes.set_ylim(low - room, high + room)
        axes.ticklabel_format(useOffset=False)
        curve = Line2D(rows[:, 0], values, color=colours.groups[0], linewidth=LINE_PT)
        axes.add_artist(curve)
        curve.set_clip_path(axes.patch)


def _counts(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.any(known))


def draw_quality(
    places: Sequence[Axes],
    compactness: FloatArray,
    generalization: FloatArray,
    specificity: tuple[Sequence[int], FloatArray],
    colours: Colours,
) -> None:
    """Draw compactness, generalization and specificity against the number of modes.

    Parameters
    ----------
    places : sequence of Axes
        Three axes.
    compactness : (K,) array
        Share of the variance in the first k modes.
    generalization : (M - 2,) array
        Distance of held-out shapes from their best fit [mm].
    specificity : (sequence of int, array)
        Numbers of modes, and the distance of drawn shapes to the nearest real one [mm].
    colours : Colours
    """
    curves = (
        (np.arange(1, len(compactness) + 1), 100.0 * compactness, "compactness (%)"),
        (np.arange(1, len(generalization) + 1), generalization, "generalization (mm)"),
        (np.asarray(specificity[0]), specificity[1], "specificity (mm)"),
    )
    for index, (axes, (numbers, values, name)) in enumerate(zip(places, curves, strict=True)):
        dress(axes, colours, x_label="modes", y_label=name)
        axes.plot(numbers, values, color=colours.groups[index], marker=".", linewidth=LINE_PT)
        axes.set_ylim(0.0, 104.0 if index == 0 else 1.08 * float(np.max(values)))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
