"""Display state of each page, from which the window and the command line draw it."""

import json
from math import inf
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from homolog.comparison.question import Question
from homolog_app.rendering.camera import Canvas

__all__ = [
    "REACH",
    "CheckView",
    "ColouredView",
    "GroupsView",
    "MeasureView",
    "ModesView",
    "Snapshot",
    "SubjectsView",
    "View",
]

REACH = 3.0
"""Largest distance from the mean along a mode that can be chosen [SD]."""


class _View(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ColouredView(_View):
    """A view with a colour scale.

    Attributes
    ----------
    colour_range : (float, float) or None
        Lowest and highest value, set by the user; automatic if None.
    from_middle : bool
        Whether displacements are positive away from the centre of the shape, as on the inner wall of a
        hollow organ whose cavity becomes larger, rather than out of the tissue.
    """

    colour_range: tuple[float, float] | None = None
    from_middle: bool = False

    @field_validator("colour_range")
    @classmethod
    def _ascends(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not -inf < value[0] < value[1] < inf:
            raise ValueError("two numbers, the lower one first")
        return value


class SubjectsView(_View):
    """The subjects, with their particles in a recorded frame of the run, or at its end if none is given."""

    page: Literal["subjects"] = "subjects"
    moment: int | None = None


class ModesView(ColouredView):
    """Shapes along modes.

    Attributes
    ----------
    count : int
        1 shows the shape at the deviations; 4, 9 and 16 show steps along modes, one mode per row.
    deviations : tuple of float
        Deviations along the first modes [SD].
    axes : tuple of int
        Modes of the first rows, counted from 0.
    reach : float
        Standard deviations at the ends of rows.
    subject : str
        Subject whose own surface is shown next to the shape; none if empty.
    colours, arrows : bool
        Whether displacement is shown by colours, and by arrows.
    """

    page: Literal["modes"] = "modes"
    count: Literal[1, 4, 9, 16] = 1
    deviations: tuple[float, ...] = ()
    axes: tuple[int, ...] = (0, 1)
    reach: float = 2.0
    subject: str = ""
    colours: bool = True
    arrows: bool = False


class GroupsView(ColouredView):
    """The answer to a question.

    Attributes
    ----------
    request : Question or None
        The question; the mean shape is shown without one.
    pair : int
        Index of the two groups among the pairs of the question.
    outdated : bool
        Whether the question has changed since the answer.
    map : str
    count : int
        1 shows the map, 4 also the shapes that it compares.
    way : float
        Position of the shape, 0 at the first group or value and 1 at the second.
    only_significant, arrows : bool
        Whether regions that are not significant are greyed, and whether arrows are drawn.
    """

    page: Literal["groups"] = "groups"
    request: Question | None = None
    pair: int = 0
    outdated: bool = False
    map: Literal["difference", "discriminant"] = "difference"
    count: Literal[1, 4] = 1
    way: float = 0.0
    only_significant: bool = False
    arrows: bool = False


class MeasureView(ColouredView):
    """A shape along one mode, or a subject, and two particles on it.

    Attributes
    ----------
    subject : str
        Surface that replaces the shape along the mode, named as in `named_surface`; that shape if empty.
    beside : str or None
        Surface next to it, named in the same way; none if None.
    map : str
        Quantity of the colours: the thickness of the wall, or the distance from another surface.
    distance_from : str
        The other surface, named as in `named_surface`.
    """

    page: Literal["measure"] = "measure"
    mode: int = 0
    at: float = 0.0
    particles: tuple[int, int] = (0, 0)
    subject: str = ""
    beside: str | None = None
    map: Literal["none", "thickness", "distance"] = "none"
    distance_from: str = "mean"


class CheckView(_View):
    """The subjects while correspondence is checked.

    Attributes
    ----------
    show : str
        As in `homolog_app.scenes.check.Marks`, with ``"checkerboard"`` and ``"stripes"`` for textures.
    particle : int or None
        The selected particle.
    subject : str
        Subject on which `others` have rings.
    others : tuple of int
    place : (x, y, z) or None
        Point from which distances are shown [mm], if not from the particle.
    """

    page: Literal["check"] = "check"
    show: str = "places"
    particle: int | None = None
    subject: str = ""
    others: tuple[int, ...] = ()
    place: tuple[float, float, float] | None = None


View = Annotated[SubjectsView | ModesView | GroupsView | MeasureView | CheckView, Field(discriminator="page")]


class Snapshot(_View):
    """All data for a picture of the views, except those of the project.

    Attributes
    ----------
    view : View
    canvas : Canvas
    title : str
        Title of the study, in captions that include it.
    beside : Path or None
        The project that is compared with it.
    aspect : str
        What of several structures is shown (`homolog_app.scenes.structures`).
    """

    view: View
    canvas: Canvas = Canvas()
    title: str = ""
    beside: Path | None = None
    aspect: str = ""

    @property
    def as_json(self) -> str:
        """The JSON text from which it can be read, without default values."""
        fields = self.model_dump(mode="json", exclude_defaults=True)
        fields["view"] = {"page": self.view.page, **fields["view"]}
        return json.dumps(fields, ensure_ascii=False, separators=(",", ":"))
