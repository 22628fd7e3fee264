"""Sides of the body, from a table or the file names."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from homolog.cohort.subject import Cohort, Subject, suffix_of
from homolog.errors import InputError

__all__ = [
    "FROM_COLUMN",
    "FROM_NAMES",
    "LEFT",
    "RIGHT",
    "SIDE_COLUMN",
    "Sides",
    "is_side",
    "other_side",
    "side_of_word",
    "sides_among",
    "sides_of",
]

LEFT, RIGHT = "left", "right"
SIDE_COLUMN = "side"
"""Column of the cohort's table, case-insensitive."""

FROM_COLUMN, FROM_NAMES = f"the column {SIDE_COLUMN}", "the file names"

_Codes = Mapping[str, str]
_CODES: _Codes = {
    **dict.fromkeys(("l", "left", "lt", "lh", "links", "gauche", "izquierda", "sinistra"), LEFT),
    **dict.fromkeys(("r", "right", "rt", "rh", "rechts", "droite", "derecha", "destra"), RIGHT),
}
_PAIRS: tuple[_Codes, ...] = (
    {"li": LEFT, "re": RIGHT},
    {"sin": LEFT, "dex": RIGHT},
    {"sin": LEFT, "dx": RIGHT},
    {"sx": LEFT, "dx": RIGHT},
    {"os": LEFT, "od": RIGHT},  # eyes
)
"""Ambiguous abbreviations: in names they count only if both of a pair occur."""
_ANY: _Codes = {code: side for pair in (*_PAIRS, _CODES) for code, side in pair.items()}
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""Runs of letters, separated before capitals: ``leftFemur``, ``m03_L``, ``12R``."""


@dataclass(frozen=True, slots=True)
class Sides:
    """The subjects' sides.

    Attributes
    ----------
    of : dict of str to str
        ``"left"`` or ``"right"`` by subject, without subjects of unknown side.
    source : str
        `FROM_COLUMN`, `FROM_NAMES`, or empty if no side is known.
    """

    of: dict[str, str]
    source: str = ""


def is_side(word: str) -> bool:
    """Return whether a word means, or may mean, left or right."""
    return word.casefold() in _ANY


def side_of_word(word: str) -> str:
    """Return the side that a word denotes, left or right; otherwise an empty text."""
    return _ANY.get(word.strip().casefold(), "")


def sides_among(names: Sequence[str]) -> dict[str, str]:
    """Return the side in each name, if nothing else differs: ``femur_L`` and ``femur_R``."""
    return next((sides for codes in (_CODES, *_PAIRS) if (sides := _among(names, codes))), {})


def _among(names: Sequence[str], codes: _Codes) -> dict[str, str]:
    word_lists = {name: re.findall(r"[^\W_]+", name) for name in names}
    sides = {name: [word for word in parts if word.casefold() in codes] for name, parts in word_lists.items()}
    others = {
        tuple(word.casefold() for word in parts if word.casefold() not in codes)
        for parts in word_lists.values()
    }
    alike = len(others) == 1 and all(len(item) == 1 for item in sides.values())
    both = codes is _CODES or len({codes[item[0].casefold()] for item in sides.values() if item}) == 2
    return {name: item[0] for name, item in sides.items()} if alike and both else {}


def other_side(side: str) -> str:
    """Return right for left and left for right."""
    return RIGHT if side == LEFT else LEFT


def sides_of(cohort: Cohort) -> Sides:
    """Return the subjects' sides from the column ``side``, otherwise from the file names.

    A column may leave some subjects without a side. File names are used only if each contains a side and both
    sides occur, since single letters are ambiguous.

    Raises
    ------
    InputError
        If the column is left or right for some subjects, and has another value for others.
    """
    values = {subject.name: _column(subject) for subject in cohort.subjects}
    sides = {name: side for name, value in values.items() if (side := _ANY.get(value.casefold()))}
    if sides:
        odd = [name for name, value in values.items() if value and name not in sides]
        if odd:
            raise InputError(
                f"{odd[0]}: its side is {values[odd[0]]!r}; write left or right, or leave it empty"
            )
        return Sides(sides, FROM_COLUMN)
    for codes in (_CODES, *_PAIRS):
        named = {subject.name: side for subject in cohort.subjects if (side := _of_name(subject, codes))}
        if len(named) == len(cohort.subjects) and len(set(named.values())) == 2:
            return Sides(named, FROM_NAMES)
    return Sides({})


def _column(subject: Subject) -> str:
    values = [value for name, value in subject.columns.items() if name.strip().casefold() == SIDE_COLUMN]
    return values[0].strip() if values else ""


def _of_name(subject: Subject, codes: _Codes) -> str | None:
    """Return the side in the file's name, otherwise in the subject's name; None without a unique side."""
    file = subject.path.name
    for text in (file[: len(file) - len(suffix_of(subject.path))], subject.name):
        sides = {side for word in _WORDS.findall(text) if (side := codes.get(word.casefold()))}
        if len(sides) == 1:
            return sides.pop()
    return None
