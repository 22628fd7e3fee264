"""Shapes of the model as contents of the views, and the pages *Modes*, *Groups* and *Measure*."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.statistics.cautions import LEVEL
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.colours import (
    ColourScale,
    common_limit,
    displacement_scale,
    viridis,
)
from homolog_app.rendering.content import Content, ViewContents
from homolog_app.rendering.scene import Arrows
from homolog_app.rendering.text import short, shortened, signed
from homolog_app.scenes.loaded_result import LoadedResult
from homolog_app.scenes.states import REACH, GroupsView, MeasureView, ModesView

if TYPE_CHECKING:
    from homolog.surfaces.comparison import SurfaceDistances
    from homolog_app.scenes.group_answers import GroupAnswer, GroupMap
    from homolog_app.scenes.model_shape import ModelShape

__all__ = [
    "MEAN",
    "MEAN_OF",
    "PALE_LABELS",
    "DisplayOptions",
    "aligned_surfaces",
    "arrow_factor",
    "deviations_of",
    "group_scene",
    "measured_scene",
    "mesh_file",
    "mode_scene",
    "model_content",
    "named_surface",
    "outward_sign",
    "region_border",
    "untitled",
]


_ARROW_SHARE = 0.09


_FACTORS = (1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class DisplayOptions:
    """Display options of displacements.

    Attributes
    ----------
    scale : ColourScale or None
        None for surfaces of one colour.
    arrows : float
        Magnification of arrows; 0 draws none.
    from_middle : bool
        Whether values are positive away from the centre of the shape, rather than out of the tissue.
    """

    scale: ColourScale | None = None
    arrows: float = 0.0
    from_middle: bool = False


def model_content(
    shape: "ModelShape",
    name: str,
    note: str,
    moved: Array,
    look: DisplayOptions,
    *,
    values: Array | None = None,
    ways: Array | None = None,
    faded: BoolArray | None = None,
    alignment: FloatArray | None = None,
) -> Content:
    """Return a shape of the model.

    Parameters
    ----------
    shape : ModelShape
    name, note : str
        The caption's lines.
    moved : (V, 3) array
        Displacement of the drawn vertices from the mean surface [mm].
    look : DisplayOptions
    values : (V,) array, optional
        Values of the colours [mm]; the outward component of `moved` if not given.
    ways : (V, 3) array, optional
        Vectors of the arrows [mm]; `moved` if not given.
    faded : (V,) bool array, optional
        Vertices in pale colours, without arrows; a line surrounds the others.
    alignment : (4, 4) array, optional
        Rigid motion of the whole shape, such as an alignment to another model.
    """
    placed = np.eye(4) if alignment is None else alignment
    vertices: Array = shape.mean.vertices.astype(np.float32) + moved
    normals = shape.normals(vertices)
    colours = None
    if look.scale is not None:
        outward = shape.outward(moved) if values is None else values
        if look.from_middle:
            outward = outward * outward_sign(shape.mean.vertices, shape.mean_normals)
        colours = look.scale.colours(outward, faint=faded)
    arrows = None
    if look.arrows:
        at = shape.arrows_at if faded is None else shape.arrows_at[~faded[shape.arrows_at]]
        arrows = _arrows(
            vertices[at], normals[at], look.arrows * (moved if ways is None else ways)[at], placed
        )
    lines = None if faded is None else _placed(region_border(vertices, shape.mean.faces, faded), placed)
    return Content(
        name,
        None,
        shape.mean.moved(vertices),
        None,
        placed,
        note,
        colours,
        normals,
        arrows,
        lines,
        structures=shape.result.structures,
    )


def outward_sign(vertices: Array, normals: Array) -> Array:
    """Return 1 for vertices (V, 3) whose outward normal points away from their centre, -1 for others."""
    away = np.einsum("vi,vi->v", vertices - vertices.mean(axis=0), normals)
    return np.where(away >= 0.0, 1.0, -1.0)


def untitled(content: Content, models: "Sequence[ModelShape]") -> Content:
    """Return a shape of a model without the project's name, unless another project is shown as well."""
    if len(models) > 1:
        return content
    mirrored = models[0].result.mirrored
    note = f"{content.note} · {mirrored} mirrored" if mirrored else content.note
    return replace(content, note=note, titled=False)


def arrow_factor(shape: "ModelShape", limit: float) -> float:
    """Return a round factor that makes arrows of a displacement (limit, mm) visible; at least 1."""
    exact = _ARROW_SHARE * float(np.ptp(shape.mean.vertices, axis=0).mean()) / limit
    if exact <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(exact))
    return float(max(factor for factor in _FACTORS if factor * power <= exact) * power)


def region_border(vertices: Array, faces: Array, inside: BoolArray) -> FloatArray:
    """Return the segments (S, 2, 3) of a region's border, through the midpoints of edges that cross it."""
    marks = inside[faces]
    count = marks.sum(axis=1)
    mixed = (count == 1) | (count == 2)
    corners, marks = faces[mixed], marks[mixed]
    odd = np.where(count[mixed] == 1, marks.argmax(axis=1), marks.argmin(axis=1))
    rows = np.arange(len(corners))
    apex = vertices[corners[rows, odd]]
    ends = [vertices[corners[rows, (odd + step) % 3]] for step in (1, 2)]
    return np.asarray(np.stack([(apex + end) / 2.0 for end in ends], axis=1))


def _arrows(points: Array, normals: Array, vectors: Array, placed: FloatArray) -> Arrows:
    """Return arrows outside the surface: inward ones end on it, the others begin on it."""
    inward = np.einsum("ai,ai->a", vectors, normals) < 0.0
    starts = points - np.where(inward[:, None], vectors, 0.0)
    return Arrows(_placed(starts, placed), vectors @ placed[:3, :3].T)


def _placed(points: Array, placed: FloatArray) -> FloatArray:
    return np.asarray(transform_points(placed, points))


MEAN, MEAN_OF = "mean", "mean of "
"""Names of the mean surface, and of a group's mean."""


def named_surface(
    name: str, shape: "ModelShape", own: Mapping[str, TriangleMesh], groups: Sequence[str | None]
) -> tuple[TriangleMesh, FloatArray | None]:
    """Return an aligned surface by its name, and its particles (N, 3) [mm] if it has any.

    Parameters
    ----------
    name : str
        A subject, ``"mean"``, ``"mean of GROUP"``, or a mesh file in aligned coordinates.
    shape : ModelShape
    own : mapping of str to TriangleMesh
        The subjects' aligned surfaces.
    groups : sequence of str or None
        Of the subjects of the model.

    Raises
    ------
    InputError
        If there is no such subject, group or file, or the file contains no surface.
    """
    if name in own:
        return own[name], shape.result.world[shape.result.names.index(name)]
    if name == MEAN:
        return shape.mean, shape.model.mean_
    of_group = [index for index, group in enumerate(groups) if f"{MEAN_OF}{group or ''}" == name]
    if of_group:
        deviations = shape.model.scores_[of_group].mean(axis=0) / shape.model.standard_deviations_
        vertices = shape.mean.vertices + shape.moved(deviations)
        return shape.mean.moved(vertices), shape.particles(deviations)
    if not Path(name).is_file():
        raise InputError(f"{name}: not found; give a subject, 'mean', 'mean of GROUP', or a mesh file")
    return mesh_file(Path(name)), None


def aligned_surfaces(loaded: LoadedResult) -> dict[str, TriangleMesh]:
    """Return the subjects' surfaces in aligned coordinates."""
    result = loaded.result
    return {
        name: loaded.surfaces[name][0].placed(alignment)
        for name, alignment in zip(result.names, result.alignments, strict=True)
    }


@lru_cache(maxsize=4)
def mesh_file(path: Path) -> TriangleMesh:
    """Return the surface of a file, with its faces outward; raises InputError if there is none."""
    from homolog.cluster import read_apart
    from homolog.io.meshes import read_mesh  # loads VTK

    mesh = read_apart(read_mesh, path, path)
    return mesh if mesh.volume >= 0.0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])


_STEPS: Mapping[int, tuple[float, ...]] = {
    4: (-1.0, 1.0),
    9: (-1.0, 0.0, 1.0),
    16: (-1.0, -0.5, 0.5, 1.0),
}
"""Positions in each row as fractions of the range, by the number of views."""
_MOST = 16
_SPARSE = 5  # of so many vertices one is looked at to frame a shape, as in the views
_STAY = np.eye(4)

_Models = Sequence["ModelShape"]


def mode_scene(view: ModesView, models: _Models, subject: Content | None = None) -> ViewContents:
    """Return the contents with one colour scale for all of them.

    Parameters
    ----------
    view : ModesView
    models : sequence of ModelShape
        The open result's model, and optionally one for comparison.
    subject : Content, optional
        A subject whose own surface is shown next to the shape.
    """
    look = _look(view, models)
    if view.count > 1:
        contents = [content for row in _rows(view, models) for content in _strip(view, models, look, row)]
        return ViewContents(contents, len(_STEPS[view.count]) * len(models), look.scale, {})
    deviations = np.array(view.deviations)
    contents = [subject] if subject is not None else []
    particles = {}
    for model in models:
        text = _caption(deviations, model, subject if model is models[0] else None)
        text += " · surface from particles"
        content = model_content(
            model,
            model.title_among(models),
            text,
            model.moved(deviations),
            look,
            alignment=_placement(model, models),
        )
        content = untitled(content, models)
        contents.append(content)
        local = model.particles(deviations[: model.modes])
        particles[content.name] = transform_points(content.alignment, local)
    if subject is not None:
        first = models[0].result
        particles[subject.name] = first.world[first.names.index(subject.name)]
    same = len({len(points) for points in particles.values()}) == 1
    frame = np.concatenate([_reached(model, models[0]) for model in models])
    return ViewContents(contents, len(contents), look.scale, particles if same else {}, frame=frame)


@lru_cache(maxsize=4)
def _reached(model: "ModelShape", first: "ModelShape") -> Array:
    """Return some points (n, 3) of the shapes at both ends of the sliders of the retained modes."""
    placed = _placement(model, [first])
    modes = max(1, model.parallel.n_retained)
    moves = REACH * model.moves[:modes].reshape(modes, -1, 3)[:, ::_SPARSE]
    ends = model.mean.vertices[::_SPARSE] + np.concatenate([moves, -moves])
    return np.asarray(transform_points(placed, ends.reshape(-1, 3)))


def _look(view: ModesView, models: _Models) -> DisplayOptions:
    limit = max(model.limit for model in models)
    factor = arrow_factor(models[0], limit) if view.arrows else 0.0
    note = f"arrows drawn {factor:g} × as long" if factor > 1.0 else ""
    if not view.colours:
        return DisplayOptions(None, factor)
    middle = view.from_middle
    title = f"{'Displacement' if middle else 'Outward displacement'} from the mean"
    scale = displacement_scale(limit, title, note, from_middle=middle)
    return DisplayOptions(scale.within(view.colour_range), factor, middle)


def _rows(view: ModesView, models: _Models) -> list[int]:
    """Return the modes of the rows: those of the axes, then the others in order, up to the number of rows."""
    steps = _STEPS[view.count]
    room = min(view.count // len(steps), _MOST // (len(steps) * len(models)))
    order = dict.fromkeys([*view.axes, *range(models[0].modes)])
    return [mode for mode in order if mode < min(model.modes for model in models)][:room]


def _strip(view: ModesView, models: _Models, look: DisplayOptions, mode: int) -> list[Content]:
    strip = []
    for model in models:
        for step in _STEPS[view.count]:
            deviations = np.zeros(mode + 1)
            deviations[mode] = amount = step * view.reach
            share = f"mode {mode + 1}: {100 * float(model.model.explained_variance_ratio_[mode]):.1f} %"
            digits = 0 if amount == round(amount) else 1
            text = f"mode {mode + 1}: {signed(amount, digits)} SD" if step else f"mean ({share})"
            names = (model.title_among(models), text) if len(models) > 1 else (text, "")
            moved = model.moved(deviations)
            strip.append(model_content(model, *names, moved, look, alignment=_placement(model, models)))
    return strip


def _placement(model: "ModelShape", models: _Models) -> FloatArray:
    from homolog_app.scenes.model_shape import placement

    return _STAY if model is models[0] else placement(model, models[0])


def _caption(deviations: FloatArray, model: "ModelShape", subject: Content | None) -> str:
    away = [(mode, float(value)) for mode, value in enumerate(deviations) if value]
    if subject is not None:
        gaps = model.particles(deviations) - model.result.world[model.result.names.index(subject.name)]
        gap = float(np.linalg.norm(gaps, axis=1).mean())
        count = len(deviations)
        return f"from {count} mode{'s' * (count != 1)}, {short(gap)} mm from its particles"
    if not away:
        return "mean"
    named = " ".join(f"{mode + 1}: {signed(value)}" for mode, value in away[:4])
    return f"mode {named} SD" if len(away) == 1 else f"modes {named}{' …' * (len(away) > 4)} SD"


PALE_LABELS = {
    "difference": f"p > {LEVEL:g}, corrected over the surface",
    "discriminant": "95 % bootstrap interval includes 0, or no difference found",
    "both": f"difference: corrected p > {LEVEL:g}; discriminant: 95 % interval includes 0",
}
"""Meaning of pale colours on each map."""
_GREY, _LEFT_OF_COLOUR = 150.0, 0.2
_NAME = 24  # maximum letters of a group's name


def group_scene(view: GroupsView, models: _Models, answers: "Sequence[GroupAnswer]") -> ViewContents:
    """Return the maps with one colour scale for all, the original method above the proposed one.

    Parameters
    ----------
    view : GroupsView
    models : sequence of ModelShape
        The open result's model, and optionally one for comparison.
    answers : sequence of GroupAnswer
        Answers of these models; none before the test.
    """
    if not answers:
        plain = [
            model_content(
                model,
                model.title_among(models),
                "mean",
                np.zeros_like(model.mean_normals),
                DisplayOptions(),
                alignment=_placement(model, models),
            )
            for model in models
        ]
        plain = [untitled(content, models) for content in plain]
        return ViewContents(plain, len(plain), None, {})
    rows = sorted(
        answers, key=lambda answer: answer.shape.method.uses_geodesics + answer.shape.method.uses_normals
    )
    first = answers[0]
    limit = max(answer.limit for answer in answers)
    factor = arrow_factor(first.shape, limit) if view.arrows else 0.0
    of = "" if first.values is None else f"{first.pair.title} "
    kind = "Difference" if view.from_middle else "Outward difference"
    ends = [shortened(name, _NAME) for name in (first.first, first.second)]
    parts = [f"{kind} from {of}{ends[0]} to {ends[1]}"]
    parts += [f"arrows drawn {factor:g} × as long"] if factor > 1.0 else []
    parts += [f"adjusted for {', '.join(first.study.question.covariates)}"] * bool(
        first.study.question.covariates
    )
    parts += ["the question has changed"] if view.outdated else []
    scale = displacement_scale(limit, parts[0], " · ".join(parts[1:]), from_middle=view.from_middle)
    scale = scale.within(view.colour_range)
    if view.only_significant:
        pale = PALE_LABELS["both" if view.count > 1 and first.values is None else view.map]
        scale = replace(scale, note=" · ".join(filter(None, (scale.note, f"pale: {pale}"))))
    if view.outdated:
        scale = replace(scale, table=_pale(scale.table))
    contents = []
    for answer in rows:
        contents += _row(
            view,
            answer,
            DisplayOptions(scale, factor, view.from_middle),
            _placement(answer.shape, models),
            answer.shape.title_among([row.shape for row in rows]) if len(rows) > 1 else "",
        )
    columns = len(contents) // len(rows)
    return ViewContents(contents, 2 if columns == 4 and len(rows) == 1 else columns, scale, {})


def _pale(table: Array) -> Array:
    """Return pale colours, for an answer to a previous question."""
    return np.rint(_GREY + _LEFT_OF_COLOUR * (table - _GREY)).astype(np.uint8)


def _row(
    view: GroupsView, answer: "GroupAnswer", look: DisplayOptions, placed: FloatArray, title: str
) -> list[Content]:
    if view.count == 1:
        return [_mapped(view, answer, look, placed, view.map, title)]
    ends = [_mean(answer, placed, end, title) for end in (0.0, 1.0)]
    if answer.values is None:
        maps = [_mapped(view, answer, look, placed, kind, title) for kind in ("difference", "discriminant")]
        return [*ends, *maps]
    middle = _mean(answer, placed, 0.5, title)
    return [ends[0], middle, ends[1], _mapped(view, answer, look, placed, "difference", title)]


def _mapped(
    view: GroupsView, answer: "GroupAnswer", look: DisplayOptions, placed: FloatArray, what: str, title: str
) -> Content:
    """Return the map on the shape at the selected position."""
    shape = answer.shape
    chosen = answer.discriminant if what == "discriminant" else answer.difference
    if chosen is None:
        note = "parallel analysis retains no mode: no discriminant"
        if answer.values is not None:
            note = "a number has no discriminant; choose the difference"
        return model_content(shape, title or "mean", note, answer.start, DisplayOptions(), alignment=placed)
    place = answer.at(view.way)
    slope = answer.values is not None
    ends = [shortened(name, _NAME) for name in (answer.second, answer.first)]
    name = f"Effect of {answer.pair.title}" if slope else f"{ends[0]} − {ends[1]}: {what}"
    return model_content(
        shape,
        title or name,
        f"{name} · {place}" if title else place,
        _at(answer, chosen, view.way),
        look,
        values=chosen.outward,
        ways=chosen.ways,
        faded=~chosen.significant if view.only_significant else None,
        alignment=placed,
    )


def _mean(answer: "GroupAnswer", placed: FloatArray, way: float, title: str) -> Content:
    """Return a shape without colours at an end of the path or half-way."""
    if way == 0.5:
        text, count = "half-way", ""
    else:
        text = answer.ends[int(way)]
        counts = answer.pair.counts
        known = counts.get((answer.first, answer.second)[int(way)], counts.get("pairs"))
        count = f"{known} subjects" if known else "by regression"
    names = (title, text) if title else (text, count)
    moved = _at(answer, answer.difference, way)
    return model_content(answer.shape, *names, moved, DisplayOptions(), alignment=placed)


def _at(answer: "GroupAnswer", chosen: "GroupMap", way: float) -> FloatArray:
    """Return the displacement from the model's mean; both maps include the midpoint of the groups' means."""
    middle = answer.start + 0.5 * answer.difference.ways
    return np.asarray(middle + np.float32(way - 0.5) * chosen.ways)


_PIN = 0.07
_NEARLY_ALL, _ROOM = 95.0, 1.25  # percentile of the mean shape, and a factor since subjects differ from it


def deviations_of(view: MeasureView) -> FloatArray:
    """Return the shape's position along each of the first modes [SD]."""
    deviations = np.zeros(view.mode + 1)
    deviations[-1] = view.at
    return deviations


def measured_scene(
    view: MeasureView,
    shape: "ModelShape",
    subjects: Mapping[str, Content],
    groups: Sequence[str | None] | None = None,
) -> ViewContents:
    """Return the shape, or two side by side, with both particles marked.

    Parameters
    ----------
    view : MeasureView
    shape : ModelShape
    subjects : mapping of str to Content
        The subjects of the view.
    groups : sequence of str or None, optional
        Group of each subject of the model; those of the result if not given.

    Raises
    ------
    InputError
        If a surface of the view does not exist.
    """
    aligned = {
        name: item.groomed.placed(item.alignment)
        for name, item in subjects.items()
        if item.groomed is not None
    }
    groups = shape.result.groups if groups is None else groups
    contents, particles, scale = [], {}, None
    for name in [view.subject] if view.beside in (None, view.subject) else [view.subject, view.beside or ""]:
        if name and name not in subjects:
            mesh, points = named_surface(name, shape, aligned, groups)
            note = "" if points is None else _distance_text(points, view)
            content = _with_line(Content(Path(name).name, None, mesh, None, _STAY, note), points, view)
        else:
            content, points = _measured(view, shape, subjects.get(name))
        contents.append(content)
        if points is not None:
            particles[content.name] = points
    if view.map == "thickness":
        contents, scale = _with_thickness(view, contents, shape)
    elif view.map == "distance":
        other, _ = named_surface(view.distance_from, shape, aligned, groups)
        contents, scale = _with_distances(view, contents, shape, other)
    return ViewContents(contents, len(contents), scale, particles)


def _measured(view: MeasureView, shape: "ModelShape", subject: Content | None) -> tuple[Content, FloatArray]:
    """Return the shape, or a subject's own surface, and its particles (N, 3)."""
    if subject is None:
        deviations = deviations_of(view)
        particles = shape.particles(deviations)
        text = f"mode {view.mode + 1}: {signed(view.at)} SD · {_distance_text(particles, view)}"
        content = model_content(shape, shape.title, text, shape.moved(deviations), DisplayOptions())
        return _with_pins(untitled(content, [shape]), particles[list(view.particles)]), particles
    particles = shape.result.world[shape.result.names.index(subject.name)]
    return _with_line(subject, particles, view), particles


def _distance_text(particles: FloatArray, view: MeasureView) -> str:
    first, second = particles[list(view.particles)]
    return f"distance {short(float(np.linalg.norm(second - first)))} mm"


def _with_line(content: Content, particles: FloatArray | None, view: MeasureView) -> Content:
    """Draw a line between the two particles, if the surface has any."""
    if particles is None:
        return content
    return replace(content, lines=particles[None, list(view.particles)], through=True)


def _with_thickness(
    view: MeasureView, contents: Sequence[Content], shape: "ModelShape"
) -> tuple[list[Content], ColourScale]:
    """Colour surfaces by the thickness of their walls, at their original size."""
    from homolog.surfaces.walls import wall_thickness

    scale = _thickness_scale(wall_thickness(shape.mean)).within(view.colour_range)
    values = [wall_thickness(item.groomed) if item.groomed else np.empty(0) for item in contents]
    if any(np.isnan(item).any() for item in values):
        scale = replace(scale, grey_label="no opposite side")
    return [_coloured(*pair, scale) for pair in zip(contents, values, strict=True)], scale


def _with_distances(
    view: MeasureView, contents: Sequence[Content], shape: "ModelShape", other: "TriangleMesh"
) -> tuple[list[Content], ColourScale]:
    """Colour surfaces by their distance from another one, and describe it in their captions."""
    from homolog.surfaces.comparison import surface_distances

    apart = [
        surface_distances(item.groomed.placed(item.alignment), other) for item in contents if item.groomed
    ]
    moves = "" in (view.subject, view.beside)  # a shape that moves along a mode keeps its colours
    limit = shape.limit if moves and other is shape.mean else common_limit([item.signed for item in apart])
    title = "the mean surface" if other is shape.mean else Path(view.distance_from).name
    scale = displacement_scale(limit, f"Distance from {title}").within(view.colour_range)
    scale = replace(scale, low_label="inside it", high_label="outside")
    coloured = []
    for content, item in zip(contents, apart, strict=True):
        notes = (content.note if len(contents) == 1 else "", distance_text(item))  # two views are narrow
        coloured.append(_coloured(replace(content, note=" · ".join(filter(None, notes))), item.signed, scale))
    return coloured, scale


def distance_text(apart: "SurfaceDistances") -> str:
    """Return the mean, the 95th percentile and the maximum of distances as text."""
    mean, high, most = (short(value) for value in (apart.mean, apart.percentile(95.0), apart.maximum))
    return f"mean {mean}, 95 % {high}, max {most} mm"


def _coloured(content: Content, values: FloatArray, scale: ColourScale) -> Content:
    unknown = np.isnan(values)
    colours = scale.colours(np.where(unknown, scale.low, values), unknown)
    return replace(content, colours=colours, coarse=None)


def _thickness_scale(thickness: FloatArray) -> ColourScale:
    """Return a scale from 0 to somewhat above the 95th percentile of the mean shape's thickness."""
    known = thickness[~np.isnan(thickness)]
    high = _ROOM * float(np.percentile(known, _NEARLY_ALL)) if len(known) else 1.0
    return ColourScale("Wall thickness", "mm", 0.0, float(f"{high:.2g}"), viridis(), "thin", "thick")


def _with_pins(content: Content, ends: FloatArray) -> Content:
    """Mark two points of a surface with pins from outside and a line between them."""
    assert content.groomed is not None
    assert content.normals is not None
    vertices = content.groomed.vertices
    at = [int(np.square(vertices - end).sum(axis=1).argmin()) for end in ends]
    pins = -_PIN * float(np.ptp(vertices, axis=0).max()) * np.asarray(content.normals, np.float64)[at]
    return replace(content, arrows=Arrows(ends - pins, pins), lines=ends[None], through=True)
