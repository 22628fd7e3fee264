"""Colours for numbers on surfaces, and what is needed to print the scale beside them."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, BoolArray

__all__ = ["ColourScale", "displacement_scale"]

_FADED = np.array([150.0, 150.0, 150.0])
_FADING = 0.85


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
        What the ends mean, such as ``"contraction"`` and ``"expansion"``.
    note : str
        A further remark, such as how long arrows are drawn.
    """

    title: str
    unit: str
    low: float
    high: float
    table: Array
    low_words: str = ""
    high_words: str = ""
    note: str = ""

    def colours(self, values: Array, faded: BoolArray | None = None) -> Array:
        """Return (V, 3) uint8 colours of values (V,); those marked in `faded` (V,) are greyed."""
        span = max(self.high - self.low, np.finfo(float).tiny)
        place = np.clip((values - self.low) * ((len(self.table) - 1) / span), 0, len(self.table) - 1)
        chosen = self.table[np.rint(place).astype(np.intp)]
        if faded is not None and faded.any():
            pale = (1.0 - _FADING) * chosen[faded] + _FADING * _FADED
            chosen[faded] = np.rint(pale)
        return chosen


def displacement_scale(limit: float, title: str = "Outward displacement", note: str = "") -> ColourScale:
    """Return the blue-yellow scale of displacements, symmetric about 0.

    Parameters
    ----------
    limit : float
        End of the scale on both sides [mm]: blue at +limit is expansion, yellow at -limit contraction.
    title, note : str
        See `ColourScale`.
    """
    from homolog_app.pictures.colours import diverging_table

    table = np.rint(255.0 * diverging_table()).astype(np.uint8)
    return ColourScale(title, "mm", -limit, limit, table, "contraction", "expansion", note)
