"""Columns of a cohort's table and the size of its shapes, by subject."""

from collections.abc import Sequence

import numpy as np

from homolog.analysis.design import is_missing
from homolog.analysis.procrustes import Alignment, rms_radii
from homolog.arrays import FloatArray
from homolog.cohort.column_types import CATEGORY
from homolog.errors import InputError
from homolog.files.results import Result

__all__ = ["SHAPE_SIZE", "SIZE", "column_of", "columns_of", "compared_shapes", "levels"]

SIZE = "size"
SHAPE_SIZE = "shape-size"


def levels(values: Sequence[str]) -> list[str]:
    """Return the different values in the order in which they appear, missing ones left out."""
    return [value for value in dict.fromkeys(values) if not is_missing(value)]


def column_of(result: Result, column: str) -> list[str]:
    """Return a column of the cohort's table for each subject, missing values as empty text.

    ``group`` and ``shape-size`` are always there; so is ``size``, unless the table has such a column.

    Raises
    ------
    InputError
        If there is no such column.
    """
    known = columns_of(result)
    if column not in known and f"{column}{CATEGORY}" in known:
        column = f"{column}{CATEGORY}"  # the table declares it
    if column == "group":
        values = [group or "" for group in result.groups]
    elif column == SHAPE_SIZE or (column == SIZE and SIZE not in known):
        return [repr(float(size)) for size in rms_radii(_at_own_size(result))]
    elif column in known:
        values = [columns.get(column, "") for columns in result.columns]
    else:
        there = ", ".join(["group", SHAPE_SIZE, *sorted(known)])
        raise InputError(f"no column {column!r}; the cohort has: {there}")
    return ["" if is_missing(value) else value for value in values]


def compared_shapes(result: Result, alignment: Alignment) -> FloatArray:
    """Return the particles (M, N, 3) that are compared [mm], before they are aligned.

    For every alignment but "as it lies" each shape has its own size, also if the run brought all to one.
    """
    return result.world if alignment is Alignment.AS_IT_LIES else _at_own_size(result)


def _at_own_size(result: Result) -> FloatArray:
    scale = np.cbrt(np.abs(np.linalg.det(result.alignments[:, :3, :3])))
    if np.allclose(scale, 1.0, rtol=1e-9):
        return result.world
    centre = result.world.mean(axis=1, keepdims=True)
    return np.asarray(centre + (result.world - centre) / scale[:, None, None], np.float64)


def columns_of(result: Result) -> set[str]:
    """Return the names of the columns of a result's table."""
    return {name for columns in result.columns for name in columns}
