"""Plots of groups, numbers and measures, and of a patient among controls."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from homolog.arrays import BoolArray, FloatArray
from homolog_app.plots.model import (
    FONT_PT,
    LINE_PT,
    TICK_PT,
    draw_scores,
    dress,
    group_style,
    letters,
    points_in,
    width_of,
)
from homolog_app.rendering.colours import Colours
from homolog_app.rendering.text import legible, short, shortened

if TYPE_CHECKING:
    from homolog.patient import JointComparison, JointReference, PatientComparison, Percentile, Reference
    from homolog.statistics.anova import Allometry
    from homolog.statistics.welch import GroupMeasure

__all__ = [
    "ALLOMETRY",
    "discriminant_points",
    "draw_allometry",
    "draw_along",
    "draw_boxes",
    "draw_discriminant",
    "draw_measure",
    "draw_pair",
    "draw_percentiles",
    "draw_slope",
    "draw_value",
    "percentile_rows",
]

ALLOMETRY = ("regression score (mm)", "predicted (mm)")
"""What is drawn along a number: shapes along the mean slope, and the lines that the design predicts."""

_WAVE = 2.4  # phase step between subjects [rad], so that neighbours do not hide each other
_BOX = 0.28
_LEAST_RANGE = 0.02  # least range of an axis of measures, relative to their size
_UNUSUAL = 0.05
_GAP_PT = 3.0  # gap between the texts below boxes
_LEGIBLE = 8  # least number of letters of a group's name below its box


def discriminant_points(places: FloatArray, second: BoolArray) -> FloatArray:
    """Return the positions of subjects in `draw_discriminant` (M, 2): the first group above the second."""
    return np.column_stack([places, ~second + 0.3 * np.sin(_WAVE * np.arange(len(places)))])


def draw_discriminant(
    axes: Axes,
    places: FloatArray,
    second: BoolArray,
    names: tuple[str, str],
    order: Sequence[str],
    colours: Colours,
    *,
    along: str = "discriminant",
) -> None:
    """Draw two groups along their discriminant or difference, with a bar at each group's mean.

    Parameters
    ----------
    axes : Axes
    places : (M,) array
        Positions along the direction [mm].
    second : (M,) bool array
        Members of the second group.
    names : (str, str)
        The two groups.
    order : sequence of str
        All groups in the order of their colours.
    colours : Colours
    along : str
        Name of the direction.
    """
    dress(axes, colours, x_label=f"{along} (mm RMS)")
    points = discriminant_points(places, second)
    for height, name, own in ((1.0, names[0], ~second), (0.0, names[1], second)):
        colour, marker = group_style(list(order).index(name), colours)
        x, y = points[own].T
        axes.scatter(x, y, s=26, linewidths=0.0, alpha=0.85, color=colour, marker=marker)
        axes.plot([places[own].mean()] * 2, [height - 0.4, height + 0.4], color=colour, linewidth=1.6)
    axes.axvline(0.0, color=colours.dim, linewidth=0.6, linestyle=(0, (4, 3)))
    most = max(letters(axes, 0.25 * axes.bbox.width), 8)
    counts = int((~second).sum()), int(second.sum())
    rows = [f"{shortened(legible(name), most)} ({n})" for name, n in zip(names, counts, strict=True)]
    axes.set_yticks([1.0, 0.0], rows)  # a tick's text is set again when drawn
    reach = 1.1 * float(np.abs(places).max())
    axes.set(xlim=(-reach, reach), ylim=(-0.7, 1.7))


def draw_slope(
    axes: Axes,
    values: FloatArray,
    places: FloatArray,
    groups: Sequence[str],
    column: str,
    slope: float,
    colours: Colours,
) -> None:
    """Draw the positions of subjects along the effect of a number, with the regression line.

    Parameters
    ----------
    axes : Axes
    values, places : (M,) array
        The number, and the position along its effect [mm].
    groups : sequence of str
        Group of each subject.
    column : str
        Name of the number.
    slope : float
        Effect of one unit, RMS over the particles [mm].
    colours : Colours
    """
    draw_scores(axes, np.column_stack([values, places]), groups, (column, "along the effect (mm)"), colours)
    ends = np.array([values.min(), values.max()])
    axes.plot(ends, slope * (ends - values.mean()), color=colours.dim, linewidth=LINE_PT)
    rim, reach = 0.06 * float(np.ptp(ends)), 1.15 * float(np.abs(places).max())
    axes.set(xlim=(ends[0] - rim, ends[1] + rim), ylim=(-reach, reach))


def draw_allometry(
    panels: Sequence[Axes],
    values: FloatArray,
    along: "Allometry",
    groups: Sequence[str],
    number: str,
    colours: Colours,
) -> None:
    """Draw regression scores against a number on the first axes, and predicted lines on the second.

    Parameters
    ----------
    panels : two Axes
    values : (M,) array
        The number.
    along : Allometry
        Scores and predictions of the M subjects.
    groups : sequence of str
        Group of each subject.
    number : str
        Name of the number.
    colours : Colours
    """
    for axes, places, name in zip(panels, (along.scores, along.predicted), ALLOMETRY, strict=True):
        draw_along(axes, np.column_stack([values, places]), groups, (number, name), colours)


def draw_along(
    axes: Axes, points: FloatArray, groups: Sequence[str], labels: tuple[str, str], colours: Colours
) -> None:
    """Draw subjects (M, 2) along a number, as large as they fit."""
    draw_scores(axes, points, groups, labels, colours)
    low, high = points.min(axis=0), points.max(axis=0)
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def draw_boxes(
    axes: Axes,
    measure: "GroupMeasure",
    title: str,
    unit: str,
    colours: Colours,
    places: Sequence[int],
) -> None:
    """Draw a measure by group: quartiles, whiskers, the mean as a diamond, and every subject.

    A box extends from the first to the third quartile, with a line at the median. Whiskers extend to the last
    value within 1.5 times the box's height.

    Parameters
    ----------
    axes : Axes
    measure : GroupMeasure
        Names are omitted if only a few letters would fit. The mean is written with its standard deviation
        next to it, below it, or without, as fits.
    title, unit : str
    colours : Colours
    places : sequence of int
        Places of the groups in the order of all groups, on which their colours depend.
    """
    parts = measure.values
    dress(axes, colours, title, "", unit)
    line = {"linewidth": LINE_PT}
    drawn = axes.boxplot(
        list(parts),
        positions=range(len(parts)),
        widths=2.0 * _BOX,
        patch_artist=True,
        showfliers=False,
        boxprops=line,
        medianprops=line,
        whiskerprops=line,
        capprops=line,
        showmeans=True,
        meanprops={"marker": "D", "mfc": colours.text, "mec": colours.text, "markersize": 4, "zorder": 4},
    )
    for index, part in enumerate(parts):
        colour, _ = group_style(places[index], colours)
        drawn["boxes"][index].set(edgecolor=colour, facecolor=f"{colour}3c")
        ends = slice(2 * index, 2 * index + 2)
        for part_of_box in (drawn["medians"][index], *drawn["whiskers"][ends], *drawn["caps"][ends]):
            part_of_box.set_color(colour)
        across = np.linspace(-0.5, 0.5, len(part)) * _BOX if len(part) > 1 else np.zeros(1)
        axes.plot(index + across, part, ".", color=colour, markersize=5)
    width = 0.72 * axes.bbox.width / len(parts)  # the texts next to the frame take some
    room = points_in(axes, width) - _GAP_PT
    means = map(_mean_texts, measure.means, measure.deviations)
    below = next(
        (texts for texts in zip(*means, strict=True) if max(map(width_of, texts)) <= room), [""] * len(parts)
    )
    names = [legible(name) for name in measure.groups]
    if max(map(width_of, names), default=0.0) > room:
        count = letters(axes, width)
        names = [shortened(name, count) if count >= _LEGIBLE else "" for name in names]
    axes.set_xticks(
        range(len(parts)), ["\n".join(filter(None, each)) for each in zip(names, below, strict=True)]
    )
    axes.set_xlim(-0.6, len(parts) - 0.4)
    _widen(axes)


def _mean_texts(mean: float, deviation: float) -> tuple[str, str, str]:
    """Return a mean with its deviation next to it, below it, and without."""
    digits = int(np.clip(np.ceil(-np.log10(deviation / 2.0)), 0, 3)) if deviation > 0.0 else 1
    spread = f"±\u2009{deviation:.{digits}f}" if np.isfinite(deviation) else ""
    fixed = f"{mean:.{digits}f}"
    return f"{fixed}\u2009{spread}".strip(), f"{fixed}\n{spread}".strip(), short(mean)


def draw_pair(
    axes: Axes,
    points: FloatArray,
    groups: Sequence[str],
    labels: tuple[str, str],
    colours: Colours,
    *,
    ellipses: bool = False,
) -> None:
    """Draw two measures (M, 2) of subjects by group, with the correlation of all of them in the title."""
    draw_scores(axes, points, groups, labels, colours, ellipses=ellipses)
    low, high = points.min(axis=0), points.max(axis=0)
    rim = np.maximum(0.1 * (high - low), 1e-6)
    axes.set(xlim=(low[0] - rim[0], high[0] + rim[0]), ylim=(low[1] - rim[1], high[1] + rim[1]))
    if len(points) > 2 and (high > low).all():
        r = f"r = {np.asarray(np.corrcoef(points.T))[0, 1]:.2f}".replace("-", "−")
        axes.set_title(r, loc="right", fontsize=FONT_PT, color=colours.text)  # not over points


def _widen(axes: Axes) -> None:
    """Widen the range so that nearly equal values look equal."""
    low, high = axes.get_ylim()
    middle = (low + high) / 2.0
    if high - low < _LEAST_RANGE * abs(middle):
        axes.set_ylim(middle - _LEAST_RANGE * abs(middle) / 2.0, middle + _LEAST_RANGE * abs(middle) / 2.0)


def draw_measure(axes: Axes, x: FloatArray, y: FloatArray, title: str, label: str, colours: Colours) -> None:
    """Draw a measure (n,) along a mode (n,) in standard deviations."""
    dress(axes, colours, title, label)
    axes.plot(x, y, color=colours.groups[0], linewidth=1.5)
    axes.set_xlim(float(x[0]), float(x[-1]))
    axes.margins(y=0.08)
    _widen(axes)


def draw_value(axes: Axes, x: float, y: float, text: str, colours: Colours) -> Sequence[Artist]:
    """Draw and return a dot on a curve, and its value at the upper right corner."""
    dot = Line2D([x], [y], marker="o", markersize=7, color=colours.accent, linestyle="none", zorder=6)
    axes.add_artist(dot)
    note = axes.annotate(
        text,
        (1.0, 1.0),
        (0, 6),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right",
        fontsize=FONT_PT,
        color=colours.text,
    )
    return dot, note


PercentileRow = tuple[str, str, "Percentile", FloatArray, float | None]
"""A patient's number: name, value as text, percentile, values of the controls, and the limit."""


def percentile_rows(comparison: "PatientComparison", reference: "Reference") -> list[PercentileRow]:
    """Return a patient's numbers."""
    measures = (
        ("Distance in the modes", "{:.1f} SD", comparison.mahalanobis, reference.mahalanobis, None),
        ("Distance outside the modes", "{:.2f} mm", comparison.outside, reference.outside, None),
        ("Size, relative to expected", "{:.2f}", comparison.size, reference.size, None),
        ("Largest |z|", "{:.1f}", comparison.local, reference.maxima, reference.limit),
    )
    return [
        (name, _ranked(form.format(item.value), item), item, controls, limit)
        for name, form, item, controls, limit in measures
    ]


def pose_percentile_rows(comparison: "JointComparison", reference: "JointReference") -> list[PercentileRow]:
    """Return how a patient's structures lie to each other."""
    norms = {norm.structure: norm for norm in reference.poses}
    rows: list[PercentileRow] = []
    for pose in comparison.poses:
        name, norm = f"{pose.structure} against {pose.against}", norms[pose.structure]
        turn, shift = _ranked(f"{pose.angle:.1f}°", pose.turn), _ranked(f"{pose.distance:.1f} mm", pose.shift)
        rows.append((f"Turn of {name} (SD)", turn, pose.turn, norm.turns, None))
        rows.append((f"Shift of {name} (SD)", shift, pose.shift, norm.shifts, None))
    return rows


def _ranked(value: str, rank: "Percentile") -> str:
    return f"{value}, percentile {rank.percent:.0f} ({rank.low:.0f} to {rank.high:.0f})"


def draw_percentiles(rows: Sequence[Axes], measures: Sequence[PercentileRow], colours: Colours) -> None:
    """Draw a patient's numbers: controls as marks, their middle 90 %, the patient as a diamond.

    Parameters
    ----------
    rows : sequence of Axes
        One for each number.
    measures : sequence of PercentileRow
    colours : Colours
    """
    for axes, (name, text, item, controls, limit) in zip(rows, measures, strict=True):
        dress(axes, colours)
        low, high = np.quantile(controls, [0.05, 0.95])
        axes.axvspan(low, high, 0.2, 0.8, color=colours.selected, linewidth=0.0)
        axes.plot(controls, np.zeros(len(controls)), "|", color=colours.dim, markersize=7, mew=0.8)
        if limit is not None:
            axes.axvline(limit, color=colours.danger, linewidth=1.0, linestyle="--")
        is_unusual = item.p <= _UNUSUAL or (limit is not None and item.value > limit)
        ink = colours.danger if is_unusual else colours.accent
        axes.plot(item.value, 0.0, "D", color=ink, markersize=7, mec=colours.surface)
        axes.set(ylim=(-1.0, 1.0), yticks=())
        axes.spines["left"].set_visible(False)
        name = f"{name}\n"  # above the value
        axes.set_title(name, loc="left", fontsize=TICK_PT, color=colours.dim, pad=2.0)
        axes.set_title(text, loc="right", fontsize=TICK_PT, color=colours.text, pad=2.0)
