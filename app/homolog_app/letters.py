"""Anatomical letters at the edges of a view, as radiology viewers show them."""

import numpy as np

from homolog.arrays import FloatArray

__all__ = ["direction_letters", "edge_letters"]

_POSITIVE, _NEGATIVE = "LPS", "RAI"
_OBLIQUE = 0.42  # sine of 25 degrees


def direction_letters(direction: FloatArray) -> str:
    """Name a direction in patient coordinates (LPS): ``"L"``, or ``"LA"`` if it lies between two axes."""
    order = np.argsort(-np.abs(direction))
    named = [axis for axis in order[:2] if abs(direction[axis]) >= _OBLIQUE]
    return "".join(_POSITIVE[axis] if direction[axis] > 0 else _NEGATIVE[axis] for axis in named)


def edge_letters(patient_axes: FloatArray, right: FloatArray, up: FloatArray) -> tuple[str, str, str, str]:
    """Return the letters at the left, right, bottom and top edge.

    Parameters
    ----------
    patient_axes : (3, 3) array
        Columns: the patient's left, back and head in the coordinates that are shown.
    right, up : (3,) arrays
        The screen's unit directions in the same coordinates.
    """
    across, along = patient_axes.T @ right, patient_axes.T @ up
    return (
        direction_letters(-across), direction_letters(across),
        direction_letters(-along), direction_letters(along),
    )  # fmt: skip
