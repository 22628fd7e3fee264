"""Colours for numbers on surfaces, and what is needed to print the scale beside them."""

from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import Array, BoolArray
from homolog_app.rendering.colours import diverging_table

__all__ = ["GREY", "ColourScale", "displacement_scale", "viridis"]

GREY = (150, 150, 150)
"""What has no value, or none that counts: neutral, and unlike every colour of the scales."""

# Viridis (Smith and van der Walt 2015) at nine places.
_VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129),
     (92, 200, 99), (170, 220, 50), (253, 231, 37)], float,
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class ColourScale:
    """From numbers to colours.

    Attributes
    ----------
    title, unit : str
        What is shown, such as ``"Outward displacement"``, and ``"mm"``.
    low, high : float
        Ends of the scale; values beyond them get the colours of the ends.
    table : (256, 3) uint8 array
        Colours from low to high.
    low_words, high_words : str
        What the ends mean, such as ``"into the tissue"`` and ``"out of the tissue"``.
    note : str
        A further remark, such as how long arrows are drawn.
    grey_words : str
        What grey means, for a patch of it beside the scale; nothing if there is no grey.
    """

    title: str
    unit: str
    low: float
    high: float
    table: Array
    low_words: str = ""
    high_words: str = ""
    note: str = ""
    grey_words: str = ""

    def within(self, range_: tuple[float, float] | None) -> "ColourScale":
        """Return the scale with its ends set by hand, or as it is."""
        if range_ is None:
            return self
        note = " · ".join(part for part in (self.note, "range set by hand") if part)
        return replace(self, low=range_[0], high=range_[1], note=note)

    def colours(self, values: Array, faded: BoolArray | None = None) -> Array:
        """Return (V, 3) uint8 colours of values (V,); those marked in `faded` (V,) are greyed."""
        span = max(self.high - self.low, np.finfo(float).tiny)
        place = np.clip((values - self.low) * ((len(self.table) - 1) / span), 0, len(self.table) - 1)
        chosen = self.table[np.rint(place).astype(np.intp)]
        if faded is not None and faded.any():
            chosen[faded] = GREY
        return chosen


def displacement_scale(
    limit: float, title: str = "Outward displacement", note: str = "", *, from_middle: bool = False
) -> ColourScale:
    """Return the blue-yellow scale of displacements, symmetric about 0.

    Parameters
    ----------
    limit : float
        End of the scale on both sides [mm]: blue at +limit is out of the tissue, yellow at -limit into it.
    title, note : str
        See `ColourScale`.
    from_middle : bool
        Whether blue is away from the middle of the shape.
    """
    table = np.rint(255.0 * diverging_table()).astype(np.uint8)
    texts = ("to the middle", "from the middle") if from_middle else ("into the tissue", "out of the tissue")
    return ColourScale(title, "mm", -limit, limit, table, *texts, note)


def viridis() -> Array:
    """Return the colours of numbers that go from low to high, (256, 3) uint8."""
    stops = np.linspace(0.0, 1.0, len(_VIRIDIS))
    fine = [np.interp(np.linspace(0.0, 1.0, 256), stops, channel) for channel in _VIRIDIS.T]
    table: Array = np.rint(np.stack(fine, axis=1)).astype(np.uint8)
    return table
