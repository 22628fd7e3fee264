"""Plots of numbers: eigenvalues, scores, energies, model quality; vector graphics when saved as SVG or PDF.

Every function takes arrays and returns a `matplotlib.figure.Figure`, without a display.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from homolog.arrays import FloatArray
from homolog_app.fonts import legible
from homolog_app.rendering.colours import LIGHT, Theme

__all__ = ["plot_discriminant", "plot_energies", "plot_quality", "plot_scores", "plot_scree"]

# Told apart by people with any colour vision (Okabe and Ito 2008).
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8a8a8a")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_FONT_PT = 9.0
_MOST_BARS = 20


def plot_scree(
    eigenvalues: FloatArray,
    threshold: FloatArray,
    n_retained: int,
    percentile: float,
    *,
    theme: Theme = LIGHT,
) -> Figure:
    """Plot the eigenvalues with the line that chance reaches (parallel analysis).

    Parameters
    ----------
    eigenvalues, threshold : (K,) array
        Eigenvalues of the data, and their percentile under the null [mm²].
    n_retained : int
        Number of modes above chance.
    percentile : float
        Of the null, in percent.
    theme : Theme
        Background and text.
    """
    figure, axes = _page(4.6, 3.0, theme)
    shown = min(len(eigenvalues), _MOST_BARS)
    numbers = np.arange(1, shown + 1)
    share = 100.0 / eigenvalues.sum()
    colours = [_COLOURS[0] if number <= n_retained else _COLOURS[6] for number in numbers]
    axes.bar(numbers, eigenvalues[:shown] * share, color=colours, width=0.7)
    axes.plot(
        numbers,
        threshold[:shown] * share,
        color=_COLOURS[1],
        marker=".",
        linewidth=1.2,
        label=f"chance, {percentile:g}th percentile",
    )
    axes.set_xlabel("mode")
    axes.set_ylabel("share of variance (%)")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    noun = "mode" if n_retained == 1 else "modes"
    axes.set_title(f"{n_retained} {noun} above chance", fontsize=_FONT_PT + 1.0, color=theme.text)
    _legend(axes, theme)
    return figure


def plot_scores(
    scores: FloatArray,
    explained: FloatArray,
    groups: Sequence[str],
    *,
    modes: tuple[int, int] = (0, 1),
    theme: Theme = LIGHT,
) -> Figure:
    """Plot the subjects in the plane of two modes.

    Parameters
    ----------
    scores : (M, K) array
        Coordinates in the modes [mm].
    explained : (K,) array
        Share of the total variance of each mode.
    groups : sequence of str
        Group of each subject.
    modes : (int, int)
        Modes along the two axes, counted from 0.
    theme : Theme
        Background and text.
    """
    figure, axes = _page(4.2, 3.6, theme)
    for index, group in enumerate(sorted(set(groups))):  # as in the window
        members = np.array([item == group for item in groups])
        colour, marker = _COLOURS[(index + index // 7) % 7], _MARKERS[index % 7]  # no two look alike
        x, y = scores[members][:, list(modes)].T
        label = f"{group or 'no group'} ({len(x)})"
        axes.scatter(x, y, s=26, linewidths=0.0, alpha=0.85, color=colour, marker=marker, label=label)
        if not any(groups):
            continue  # without groups there is nothing to tell apart, and the mean is the origin
        axes.scatter(
            x.mean(), y.mean(), s=110, marker=marker, facecolors="none", edgecolors=colour, linewidths=1.6
        )
    labels = [f"mode {mode + 1} ({100 * explained[mode]:.0f} %), score (mm)" for mode in modes]
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.axhline(0.0, color=theme.text, linewidth=0.4, zorder=0)
    axes.axvline(0.0, color=theme.text, linewidth=0.4, zorder=0)
    if any(groups):
        _legend(axes, theme)
    return figure


def plot_discriminant(
    scores: FloatArray, second: FloatArray, names: tuple[str, str], *, theme: Theme = LIGHT
) -> Figure:
    """Plot the subjects of two groups along their discriminant, with each group's mean.

    Parameters
    ----------
    scores : (M,) array
        Place along the discriminant [mm].
    second : (M,) bool array
        Members of the second group.
    names : (str, str)
        The groups.
    theme : Theme
        Background and text.
    """
    figure, axes = _page(4.6, 1.9, theme)
    for row in (0, 1):
        own = np.sort(scores[second == bool(row)])
        height = row + 0.3 * np.sin(2.4 * np.arange(len(own)))
        axes.scatter(own, height, s=26, linewidths=0.0, alpha=0.85, color=_COLOURS[row], marker=_MARKERS[row])
        axes.plot([own.mean()] * 2, [row - 0.4, row + 0.4], color=_COLOURS[row], linewidth=1.6)
    axes.axvline(0.0, color=theme.text, linewidth=0.6, linestyle=(0, (4, 3)))
    axes.set_yticks([0, 1], [legible(name) for name in names])  # a tick's words are set anew when drawn
    axes.set_ylim(-0.6, 1.6)
    axes.set_xlabel("place along the discriminant (mm)")
    return figure


def plot_energies(iterations: FloatArray, energies: dict[str, FloatArray], *, theme: Theme = LIGHT) -> Figure:
    """Plot the parts of the objective along a run, each on its own scale.

    Parameters
    ----------
    iterations : (T,) array
        Iteration of each value.
    energies : dict of str to (T,) array
        Parts of the objective by name.
    theme : Theme
        Background and text.
    """
    figure = _figure(4.6, 1.3 * len(energies) + 0.5, theme)
    rows = figure.subplots(len(energies), 1, sharex=True, squeeze=False)[:, 0]
    for index, (axes, (name, values)) in enumerate(zip(rows, energies.items(), strict=True)):
        _dress(axes, theme)
        axes.plot(iterations, values, color=_COLOURS[index % 7], linewidth=1.2)
        axes.set_ylabel(name)
    rows[-1].set_xlabel("iteration")
    return figure


def plot_quality(
    compactness: FloatArray,
    generalization: FloatArray,
    specificity: tuple[Sequence[int], FloatArray],
    *,
    theme: Theme = LIGHT,
) -> Figure:
    """Plot compactness, generalization and specificity against the number of modes.

    Parameters
    ----------
    compactness : (K,) array
        Share of the variance in the first k modes.
    generalization : (M - 2,) array
        Distance to left-out shapes [mm].
    specificity : (sequence of int, array)
        Numbers of modes, and the distance of drawn shapes to the nearest real one [mm].
    theme : Theme
        Background and text.
    """
    figure = _figure(7.2, 2.5, theme)
    left, middle, right = figure.subplots(1, 3)
    curves = (
        (left, np.arange(1, len(compactness) + 1), 100.0 * compactness, "compactness (%)"),
        (middle, np.arange(1, len(generalization) + 1), generalization, "generalization (mm)"),
        (right, np.asarray(specificity[0]), specificity[1], "specificity (mm)"),
    )
    for index, (axes, numbers, values, name) in enumerate(curves):
        _dress(axes, theme)
        axes.plot(numbers, values, color=_COLOURS[index], marker=".", linewidth=1.2)
        axes.set_ylim(0.0, 104.0 if index == 0 else 1.08 * float(np.max(values)))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("modes")
        axes.set_ylabel(name)
    return figure


def _figure(width: float, height: float, theme: Theme) -> Figure:
    figure = Figure(figsize=(width, height), dpi=150, facecolor=theme.background, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _page(width: float, height: float, theme: Theme) -> tuple[Figure, Axes]:
    figure = _figure(width, height, theme)
    axes = figure.subplots()
    _dress(axes, theme)
    return figure, axes


def _dress(axes: Axes, theme: Theme) -> None:
    axes.set_facecolor(theme.background)
    axes.tick_params(labelsize=_FONT_PT - 1.0, colors=theme.text)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_fontsize(_FONT_PT)
        label.set_color(theme.text)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(theme.text)


def _legend(axes: Axes, theme: Theme) -> None:
    axes.legend(fontsize=_FONT_PT - 1.0, frameon=False, labelcolor=theme.text)
