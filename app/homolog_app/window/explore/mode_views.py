"""What the views show of the modes: one shape, a subject beside its reconstruction, or whole rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.window.explore.model_content import Look, arrow_factor, model_content
from homolog_app.window.quantities import short, signed
from homolog_app.window.scene.colour_scale import displacement_scale
from homolog_app.window.scene.content import Content, Shown

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["ModeScene", "mode_scene"]


@dataclass(frozen=True, slots=True, eq=False)
class ModeScene:
    """What is asked for.

    Attributes
    ----------
    models : sequence of ModelShape
        The open result's, and one to compare with or none.
    deviations : (k,) array
        Of the first modes [SD].
    strips : sequence of int
        Modes of which −, mean and + are shown in a row each (the paper's figure 3); none shows the shape.
    reach : float
        Standard deviations at the ends of these rows.
    subject : Content or None
        A subject whose own surface stands beside the shape.
    colours, arrows : bool
        Whether displacement is shown so.
    """

    models: "Sequence[ModelShape]"
    deviations: FloatArray
    strips: Sequence[int]
    reach: float
    subject: Content | None
    colours: bool
    arrows: bool


def mode_scene(wanted: ModeScene) -> Shown:
    """Return the contents with one colour scale for all of them."""
    look = _look(wanted)
    if wanted.strips:
        strips = [_strip(wanted, look, one, mode) for mode in wanted.strips for one in wanted.models]
        contents = [content for strip in strips for content in strip]
        return Shown(contents, 3 * len(wanted.models), look.scale, {})
    contents = [wanted.subject] if wanted.subject is not None else []
    particles = {}
    for one in wanted.models:
        content = model_content(
            one, one.title, _words(wanted, one), one.moved(wanted.deviations), look,
            alignment=_placement(wanted, one),
        )  # fmt: skip
        contents.append(content)
        local = one.model.shape(wanted.deviations[: one.modes])
        particles[one.title] = local @ content.alignment[:3, :3].T + content.alignment[:3, 3]
    if wanted.subject is not None:
        first = wanted.models[0].result
        particles[wanted.subject.name] = first.world[first.names.index(wanted.subject.name)]
    same = len({len(one) for one in particles.values()}) == 1
    return Shown(contents, len(contents), look.scale, particles if same else {})


def _look(wanted: ModeScene) -> Look:
    limit = max(one.limit for one in wanted.models)
    factor = arrow_factor(wanted.models[0], limit) if wanted.arrows else 0.0
    note = f"arrows drawn {factor:g} × as long" if factor > 1.0 else ""
    scale = displacement_scale(limit, "Outward displacement from the mean", note) if wanted.colours else None
    return Look(scale, factor)


def _strip(wanted: ModeScene, look: Look, one: "ModelShape", mode: int) -> list[Content]:
    strip = []
    for amount in (-wanted.reach, 0.0, wanted.reach):
        deviations = np.zeros(mode + 1)
        deviations[mode] = amount
        words = f"mode {mode + 1}: {signed(amount, 0)} SD" if amount else f"mean ({_share(one, mode)})"
        name = f"{one.title}" if len(wanted.models) > 1 else words
        note = words if len(wanted.models) > 1 else ""
        strip.append(
            model_content(one, name, note, one.moved(deviations), look, alignment=_placement(wanted, one))
        )
    return strip


def _share(one: "ModelShape", mode: int) -> str:
    return f"mode {mode + 1}: {100 * float(one.model.explained[mode]):.1f} %"


def _placement(wanted: ModeScene, one: "ModelShape") -> FloatArray:
    from homolog_app.window.explore.model_shape import placement

    return _STAY if one is wanted.models[0] else placement(one, wanted.models[0])


_STAY = np.eye(4)


def _words(wanted: ModeScene, one: "ModelShape") -> str:
    away = [(mode, value) for mode, value in enumerate(wanted.deviations) if value]
    if wanted.subject is not None and one is wanted.models[0]:
        index = one.result.names.index(wanted.subject.name)
        gaps = one.model.shape(wanted.deviations) - one.result.world[index]
        gap = float(np.linalg.norm(gaps, axis=1).mean())
        count = len(wanted.deviations)
        return f"from {count} mode{'s' * (count != 1)}, {short(gap)} mm from its particles"
    if not away:
        return "mean"
    named = " ".join(f"{mode + 1}: {signed(value)}" for mode, value in away[:4])
    return f"mode {named} SD" if len(away) == 1 else f"modes {named}{' …' * (len(away) > 4)} SD"
