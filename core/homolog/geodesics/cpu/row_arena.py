"""An arena for the blocks of a table until all are solved."""

import mmap

import numpy as np

from homolog.arrays import Array
from homolog.geodesics.kernels.lookup import LANES

__all__ = ["RowArena"]

_ROWS_PER_CHUNK = 1 << 17
"""Rows allocated at once: 4 MB."""


class RowArena:
    """Holds copies of rows in memory-mapped chunks, which return to the system as soon as they are unused.

    Memory of small arrays would stay with the process: joining the blocks would take twice their size.
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
