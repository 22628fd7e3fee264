"""Covariates of controls as columns of a design, with the same coding for patients."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.statistics.design import covariate_columns, is_missing, numbers

__all__ = ["Coding"]


@dataclass(frozen=True, slots=True, eq=False)
class Coding:
    """Coding of covariates as standardised columns.

    Attributes
    ----------
    names : tuple of str
        The covariates.
    levels : tuple of tuples of str
        Categories of each covariate, of which the first has no column; empty for numbers.
    ranges : tuple of pairs of float
        Lowest and highest value among the controls; (0, 0) for categories.
    means, scales : (c,) array
        Means and standard deviations of the columns.
    """

    names: tuple[str, ...]
    levels: tuple[tuple[str, ...], ...]
    ranges: tuple[tuple[float, float], ...]
    means: FloatArray
    scales: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("means", "scales"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @classmethod
    def of(cls, table: Mapping[str, Sequence[str]], subjects: Sequence[str]) -> "tuple[Coding, FloatArray]":
        """Return the coding of a table's covariates, and the controls' columns (M, c).

        Raises
        ------
        InputError
            If a value is missing or a word among numbers, or all values are equal.
        """
        if not table:
            return cls((), (), (), np.zeros(0), np.ones(0)), np.zeros((len(subjects), 0))
        levels: list[tuple[str, ...]] = []
        ranges: list[tuple[float, float]] = []
        blocks = []
        for name, cells in table.items():
            covariate_columns({name: cells}, subjects)  # refuses missing, mixed and constant values
            values = numbers(cells)
            if values is None:
                spelled = [str(cell).strip() for cell in cells]
                own = tuple(sorted(set(spelled)))
                blocks.append(
                    np.array([[cell == level for level in own[1:]] for cell in spelled], np.float64)
                )
                levels.append(own)
                ranges.append((0.0, 0.0))
            else:
                blocks.append(np.asarray(values)[:, None])
                levels.append(())
                ranges.append((float(np.min(values)), float(np.max(values))))
        joined = np.hstack(blocks)
        means, scales = joined.mean(axis=0), joined.std(axis=0)
        coding = cls(tuple(table), tuple(levels), tuple(ranges), means, scales)
        return coding, (joined - means) / scales

    def columns(self, values: Mapping[str, str]) -> tuple[FloatArray, list[str]]:
        """Return a patient's columns (c,), and remarks on values outside the controls' range.

        Categories may be abbreviated unambiguously: ``f`` for ``female``.

        Raises
        ------
        InputError
            If a value is missing or of an unknown category.
        """
        parts: list[float] = []
        remarks = []
        for name, levels, (low, high) in zip(self.names, self.levels, self.ranges, strict=True):
            text = values.get(name, "").strip()
            if is_missing(text):
                raise InputError(f"the reference is adjusted for {name}: give this patient's value")
            if levels:
                level = _level(name, text, levels)
                parts += [float(level == item) for item in levels[1:]]
                continue
            try:
                value = float(text)
            except ValueError as error:
                raise InputError(
                    f"{name} {text!r}: is not a number; the reference has {low:g} to {high:g}"
                ) from error
            if not np.isfinite(value):
                raise InputError(f"{name} {text!r}: is not a number; the reference has {low:g} to {high:g}")
            if not low <= value <= high:
                remarks.append(
                    f"{name} {value:g} is outside the controls' range ({low:g} to {high:g}): the "
                    "expected shape is extrapolated"
                )
            parts.append(value)
        return (np.array(parts) - self.means) / self.scales, remarks

    @property
    def record(self) -> dict[str, Any]:
        """Return the coding as a record for JSON."""
        return {
            "names": list(self.names),
            "levels": [list(item) for item in self.levels],
            "ranges": [list(item) for item in self.ranges],
            "means": self.means.tolist(),
            "scales": self.scales.tolist(),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "Coding":
        """Return the coding of a `record`."""
        return cls(
            tuple(map(str, record["names"])),
            tuple(tuple(map(str, item)) for item in record["levels"]),
            tuple((float(low), float(high)) for low, high in record["ranges"]),
            np.array(record["means"], np.float64),
            np.array(record["scales"], np.float64),
        )


def _level(name: str, text: str, levels: Sequence[str]) -> str:
    exact = [level for level in levels if level.casefold() == text.casefold()]
    alike = exact or [level for level in levels if level.casefold().startswith(text.casefold())]
    if len(alike) != 1:
        raise InputError(f"{name} {text!r}: must be one of {', '.join(levels)}, as among the controls")
    return alike[0]
