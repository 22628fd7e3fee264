"""Plots of a result, one at a time: the report's figures."""

import numpy as np
from matplotlib.figure import Figure

from homolog.analysis.parallel import parallel_analysis
from homolog.analysis.shape_model import ShapeModel
from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog.files.results import Result, read_result
from homolog.progress import Tick, no_tick
from homolog_app.exports.motion import mode_motions
from homolog_app.exports.settings import Background, Plot, PlotSettings
from homolog_app.exports.tables import compare
from homolog_app.pictures import DARK, LIGHT, ModeSurfaces, Theme, draw_modes
from homolog_app.report.figures import (
    discriminant_figure,
    energies_figure,
    map_figure,
    quality_figure,
    scores_figure,
    scree_figure,
)
from homolog_app.report.request import column_of
from homolog_app.report.surface_maps import SurfaceCarrier

__all__ = ["draw_plot"]


def draw_plot(
    project: ProjectFolder,
    settings: PlotSettings,
    groups: tuple[str, str, str] | None = None,
    colour_by: str = "group",
    tick: Tick = no_tick,
) -> Figure:
    """Draw one plot of a project's result.

    Parameters
    ----------
    project : ProjectFolder
        With a result.
    settings : PlotSettings
        Which plot.
    groups : (str, str, str), optional
        Column and two groups, for plots that compare them.
    colour_by : str
        Column that gives colours and markers of scores.
    tick : Tick
        Progress and cancelling.

    Raises
    ------
    InputError
        If there is no result, no such column, group or mode, or a comparison lacks its groups.
    """
    theme = DARK if settings.background is Background.DARK else LIGHT
    if settings.kind.needs_groups != (groups is not None):
        raise InputError(
            f"the plot {settings.kind} compares groups; give a column and two of its groups"
            if groups is None
            else f"the plot {settings.kind} compares no groups; give none"
        )
    result = read_result(project)
    if groups is not None:
        return _comparison(result, settings, groups, theme, tick)
    if settings.kind is Plot.ENERGIES:
        return energies_figure(project, theme)
    tick(0.2, f"plot of {settings.kind}")
    if settings.kind is Plot.SCREE:
        return scree_figure(parallel_analysis(result.world), theme)
    if settings.kind is Plot.MODES:
        return _modes(result, settings.modes, theme)
    model = ShapeModel.fit(result.world, names=result.names)
    if settings.kind is Plot.SCORES:
        _check_modes(settings, len(model.explained_variance))
        axes = settings.horizontal - 1, settings.vertical - 1
        return scores_figure(model, column_of(result, colour_by), axes, theme)
    if len(result.names) < 3:
        raise InputError("quality is measured by leave-one-out and needs three or more subjects")
    return quality_figure(result, model, theme)


def _check_modes(settings: PlotSettings, count: int) -> None:
    for mode in (settings.horizontal, settings.vertical):
        if mode > count:
            raise InputError(f"mode {mode}: the result has {count} modes; choose one from 1 to {count}")


def _modes(result: Result, most: int, theme: Theme) -> Figure:
    model = ShapeModel.fit(result.world, names=result.names)
    shown = range(min(most, len(model.explained_variance)))
    moves = [
        mode_motion.displacement for mode_motion in mode_motions(result, [mode + 1 for mode in shown], 1.0)
    ]
    surfaces = ModeSurfaces(result.mean_surface, np.stack(moves), model.explained_variance_ratio)
    return draw_modes({"": surfaces}, modes=shown, theme=theme)


def _comparison(
    result: Result, settings: PlotSettings, groups: tuple[str, str, str], theme: Theme, tick: Tick
) -> Figure:
    study = compare(result, groups, settings.permutations, settings.seed, tick)
    if settings.kind is Plot.DIFFERENCE:
        return map_figure(study.overall, SurfaceCarrier.of(result), theme)
    if study.overall.discriminant is None:
        raise InputError("no discriminant: parallel analysis retains no mode")
    return discriminant_figure(study, study.overall, theme)
