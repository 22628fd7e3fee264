"""What a question is asked of: shapes with their names and columns, of a project or of arrays."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Number
from typing import Self

import numpy as np

from homolog.arrays import Array, ArrayLike, FloatArray
from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.errors import InputError
from homolog.geometry import scale_of
from homolog.io.results import Result
from homolog.statistics.checks import checked_particles
from homolog.statistics.design import is_missing
from homolog.statistics.procrustes import Alignment, rms_radii
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "LOG_SIZE",
    "SHAPE_SIZE",
    "SIZE",
    "Sample",
    "at_own_size",
    "category_of",
    "column_of",
    "levels",
    "matched_rows",
]

SIZE = "size"
SHAPE_SIZE = "shape-size"
LOG_SIZE = "log_size"
"""Column of the natural logarithm of the size in mm, for allometry."""
_Cell = str | float


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The shapes of a cohort and what is known of its subjects.

    Attributes
    ----------
    names : tuple of str
        The M subjects.
    columns : mapping of str to sequences
        A value for each subject, text or number.
    shapes : (M, N, 3) array
        Corresponding points as the shapes lie [mm].
    own_size : (M, N, 3) array
        The same at the shapes' own sizes, even if the run scaled them [mm].
    mean_surface : TriangleMesh or None
        The mean surface, whose area belongs to the particles.
    edge : float
        Median edge of the files' voxels [mm]; 0 if unknown.
    """

    names: tuple[str, ...]
    columns: Mapping[str, Sequence[_Cell]]
    shapes: FloatArray
    own_size: FloatArray
    mean_surface: TriangleMesh | None = None
    edge: float = 0.0

    @classmethod
    def of(cls, result: Result) -> Self:
        """Return the sample of a project's result."""
        known = dict.fromkeys(name for columns in result.columns for name in columns)
        columns = {name: [own.get(name, "") for own in result.columns] for name in known}
        columns["group"] = [group or "" for group in result.groups]
        own = at_own_size(result.world, result.alignments)
        edges = [edge for voxel in result.voxels for edge in voxel]
        edge = float(np.median(edges)) if edges else 0.0
        return cls(result.names, columns, result.world, own, result.mean_surface, edge)

    @classmethod
    def of_arrays(
        cls,
        particles: ArrayLike,
        columns: Mapping[str, Sequence[_Cell | None] | Array],
        names: Sequence[str] | None = None,
    ) -> Self:
        """Return the sample of arrays.

        Raises
        ------
        InputError
            If particles are no shapes, or a column has not one value for each subject.
        """
        shapes = checked_particles(particles, names)
        for title, values in columns.items():
            is_sequence = hasattr(values, "__len__") and not isinstance(values, str)
            if not is_sequence or getattr(values, "ndim", 1) != 1 or any(map(np.ndim, values)):
                raise InputError(f"{title!r}: must be a sequence of values, one for each subject")
            if not all(value is None or isinstance(value, str | Number | np.bool_) for value in values):
                raise InputError(f"{title!r}: must be numbers or texts; give years or months for dates")
            if len(values) != len(shapes):
                raise InputError(
                    f"{title!r}: {len(values)} values for {len(shapes)} subjects; give one for each"
                )
        called = names or [f"subject {number}" for number in range(1, len(shapes) + 1)]
        given = {
            title: ["" if value is None else value for value in values] for title, values in columns.items()
        }
        return cls(tuple(called), given, shapes, shapes)

    def column(self, name: str) -> list[_Cell]:
        """Return a column, missing values as empty text.

        ``shape-size`` always exists; so do ``size`` and ``log_size``, unless the table has such columns.

        Raises
        ------
        InputError
            If there is no such column.
        """
        if name not in self.columns and f"{name}{CATEGORY}" in self.columns:
            name = f"{name}{CATEGORY}"  # as declared by the table
        if name == LOG_SIZE and name not in self.columns:
            return [repr(float(size)) for size in np.log(rms_radii(self.own_size))]
        if name == SHAPE_SIZE or (name == SIZE and SIZE not in self.columns):
            return [repr(float(size)) for size in rms_radii(self.own_size)]
        if name not in self.columns:
            others = sorted(set(self.columns) - {"group"})
            available = ["group"] * ("group" in self.columns) + [SHAPE_SIZE, *others]
            raise InputError(f"no column {name!r}; the cohort has: {', '.join(available)}")
        return ["" if is_missing(value) else value for value in self.columns[name]]

    def texts(self, name: str) -> list[str]:
        """Return a column as texts."""
        return [str(value) for value in self.column(name)]

    def compared(self, alignment: Alignment) -> FloatArray:
        """Return the compared points (M, N, 3) before their alignment [mm]."""
        return self.shapes if alignment is Alignment.AS_IT_LIES else self.own_size


def at_own_size(shapes: FloatArray, alignments: FloatArray) -> FloatArray:
    """Return shapes (M, N, 3) at the sizes that they had before alignments scaled them."""
    scale = scale_of(alignments)
    if np.allclose(scale, 1.0, rtol=1e-9):
        return shapes
    centre = shapes.mean(axis=1, keepdims=True)
    return np.asarray(centre + (shapes - centre) / scale[:, None, None], np.float64)


def column_of(result: Result, column: str) -> list[str]:
    """Return a column of a project's result as texts: see `Sample.column`."""
    return Sample.of(result).texts(column)


def levels(values: Sequence[_Cell]) -> list[str]:
    """Return the distinct values in the order of their first occurrence, without missing ones."""
    return [str(value) for value in dict.fromkeys(values) if not is_missing(value)]


def matched_rows(
    names: Sequence[str], columns: Mapping[str, Sequence[object]], index: Sequence[object] | None = None
) -> list[int]:
    """Return the row of a table for each of the subjects.

    Parameters
    ----------
    names : sequence of str
        The subjects.
    columns : mapping of str to sequences
        The table's columns; ``name`` or ``subject`` may have the subjects' names.
    index : sequence, optional
        Names of the rows.

    Raises
    ------
    InputError
        If neither column nor the index has the subjects' names, or a subject no row or several.
    """
    offered = [("name", columns.get("name")), ("subject", columns.get("subject")), ("the index", index)]
    keys = {where: [str(value).strip() for value in own] for where, own in offered if own is not None}
    where = max(keys, key=lambda item: len(set(names) & set(keys[item])), default="")
    if not where or not set(names) & set(keys[where]):
        raise InputError(
            "data: rows can't be matched to the subjects; add a column 'name' with their names, such as "
            f"{', '.join(names[:3])}"
        )
    counts = Counter(keys[where])
    for name in names:
        if counts[name] != 1:
            own = f"{counts[name]} rows are" if counts[name] else "no row is"
            raise InputError(f"data: by {where}, {own} of {name}; give each subject one row")
    return [keys[where].index(name) for name in names]


def category_of(column: str, known: "Mapping[str, object]") -> tuple[str, bool]:
    """Return a covariate's column, and whether its numbers are declared codes of categories.

    They are declared by the question (``site:c``), or by the name of the table's column.
    """
    if column not in known and f"{column}{CATEGORY}" in known:
        return f"{column}{CATEGORY}", True
    if column not in known and column.endswith(CATEGORY):
        return plain_name(column), True
    return column, column.endswith(CATEGORY)
