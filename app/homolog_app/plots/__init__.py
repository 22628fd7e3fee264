"""Plots on matplotlib axes: the same in the window, reports and exports.

A function named `draw_` takes axes, data and the scheme's colours. It needs no display.
"""

from homolog_app.plots.groups import (
    ALLOMETRY,
    PercentileRow,
    discriminant_points,
    draw_allometry,
    draw_along,
    draw_boxes,
    draw_discriminant,
    draw_measure,
    draw_pair,
    draw_percentiles,
    draw_slope,
    draw_value,
    percentile_rows,
    pose_percentile_rows,
)
from homolog_app.plots.model import (
    DPI,
    draw_energies,
    draw_place,
    draw_quality,
    draw_scores,
    draw_scree,
    group_order,
    group_style,
    new_figure,
)
from homolog_app.plots.names import draw_all_names, draw_subjects

__all__ = [
    "ALLOMETRY",
    "DPI",
    "PercentileRow",
    "discriminant_points",
    "draw_all_names",
    "draw_allometry",
    "draw_along",
    "draw_boxes",
    "draw_discriminant",
    "draw_energies",
    "draw_measure",
    "draw_pair",
    "draw_percentiles",
    "draw_place",
    "draw_quality",
    "draw_scores",
    "draw_scree",
    "draw_slope",
    "draw_subjects",
    "draw_value",
    "group_order",
    "group_style",
    "new_figure",
    "percentile_rows",
    "pose_percentile_rows",
]
