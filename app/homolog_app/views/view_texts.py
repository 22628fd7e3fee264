"""All texts of a view: caption, letters, scale bar and numbers, none of which overlaps a shape."""

from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.rendering.colours import Colours
from homolog_app.views.captions import Caption, ScaleBar
from homolog_app.views.content import Content
from homolog_app.views.strip import NumberLabels, Strip

__all__ = ["ViewTexts"]


class ViewTexts:
    """The texts of a view, which are moved to a strip at its top if they would overlap the shape.

    Attributes
    ----------
    caption : Caption
    """

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401 - VTK is untyped
        self._renderer = renderer
        self._strip = Strip(renderer)  # first: the others are drawn over it
        self.caption, self._bar, self._numbers = Caption(renderer), ScaleBar(renderer), NumberLabels(renderer)
        self._content: Content | None = None
        self._size = 12
        self._points = np.empty((0, 2))
        self._is_close = False

    def show(self, content: Content | None, size: int, *, small: bool, letters: bool, bar: bool) -> None:
        """Show the texts of a content with a text height [pixels]."""
        self._content, self._size = content, size
        self.caption.show(content.caption if content else [], size, small=small, letters=letters)
        self._bar.show(bar and content is not None, round(0.85 * size))
        self._numbers.show(content.numbers if content else None, size)

    def paint(self, colours: Colours) -> None:
        """Apply the scheme's colours."""
        for part in (self.caption, self._bar, self._strip):
            part.paint(colours)

    def follow(self, points: FloatArray, *, is_close: bool) -> None:
        """Before each drawing: set a shape's points (n, 2), from 0 to 1, and whether it is a close-up."""
        self._points, self._is_close = points * self._renderer.GetSize(), is_close

    @property
    def need_strip(self) -> bool:
        """Whether a text would overlap the shape, or numbers are shown."""
        content = self._content
        if content is None:
            return False
        return self._covers_bar or content.numbers is not None or _covers(self.caption.free_box, self._points)

    @property
    def _covers_bar(self) -> bool:
        return self._is_close or _covers(self._bar.free_box, self._points)

    def face(
        self, axes: FloatArray, low: FloatArray, high: FloatArray, inset: FloatArray, in_strip: bool
    ) -> None:
        """Before each drawing, after `follow`: place the texts.

        Parameters
        ----------
        axes : (3, 3) array
            Directions to the right, upwards and ahead.
        low, high : (n, 2) array
            Corners of the shape's parts in the view, from 0 to 1.
        inset : (4,) array
            Box of the view's overview, in fractions of the view.
        in_strip : bool
            Whether the texts are in the strip.
        """
        content = self._content
        if content is None:
            self._strip.face(0, self._size)
            return
        self._strip.face(1 + (content.numbers is not None) if in_strip else 0, self._size)
        taken = self._bar.taken if in_strip and self._covers_bar else 0.0
        if not taken or self.caption.has_room(taken):
            self._bar.face(self._strip.middle(0) if taken else None)
        else:  # the name has priority
            self._bar.hide()
            taken = 0.0
        right, up, _ = axes
        self.caption.face(content.patient_axes, right, up, in_strip=in_strip, taken=taken)
        seen = low[:, 1] * self._renderer.GetSize()[1] < self._strip.bottom
        self.caption.leave_free(low[seen], high[seen])
        self._numbers.face(right, self._strip, inset)


def _covers(box: FloatArray, points: FloatArray) -> bool:
    """Whether a box (4,) contains any of the points (n, 2)."""
    return bool(((points >= box[:2]) & (points <= box[2:])).all(axis=1).any())
