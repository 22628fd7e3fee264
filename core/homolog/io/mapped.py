"""Arrays in memory-mapped files, for data that exceed the memory."""

import mmap
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from homolog.io.atomic import report_os_errors
from homolog.memory import Store, in_memory, resident_memory

__all__ = ["MappedArrays", "mapped_within"]

_Item = TypeVar("_Item", bound=np.generic)

_BLOCK = 64 * 2**20
"""Smallest file [bytes]; a file for each array would be too many open files."""
_LINE = 64
"""Arrays begin at multiples of it [bytes]."""
_INTERVAL_S = 0.02
"""Interval between checks of the memory in use."""


class MappedArrays:
    """A `Store` that copies arrays to unnamed files, mapped into memory.

    Used pages count as memory of the process. A thread releases them while the process exceeds the
    budget; they are read again from the file, or the system's cache, on access. The files
    are removed when the process ends.

    Parameters
    ----------
    folder : Path
        Folder on the disk to use.
    budget : int
        Largest memory of the process [bytes].
    """

    def __init__(self, folder: Path, budget: int) -> None:
        self._folder, self._budget = folder, budget
        self._blocks: list[mmap.mmap] = []
        self._used = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="memory", daemon=True)
        self._thread.start()

    @property
    def nbytes(self) -> int:
        """Size of the files [bytes]."""
        return sum(len(block) for block in self._blocks)

    def __call__(self, array: NDArray[_Item], /) -> NDArray[_Item]:
        """Return a writable copy of an array in a file.

        Raises
        ------
        InputError
            If the disk is full.
        """
        size = -(-array.nbytes // _LINE) * _LINE
        if not self._blocks or self._used + size > len(self._blocks[-1]):
            self._add_block(max(size, _BLOCK))
        place = np.frombuffer(self._blocks[-1], array.dtype, array.size, self._used).reshape(array.shape)
        place[...] = array
        self._used += size
        return place

    def release_pages(self) -> None:
        """Release all mapped pages; they are read again on access."""
        if hasattr(mmap, "MADV_DONTNEED"):  # Windows releases pages of mapped files itself
            for block in list(self._blocks):
                block.madvise(mmap.MADV_DONTNEED)

    def close(self) -> None:
        """Stop the thread; files are removed with their last array."""
        self._stopped.set()
        self._thread.join()

    def _add_block(self, size: int) -> None:
        with report_os_errors(self._folder), tempfile.TemporaryFile(dir=self._folder) as file:
            zeros = bytes(_BLOCK)
            for first in range(0, size, _BLOCK):  # allocates the space, so that a full disk is reported here
                file.write(zeros[: size - first])
            file.flush()
            self._blocks.append(mmap.mmap(file.fileno(), size))
            self._used = 0

    def _watch(self) -> None:
        while not self._stopped.wait(_INTERVAL_S):
            if self._blocks and resident_memory() > self._budget:
                self.release_pages()


@contextmanager
def mapped_within(folder: Path, budget: float | None) -> Iterator[Store]:
    """Yield the store of a run: files in a folder if there is a budget [GB of 10⁹ bytes], else memory."""
    if budget is None:
        yield in_memory
        return
    arrays = MappedArrays(folder, int(1e9 * budget))
    try:
        yield arrays
    finally:
        arrays.close()
