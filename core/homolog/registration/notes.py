"""Notes on registered subjects: unusual sizes and shapes, and rotations to be checked."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray

__all__ = ["MIN_SUBJECTS", "OTHER_SIZE", "Findings", "notes_on"]

OTHER_SIZE, _RARE_SIZE = 5.0, 2.2
"""Limits of size ratios: a size off by a factor such as ten, and one rare for one structure."""
MIN_SUBJECTS = 3  # fewer subjects do not show which of them is unusual
_TURNED = 45.0
"""Least rotation that gets a note [degrees]: half of the least turn between files of different axes."""
_KEPT = (
    "these shapes are nearly round or symmetric, so the files' rotations were kept; if files are rotated "
    "against each other, rotate them to one orientation first"
)


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What the registration of M subjects found.

    Attributes
    ----------
    sizes, distances, angles : (M,) arrays
        Sizes [mm], distances from the most typical subject relative to the size, and rotations relative to
        most others [degrees].
    odd : collection of int
        Indices of subjects that do not look like the others.
    unclear : mapping of int to float
        Further rotations [degrees] after which subjects fit the others about as well, by index.
    """

    sizes: FloatArray
    distances: FloatArray
    angles: FloatArray
    odd: Collection[int]
    unclear: Mapping[int, float]

    @property
    def differ(self) -> bool:
        """Whether at least half of the subjects were rotated far, so that the files' orientations differ."""
        return bool(2 * np.count_nonzero(self.angles > _TURNED) >= len(self.angles))

    @property
    def symmetric(self) -> bool:
        """Whether at least half of the subjects fit about as well after a further rotation."""
        return 2 * len(self.unclear) >= len(self.angles)


def notes_on(findings: Findings) -> tuple[str | None, ...]:
    """Return a note on each subject, or None."""
    if len(findings.sizes) < MIN_SUBJECTS:
        return (None,) * len(findings.sizes)
    ratios = findings.sizes / np.median(findings.sizes)
    return tuple(_note(findings, index, ratio) for index, ratio in enumerate(ratios.tolist()))


def _note(findings: Findings, index: int, ratio: float) -> str | None:
    """Return the note on a subject with its size relative to the usual one."""
    angle = float(findings.angles[index])
    if not 1.0 / OTHER_SIZE < ratio < OTHER_SIZE:
        return f"{_unusual_size(ratio, digits=0)}; check that its unit is mm"
    if index in findings.odd:
        distance, usual = 100.0 * findings.distances[index], 100.0 * np.median(findings.distances)
        return (
            f"does not look like the others: {distance:.0f} % of its size away from the most "
            f"typical subject, usually {usual:.0f} %; check that it shows the same structure"
        )
    if findings.symmetric and angle <= _TURNED:  # a clear one, too: those that explain it may lie otherwise
        return _KEPT
    if index in findings.unclear:
        return (
            f"its rotation is uncertain: after a further rotation by {findings.unclear[index]:.0f}° it fits "
            "the others about as well; check it, or give all files one orientation"
        )
    if findings.differ:
        return "the files have different orientations; each shape was rotated to match the others: check it"
    if np.median(findings.angles) < _TURNED < angle:
        return f"was rotated by {angle:.0f}° to match most others; check it and its side"
    if not 1.0 / _RARE_SIZE < ratio < _RARE_SIZE:
        return f"{_unusual_size(ratio, digits=1)}; check that it shows the same structure"
    return None


def _unusual_size(ratio: float, *, digits: int) -> str:
    times, word = (ratio, "large") if ratio > 1.0 else (1.0 / ratio, "small")
    return f"is {times:.{digits}f} times as {word} as most others"
