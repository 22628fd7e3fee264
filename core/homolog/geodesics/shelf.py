"""Where the blocks of a table are kept until all are solved."""

import mmap

import numpy as np

from homolog.arrays import Array
from homolog.geodesics.lookup import LANES

__all__ = ["Shelf"]

_PIECE = 1 << 17
"""Rows that room is made for at once: 4 MB."""


class Shelf:
    """Keeps copies of rows of codes; their memory goes back to the system once nobody has them any more.

    That of small arrays stays with the process: a table would take its size twice where it is put together.
    """

    def __init__(self) -> None:
        self._piece: Array = np.empty((0, LANES), np.uint16)
        self._used = 0

    def keep(self, rows: Array) -> Array:
        """Return a copy of rows (n, LANES)."""
        if self._used + len(rows) > len(self._piece):
            count = max(_PIECE, len(rows))
            memory = mmap.mmap(-1, count * LANES * rows.itemsize)
            self._piece = np.frombuffer(memory, np.uint16).reshape(count, LANES)
            self._used = 0
        kept = self._piece[self._used : self._used + len(rows)]
        kept[:] = rows
        self._used += len(rows)
        return kept
