"""The report's figures, by file name."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from homolog.arrays import FloatArray
from homolog.comparison.answer import Answer
from homolog.comparison.findings import step_of
from homolog.comparison.formula import FormulaAnswer
from homolog.comparison.places import Directions, SurfaceCarrier
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.results import Result, read_energies
from homolog.progress import Tick
from homolog.statistics.anova import Allometry
from homolog.statistics.cautions import LEVEL
from homolog.statistics.comparison import Comparison
from homolog.statistics.evaluation import compactness, generalization, specificity
from homolog.statistics.parallel import ParallelAnalysis, parallel_analysis
from homolog.statistics.shape_model import ShapeModel
from homolog_app.pictures import (
    LIGHT,
    ModeSurfaces,
    Theme,
    common_limit,
    draw_differences,
    draw_modes,
    outward_displacement,
    three_quarter_view,
)
from homolog_app.plots import (
    draw_allometry,
    draw_discriminant,
    draw_energies,
    draw_quality,
    draw_scores,
    draw_scree,
    group_order,
    new_figure,
)
from homolog_app.rendering.camera import VIEWS, Clip, View
from homolog_app.rendering.colours import page_colours
from homolog_app.report.texts import caption

__all__ = [
    "ReportFigure",
    "allometry_figure",
    "discriminant_figure",
    "energies_figure",
    "map_figure",
    "map_limits",
    "model_figures",
    "quality_figure",
    "quality_rows",
    "scores_figure",
    "scree_figure",
    "study_figures",
]

_SPECIFICITY_AT = (1, 2, 3, 5, 8, 13, 21)
_DRAWS = 200
_VIEWS = ("anterior", "posterior", "superior", "inferior")
_HOLLOW_VIEWS = ("anterior", "posterior", "left", "right")
_SMALL = (2.3, 1.7)
"""Size of a figure, three of which fit next to each other [inches]."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportFigure:
    """A figure with its file name and caption, and whether others may be placed next to it."""

    name: str
    figure: Figure
    caption: str
    small: bool = False


def model_figures(
    project: ProjectFolder,
    result: Result,
    model: ShapeModel,
    carrier: SurfaceCarrier,
    tick: Tick,
    clip: Clip | None = None,
) -> Iterator[ReportFigure]:
    """Yield the figures of the shape model, optionally cut open by a plane."""
    parallel, record = parallel_analysis(result.world), project.read().result
    share = float(model.explained_variance_ratio_[: parallel.n_retained].sum())
    text = caption("scree", parallel=parallel, share=share)
    yield ReportFigure("scree", scree_figure(parallel), text, small=True)
    if len(model.explained_variance_) > 1:
        yield ReportFigure(
            "scores",
            scores_figure(model, [group or "" for group in result.groups]),
            caption("scores", has_groups=any(result.groups)),
            small=True,
        )
    tick(0.2, "pictures of the modes")
    shown = min(max(parallel.n_retained, 1), 3, len(model.explained_variance_))
    shares = model.explained_variance_ratio_[:shown]
    moves = carrier.moved(model.components_[:shown] * model.standard_deviations_[:shown, None, None])
    view = three_quarter_view(carrier.mesh.vertices, (moves**2).sum(axis=(0, 2)))
    yield ReportFigure(
        "modes",
        draw_modes(
            {"": ModeSurfaces(carrier.mesh, moves, shares)},
            modes=range(shown),
            view=view,
            clip=clip,
            width=270,
        ),
        caption(
            "modes",
            side=carrier.directions.way(np.array(view.toward)),
            mirrored=record.mirrored_text if record is not None else "",
            cut=_cut_text(clip),
        ),
    )


def map_limits(studies: Sequence[Answer], carrier: SurfaceCarrier) -> list[float]:
    """Return the end of the colour scale of each study's maps [mm], common to maps of the same quantity."""
    outward: dict[tuple[str, ...], list[FloatArray]] = {}
    for study in studies:
        for item in study.comparisons:
            if len(item.pointwise.effect) == 1:
                moves = step_of(study, item.title)[0] * carrier.moved(item.pointwise.effect[0])
                outward.setdefault(_quantity(study), []).append(
                    outward_displacement(carrier.mean_of(item), moves)
                )
    return [common_limit(outward.get(_quantity(study), [])) for study in studies]


def _quantity(study: Answer) -> tuple[str, ...]:
    """Return the quantity of maps: differences of form or of shape, or changes along one variable."""
    request = study.question
    return request.alignment.value, {"regression": request.column, "formula": request.formula}.get(
        request.kind, ""
    )


def study_figures(
    study: Answer, carrier: SurfaceCarrier, limit: float, tick: Tick, clip: Clip | None = None
) -> Iterator[ReportFigure]:
    """Yield the figures of a study: a map of each comparison of two, cut open or not, then its subjects.

    Of a formula, terms without a significant particle have no map.

    Colours of the maps end at the limit [mm].
    """
    stems = file_stems([f"{study.question.name}_{comparison.title}" for comparison in study.comparisons])
    for index, (item, stem) in enumerate(zip(study.comparisons, stems, strict=True)):
        tick(index / len(stems), f"maps of {item.title}")
        if len(item.pointwise.effect) > 1 or (
            study.question.kind == "formula" and not (item.p_fwe <= LEVEL).any()
        ):
            continue
        step, unit = step_of(study, item.title)
        text = caption(
            "map",
            title=item.title,
            kind=study.question.kind,
            step=unit,
            limit=limit,
            level=LEVEL,
            cut=_cut_text(clip),
        )
        figure = map_figure(item, carrier, limit=limit, clip=clip, step=step)
        yield ReportFigure(f"{stem}_map", figure, text)
    if isinstance(study, FormulaAnswer):
        for number, along in study.allometry:
            yield ReportFigure(
                file_stems([f"{study.question.name}_{number}_allometry"])[0],
                allometry_figure(study, number, along),
                caption("allometry", number=number),
                small=True,
            )
    for item, stem in zip(study.comparisons, stems, strict=True):
        if item.discriminant is not None:
            yield ReportFigure(
                f"{stem}_discriminant",
                discriminant_figure(study, item, size=_SMALL),
                caption("discriminant", title=item.title),
                small=True,
            )


def scores_figure(
    model: ShapeModel,
    labels: Sequence[str],
    modes: tuple[int, int] = (0, 1),
    theme: Theme = LIGHT,
) -> Figure:
    """Draw the subjects in the plane of two modes, each with its label's colour and marker."""
    colours = page_colours(theme)
    shares = 100.0 * model.explained_variance_ratio_
    names = [f"mode {mode + 1} ({shares[mode]:.0f} %), score (mm)" for mode in modes]
    figure = new_figure(4.2, 3.6, colours)
    draw_scores(figure.subplots(), model.scores_[:, list(modes)], labels, (names[0], names[1]), colours)
    return figure


def quality_figure(result: Result, model: ShapeModel, theme: Theme = LIGHT) -> Figure:
    """Draw compactness, generalization and specificity of a model of three or more subjects."""
    rows = quality_rows(result, model)
    at = [k for k, _, _, drawn in rows if drawn is not None]
    measured = np.array([drawn for _, _, _, drawn in rows if drawn is not None])
    left_out = np.array([item for _, _, item, _ in rows if item is not None])
    colours = page_colours(theme)
    figure = new_figure(7.2, 2.5, colours)
    draw_quality(figure.subplots(1, 3), compactness(model), left_out, (at, measured), colours)
    return figure


def quality_rows(result: Result, model: ShapeModel) -> list[tuple[int, float, float | None, float | None]]:
    """Return number of modes, compactness (0 to 1), generalization and specificity [mm] of a model.

    Specificity is computed for some numbers of modes only. The result is empty with fewer than three
    subjects.
    """
    if len(result.world) < 3:
        return []
    at = [item for item in _SPECIFICITY_AT if item <= len(model.explained_variance_)]
    drawn = dict(zip(at, specificity(model, result.world, at, draws=_DRAWS).tolist(), strict=True))
    left_out = dict(enumerate(generalization(result.world).tolist(), start=1))
    return [
        (k, share, left_out.get(k), drawn.get(k))
        for k, share in enumerate(compactness(model).tolist(), start=1)
    ]


def energies_figure(project: ProjectFolder, theme: Theme = LIGHT) -> Figure:
    """Draw the terms of the objective during the run."""
    figure = new_figure(7.2, 2.2, colours := page_colours(theme))
    draw_energies(figure.subplots(1, 3), read_energies(project), colours)
    return figure


def discriminant_figure(
    study: Answer, comparison: Comparison, theme: Theme = LIGHT, size: tuple[float, float] = (4.6, 1.9)
) -> Figure:
    """Draw the subjects of a comparison of two groups along its discriminant; the size is in inches."""
    assert comparison.discriminant is not None
    first, second = comparison.counts
    members = np.array([study.labels[subject] for subject in comparison.subjects]) == second
    places, colours = comparison.discriminant.cross_validated, page_colours(theme)
    figure = new_figure(*size, colours)
    order = group_order(study.labels)
    draw_discriminant(figure.subplots(), places, members, (first, second), order, colours)
    return figure


def allometry_figure(
    study: FormulaAnswer,
    number: str,
    along: Allometry,
    theme: Theme = LIGHT,
    size: tuple[float, float] = (3.6, 1.7),
) -> Figure:
    """Draw regression scores and predicted lines along a number of a formula; the size is in inches."""
    labels = [study.labels[row] for row in study.rows.tolist()]
    figure = new_figure(*size, colours := page_colours(theme))
    draw_allometry(figure.subplots(1, 2), study.design.numbers[number], along, labels, number, colours)
    return figure


def map_figure(
    comparison: Comparison,
    carrier: SurfaceCarrier,
    theme: Theme = LIGHT,
    limit: float | None = None,
    clip: Clip | None = None,
    step: float = 1.0,
) -> Figure:
    """Draw the effect of a comparison of two and its significance, for hollow shapes also on the inside.

    Colours end at the limit [mm], by default a suitable round value.
    """
    mesh, effect = carrier.mean_of(comparison), step * carrier.moved(comparison.pointwise.effect[0])
    significant = carrier.significant(comparison, LEVEL)
    rows, pale = {"": (mesh, effect)}, {"": ~significant}
    if clip is not None or not carrier.is_hollow:
        views = [_view(carrier.directions, name) for name in _VIEWS]
        return draw_differences(rows, pale=pale, views=views, clip=clip, limit=limit, theme=theme, width=300)
    views = [_view(carrier.directions, name) for name in _HOLLOW_VIEWS]
    inside = [
        replace(VIEWS[name], name=f"{carrier.directions.way(-np.array(VIEWS[name].toward))} wall")
        for name in _HOLLOW_VIEWS
    ]
    return draw_differences(rows, pale=pale, views=views, inside=inside, limit=limit, theme=theme, width=150)


def _view(directions: Directions, name: str) -> View:
    """Return an anatomical view, named by the side of the viewer."""
    view = VIEWS[name]
    if directions.are_the_patients:
        return view
    return replace(view, name=f"from {directions.way(np.array(view.toward))}")


def _cut_text(clip: Clip | None) -> str:
    return "" if clip is None else " " + caption("cut", clip=clip)


def scree_figure(parallel: ParallelAnalysis, theme: Theme = LIGHT) -> Figure:
    """Draw the eigenvalues with the threshold of parallel analysis."""
    figure = new_figure(4.6, 3.0, colours := page_colours(theme))
    eigenvalues, threshold = parallel.eigenvalues, parallel.threshold
    draw_scree(figure.subplots(), eigenvalues, threshold, parallel.n_retained, parallel.percentile, colours)
    return figure
