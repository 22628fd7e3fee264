"""Array types and the read-only rule: arrays that are passed between packages can't be written to."""

from collections.abc import Iterable, Mapping
from html import escape
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Array",
    "ArrayLike",
    "BoolArray",
    "DeviceArray",
    "Float32Array",
    "FloatArray",
    "IntArray",
    "data_frame",
    "frozen",
    "html_of",
]

Array = NDArray[Any]
FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
DeviceArray = Any
"""A `wp.array`, without the type of its elements."""


def frozen(array: Array, dtype: Any = None) -> Array:  # noqa: ANN401 - anything that numpy accepts as a dtype
    """Return a contiguous, read-only array with the given values.

    Parameters
    ----------
    array : array_like
        Array of any shape. The caller's array stays writable: a view or copy is frozen.
    dtype : dtype, optional
        Type of the result; the array's own by default.

    Returns
    -------
    array
        Read-only array of the same shape.
    """
    result = np.ascontiguousarray(array, dtype=dtype).view()
    result.setflags(write=False)
    return result


def data_frame(columns: Mapping[str, Any], rows: Iterable[object], title: str) -> Any:  # noqa: ANN401 - pandas
    """Return a pandas DataFrame of columns, whose rows are named below a title; pandas is imported then."""
    pandas = import_module("pandas")
    return pandas.DataFrame(dict(columns), index=pandas.Index(list(rows), name=title))


def html_of(title: str, table: Any, lines: Iterable[str] = ()) -> str:  # noqa: ANN401 - pandas
    """Return what a notebook shows: a title, the first and last rows of a DataFrame, and lines below."""
    below = "".join(f"<li>{escape(line)}</li>" for line in lines)
    rows = table.to_html(max_rows=10, max_cols=12, float_format="{:.4g}".format, border=0)
    return f"<p><b>{escape(title)}</b></p>{rows}{f'<ul>{below}</ul>' if below else ''}"
