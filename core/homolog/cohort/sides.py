"""Sides of the body, from the cohort's table or pattern."""

from homolog.cohort.subject import Cohort, column_of
from homolog.errors import InputError

__all__ = ["LEFT", "RIGHT", "SIDE_COLUMN", "other_side", "side_of_word", "sides_of"]

LEFT, RIGHT = "left", "right"
SIDE_COLUMN = "side"
"""Column of the cohort's table, case-insensitive."""

_CODES = {
    **dict.fromkeys(("l", "left", "lh"), LEFT),
    **dict.fromkeys(("r", "right", "rh"), RIGHT),
}
"""Values of the column, case-insensitive; lh and rh are those of FreeSurfer."""


def side_of_word(word: str) -> str:
    """Return the side that a word denotes, left or right; otherwise an empty text."""
    return _CODES.get(word.strip().casefold(), "")


def other_side(side: str) -> str:
    """Return right for left and left for right."""
    return RIGHT if side == LEFT else LEFT


def sides_of(cohort: Cohort) -> dict[str, str]:
    """Return the side of each subject that has one in the column ``side``: left or right.

    Raises
    ------
    InputError
        If the column is left or right for some subjects, and has another value for others.
    """
    values = {subject.name: column_of(subject.columns, SIDE_COLUMN) for subject in cohort.subjects}
    sides = {name: side for name, value in values.items() if (side := side_of_word(value))}
    if odd := [name for name, value in values.items() if sides and value and name not in sides]:
        raise InputError(f"{odd[0]}: its side is {values[odd[0]]!r}; write left or right, or leave it empty")
    return sides
