"""What the views show of the modes: one shape, a subject beside its reconstruction, or steps in rows."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.rendering.colours import displacement_scale
from homolog_app.rendering.text import short, signed
from homolog_app.views.content import Content, ViewContents
from homolog_app.window.explore.model_content import DisplayOptions, arrow_factor, model_content, untitled
from homolog_app.window.explore.view_states import ModesView

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["mode_scene"]

_STEPS: Mapping[int, tuple[float, ...]] = {
    4: (-1.0, 1.0), 9: (-1.0, 0.0, 1.0), 16: (-1.0, -0.5, 0.5, 1.0),
}  # fmt: skip
"""Parts of the reach in each row, by the number of views."""
_MOST = 16
_STAY = np.eye(4)

_Models = Sequence["ModelShape"]


def mode_scene(view: ModesView, models: _Models, subject: Content | None = None) -> ViewContents:
    """Return the contents with one colour scale for all of them.

    Parameters
    ----------
    view : ModesView
    models : sequence of ModelShape
        The open result's, and one to compare with or none.
    subject : Content, optional
        A subject whose own surface stands beside the shape.
    """
    look = _look(view, models)
    if view.count > 1:
        contents = [content for row in _rows(view, models) for content in _strip(view, models, look, row)]
        return ViewContents(contents, len(_STEPS[view.count]) * len(models), look.scale, {})
    deviations = np.array(view.deviations)
    contents = [subject] if subject is not None else []
    particles = {}
    for model in models:
        text = _words(deviations, model, subject if model is models[0] else None)
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
        local = model.model.instance(deviations[: model.modes])
        particles[content.name] = local @ content.alignment[:3, :3].T + content.alignment[:3, 3]
    if subject is not None:
        first = models[0].result
        particles[subject.name] = first.world[first.names.index(subject.name)]
    same = len({len(points) for points in particles.values()}) == 1
    return ViewContents(contents, len(contents), look.scale, particles if same else {})


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
    """Return the modes of the rows: those of the axes, then the others in order, as many as there is room."""
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
            share = f"mode {mode + 1}: {100 * float(model.model.explained_variance_ratio[mode]):.1f} %"
            digits = 0 if amount == round(amount) else 1
            text = f"mode {mode + 1}: {signed(amount, digits)} SD" if step else f"mean ({share})"
            names = (model.title_among(models), text) if len(models) > 1 else (text, "")
            moved = model.moved(deviations)
            strip.append(model_content(model, *names, moved, look, alignment=_placement(model, models)))
    return strip


def _placement(model: "ModelShape", models: _Models) -> FloatArray:
    from homolog_app.window.explore.model_shape import placement

    return _STAY if model is models[0] else placement(model, models[0])


def _words(deviations: FloatArray, model: "ModelShape", subject: Content | None) -> str:
    away = [(mode, float(value)) for mode, value in enumerate(deviations) if value]
    if subject is not None:
        gaps = model.model.instance(deviations) - model.result.world[model.result.names.index(subject.name)]
        gap = float(np.linalg.norm(gaps, axis=1).mean())
        count = len(deviations)
        return f"from {count} mode{'s' * (count != 1)}, {short(gap)} mm from its particles"
    if not away:
        return "mean"
    named = " ".join(f"{mode + 1}: {signed(value)}" for mode, value in away[:4])
    return f"mode {named} SD" if len(away) == 1 else f"modes {named}{' …' * (len(away) > 4)} SD"
