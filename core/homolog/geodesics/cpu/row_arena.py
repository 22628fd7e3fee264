"""Memory for the blocks of a table until all are solved."""

import mmap

import numpy as np

from homolog.arrays import Array
from homolog.geodesics.kernels.lookup import LANES

__all__ = ["RowArena"]

_ROWS_PER_CHUNK = 1 << 17
"""Rows allocated at once: 4 MB."""


class RowArena:
    """Stores copies of rows in memory-mapped chunks, each freed as soon as no copy in it is used.

    Memory of small arrays would not be freed while the blocks are joined, which would take twice the memory.
    """

    def __init__(self) -> None:
        self._chunk: Array = np.empty((0, LANES), np.uint16)
        self._used = 0

    def copy_in(self, rows: Array) -> Array:
        """Return a copy of rows (n, LANES)."""
        if self._used + len(rows) > len(self._chunk):
            count = max(_ROWS_PER_CHUNK, len(rows))
            memory = mmap.mmap(-1, count * LANES * rows.itemsize)
            self._chunk = np.frombuffer(memory, np.uint16).reshape(count, LANES)
            self._used = 0
        kept = self._chunk[self._used : self._used + len(rows)]
        kept[:] = rows
        self._used += len(rows)
        return kept
