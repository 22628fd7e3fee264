"""What the views show of groups: maps on the mean shape, one row for each run (the paper's figure 4)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.window.explore.model_content import Look, arrow_factor, model_content
from homolog_app.window.scene.colour_scale import displacement_scale
from homolog_app.window.scene.content import Content, Shown

if TYPE_CHECKING:
    from homolog_app.window.explore.group_answer import GroupAnswer, GroupMap
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["GroupScene", "group_scene"]

_STAY = np.eye(4)


@dataclass(frozen=True, slots=True, eq=False)
class GroupScene:
    """What is asked for.

    Attributes
    ----------
    models : sequence of ModelShape
        The open result's, and one to compare with or none.
    answers : sequence of GroupAnswer
        Of these models; none before the test.
    map : str
        ``"difference"`` or ``"discriminant"``.
    means : bool
        Whether both groups' means stand beside the map.
    way : float
        Place of the shape between the means, 0 at the first.
    only_significant, arrows : bool
        Whether what is not significant is greyed, and whether arrows are drawn.
    """

    models: "Sequence[ModelShape]"
    answers: "Sequence[GroupAnswer]"
    map: str
    means: bool
    way: float
    only_significant: bool
    arrows: bool


def group_scene(wanted: GroupScene) -> Shown:
    """Return the maps with one colour scale for all, the original method above the proposed one."""
    if not wanted.answers:
        plain = [
            model_content(one, one.title, "mean", np.zeros_like(one.mean_normals), Look(),
                          alignment=_placement(one, wanted))
            for one in wanted.models
        ]  # fmt: skip
        return Shown(plain, len(plain), None, {})
    rows = sorted(
        wanted.answers, key=lambda one: one.shape.method.uses_geodesics + one.shape.method.uses_normals
    )
    first = wanted.answers[0]
    limit = max(one.limit for one in wanted.answers)
    factor = arrow_factor(first.shape, limit) if wanted.arrows else 0.0
    words = [f"{first.second} − {first.first}, outward difference"]
    words += [f"arrows drawn {factor:g} × as long"] if factor > 1.0 else []
    words += ["grey: not significant"] if wanted.only_significant else []
    scale = displacement_scale(limit, words[0], " · ".join(words[1:]))
    contents = [content for one in rows for content in _row(wanted, one, Look(scale, factor))]
    return Shown(contents, len(contents) // len(rows), scale, {})


def _row(wanted: GroupScene, answer: "GroupAnswer", look: Look) -> list[Content]:
    shape, placed = answer.shape, _placement(answer.shape, wanted)
    chosen = answer.discriminant if wanted.map == "discriminant" else answer.difference
    title = shape.title if len(wanted.answers) > 1 else ""
    if chosen is None:
        note = "no mode is above chance: no discriminant"
        return [model_content(shape, title or "mean", note, answer.start, Look(), alignment=placed)]
    what = "discriminant" if wanted.map == "discriminant" else "difference"
    place = f"{answer.first} to {answer.second} at {100 * wanted.way:.0f} %"
    mapped = model_content(
        shape, title or f"{answer.second} − {answer.first}: {what}", f"{what} · {place}" if title else place,
        _at(answer, chosen, wanted.way), look, values=chosen.outward, ways=chosen.ways,
        faded=~chosen.significant if wanted.only_significant else None, alignment=placed,
    )  # fmt: skip
    if not wanted.means:
        return [mapped]
    ends = []
    for end, name in enumerate((answer.first, answer.second)):
        mean, count = f"mean of {name}", f"{answer.pair.counts[name]} subjects"
        words = (title, mean) if title else (mean, count)
        ends.append(model_content(shape, *words, _at(answer, chosen, end), Look(), alignment=placed))
    return [ends[0], mapped, ends[1]]


def _at(answer: "GroupAnswer", chosen: "GroupMap", way: float) -> FloatArray:
    """Return the way from the model's mean; both maps go through the middle between the groups' means."""
    middle = answer.start + 0.5 * answer.difference.ways
    return np.asarray(middle + np.float32(way - 0.5) * chosen.ways)


def _placement(one: "ModelShape", wanted: GroupScene) -> FloatArray:
    from homolog_app.window.explore.model_shape import placement

    return _STAY if one is wanted.models[0] else placement(one, wanted.models[0])
