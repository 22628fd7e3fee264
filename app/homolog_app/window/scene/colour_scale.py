"""Colours for numbers on surfaces, and what is needed to print the scale beside them."""

from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import Array, BoolArray

__all__ = ["GREY", "ColourScale", "displacement_scale"]

GREY = (150, 150, 150)
"""What has no value, or none that counts: neutral, and unlike every colour of the scales."""


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


def displacement_scale(limit: float, title: str = "Outward displacement", note: str = "") -> ColourScale:
    """Return the blue-yellow scale of displacements, symmetric about 0.

    Parameters
    ----------
    limit : float
        End of the scale on both sides [mm]: blue at +limit is out of the tissue, yellow at -limit into it.
    title, note : str
        See `ColourScale`.
    """
    from homolog_app.pictures.colours import diverging_table

    table = np.rint(255.0 * diverging_table()).astype(np.uint8)
    return ColourScale(title, "mm", -limit, limit, table, "into the tissue", "out of the tissue", note)
