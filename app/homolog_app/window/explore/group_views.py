"""What the views show of an answer: maps on the mean shape, for each run (the paper's figure 4)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog_app.rendering.colours import displacement_scale
from homolog_app.report.findings import LEVEL
from homolog_app.views.content import Content, ViewContents
from homolog_app.window.explore.model_content import DisplayOptions, arrow_factor, model_content, untitled
from homolog_app.window.explore.view_states import GroupsView

if TYPE_CHECKING:
    from homolog_app.window.explore.group_answer import GroupAnswer, GroupMap
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["GREY_WORDS", "group_scene"]

_STAY = np.eye(4)
GREY_WORDS = {
    "difference": f"p > {LEVEL:g}, corrected over the surface",
    "discriminant": "95 % bootstrap interval holds 0, or no difference found",
    "both": f"difference: corrected p > {LEVEL:g}; discriminant: 95 % interval holds 0",
}
"""What grey means on each map."""
_GREY, _LEFT_OF_COLOUR = 150.0, 0.2
_Models = Sequence["ModelShape"]


def group_scene(view: GroupsView, models: _Models, answers: "Sequence[GroupAnswer]") -> ViewContents:
    """Return the maps with one colour scale for all, the original method above the proposed one.

    Parameters
    ----------
    view : GroupsView
    models : sequence of ModelShape
        The open result's, and one to compare with or none.
    answers : sequence of GroupAnswer
        Of these models; none before the test.
    """
    if not answers:
        plain = [
            model_content(model, model.title_among(models), "mean", np.zeros_like(model.mean_normals),
                          DisplayOptions(), alignment=_placement(model, models))
            for model in models
        ]  # fmt: skip
        plain = [untitled(content, models) for content in plain]
        return ViewContents(plain, len(plain), None, {})
    rows = sorted(
        answers, key=lambda answer: answer.shape.method.uses_geodesics + answer.shape.method.uses_normals
    )
    first = answers[0]
    limit = max(answer.limit for answer in answers)
    factor = arrow_factor(first.shape, limit) if view.arrows else 0.0
    of = "" if first.values is None else f"{first.study.request.column} "
    kind = "Difference" if view.from_middle else "Outward difference"
    parts = [f"{kind} from {of}{first.first} to {first.second}"]
    parts += [f"arrows drawn {factor:g} × as long"] if factor > 1.0 else []
    parts += [f"adjusted for {', '.join(first.study.request.covariates)}"] * bool(
        first.study.request.covariates
    )
    parts += ["the question has changed"] if view.outdated else []
    scale = displacement_scale(limit, parts[0], " · ".join(parts[1:]), from_middle=view.from_middle)
    scale = scale.within(view.colour_range)
    if view.only_significant:
        scale = replace(
            scale, grey_words=GREY_WORDS["both" if view.count > 1 and first.values is None else view.map]
        )
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
    """Return colours near grey, for what is no answer to the question any more."""
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
    """Return the map on the shape at the place that is chosen."""
    shape = answer.shape
    chosen = answer.discriminant if what == "discriminant" else answer.difference
    if chosen is None:
        note = "parallel analysis retains no mode: no discriminant"
        if answer.values is not None:
            note = "a number has no discriminant; look at the difference"
        return model_content(shape, title or "mean", note, answer.start, DisplayOptions(), alignment=placed)
    place = answer.at(view.way)
    slope = answer.values is not None
    name = (
        f"Effect of {answer.study.request.column}" if slope else f"{answer.second} − {answer.first}: {what}"
    )
    return model_content(
        shape, title or name, f"{name} · {place}" if title else place,
        _at(answer, chosen, view.way), look, values=chosen.outward, ways=chosen.ways,
        faded=~chosen.significant if view.only_significant else None, alignment=placed,
    )  # fmt: skip


def _mean(answer: "GroupAnswer", placed: FloatArray, way: float, title: str) -> Content:
    """Return a shape without colours: at an end, or half-way."""
    if way == 0.5:
        text, count = "half-way", ""
    else:
        text = answer.ends[int(way)]
        known = answer.pair.counts.get((answer.first, answer.second)[int(way)])
        count = f"{known} subjects" if known else "by regression"
    names = (title, text) if title else (text, count)
    moved = _at(answer, answer.difference, way)
    return model_content(answer.shape, *names, moved, DisplayOptions(), alignment=placed)


def _at(answer: "GroupAnswer", chosen: "GroupMap", way: float) -> FloatArray:
    """Return the way from the model's mean; both maps go through the middle between the groups' means."""
    middle = answer.start + 0.5 * answer.difference.ways
    return np.asarray(middle + np.float32(way - 0.5) * chosen.ways)


def _placement(model: "ModelShape", models: _Models) -> FloatArray:
    from homolog_app.window.explore.model_shape import placement

    return _STAY if model is models[0] else placement(model, models[0])
