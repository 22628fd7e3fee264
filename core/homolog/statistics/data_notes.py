"""Remarks on the data of a comparison, in sentences: excluded subjects, spellings."""

from collections.abc import Mapping, Sequence

from homolog.statistics.design import lookalikes

__all__ = ["PARTNER_MISSING", "exclusion_notes", "spelling_notes"]

PARTNER_MISSING = "the other one of the pair is missing"
"""Reason of an exclusion other than missing values."""


def exclusion_notes(left_out: Mapping[str, str]) -> list[str]:
    """Return sentences on the subjects that complete cases excluded: number, reason, first names."""
    alone = [name for name, why in left_out.items() if why == PARTNER_MISSING]
    incomplete = [name for name in left_out if name not in alone]
    reasons = ((incomplete, "for missing values"), (alone, "because the other one of their pair is missing"))
    return [
        f"{_counted(names)} excluded {reason} (complete cases): {_some(names)}."
        for names, reason in reasons
        if names
    ]


def _counted(names: Sequence[str]) -> str:
    return "1 subject was" if len(names) == 1 else f"{len(names)} subjects were"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", …" if len(names) > 5 else "")


def spelling_notes(title: str, values: Sequence[str]) -> list[str]:
    """Return a note on values of a column that may be spellings of one value."""
    return [
        f"{title} contains {' and '.join(map(repr, alike))}, which were treated as different values."
        for alike in lookalikes(values)
    ]
