"""Available memory, to refuse data that do not fit in advance."""

import ctypes
import gc
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol, TypeVar, overload

import numpy as np
import psutil
from numpy.typing import NDArray

from homolog.errors import InputError

__all__ = [
    "OnDemand",
    "Store",
    "check_fits",
    "free_memory",
    "in_memory",
    "large_arrays_apart",
    "resident_memory",
    "return_freed_memory",
]

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h
_LARGE, _LARGEST, _RETAINED = 2**21, 2**25, 2**26
"""Least size of arrays that are mapped alone in a run, and glibc's largest value of it; free memory that is
kept for smaller ones [bytes]."""

_GROUPS = Path("/proc/self/cgroup")
_GROUP_FILES = {
    "": (Path("/sys/fs/cgroup"), "memory.max", "memory.current", "inactive_file"),
    "memory": (
        Path("/sys/fs/cgroup/memory"),
        "memory.limit_in_bytes",
        "memory.usage_in_bytes",
        "total_inactive_file",
    ),
}
"""Of each version of control groups: its folder, limit and use of memory, and what the system can free."""

_Item = TypeVar("_Item", bound=np.generic)
_Any = TypeVar("_Any")


class OnDemand(Sequence[_Any]):
    """A lazy sequence, whose items are computed or read on each access.

    Parameters
    ----------
    count : int
    make : callable
        Function of an index from 0 that returns the item.
    """

    def __init__(self, count: int, make: Callable[[int], _Any]) -> None:
        self._count, self._make = count, make

    def __len__(self) -> int:
        """Return the number of items."""
        return self._count

    @overload
    def __getitem__(self, index: int) -> _Any: ...

    @overload
    def __getitem__(self, index: slice) -> "OnDemand[_Any]": ...

    def __getitem__(self, index: int | slice) -> "_Any | OnDemand[_Any]":
        """Return an item, or a lazy sequence of some items."""
        chosen = range(self._count)[index]
        if isinstance(chosen, int):
            return self._make(chosen)
        return OnDemand(len(chosen), lambda place: self._make(chosen[place]))


class Store(Protocol):
    """Storage of the arrays of shapes: in memory, or in memory-mapped files."""

    def __call__(self, array: NDArray[_Item], /) -> NDArray[_Item]:
        """Return a copy of an array in the store."""
        ...


def in_memory(array: NDArray[_Item], /) -> NDArray[_Item]:
    """Return the array itself."""
    return array


def resident_memory() -> int:
    """Return the resident memory of this process, including mapped files [bytes]."""
    return int(psutil.Process().memory_info().rss)


def free_memory() -> int:
    """Return the memory that this process can still take, of the machine and within its limits [bytes].

    Limits are those of the process (``ulimit -v``) and, on Linux, of its control groups (containers, Slurm).
    """
    free = [psutil.virtual_memory().available, *_free_in_groups()]
    if hasattr(psutil, "RLIMIT_AS"):
        process = psutil.Process()
        limit = process.rlimit(psutil.RLIMIT_AS)[0]
        free += [limit - process.memory_info().vms] if limit != psutil.RLIM_INFINITY else []
    return max(0, int(min(free)))


def _free_in_groups() -> Iterator[int]:
    """Yield what is free in each control group of the process that has a limit, of versions 1 and 2."""
    if not _GROUPS.exists():  # not Linux
        return
    for line in _GROUPS.read_text().splitlines():
        _, kinds, own = line.split(":", 2)
        if kinds in _GROUP_FILES:
            top, limit, use, cached = _GROUP_FILES[kinds]
            inner = top / own.lstrip("/")
            for folder in [inner, *inner.parents][: -len(top.parents)]:
                with suppress(OSError, ValueError):  # hidden by a container, or without a limit ("max")
                    most, used = (int((folder / name).read_text()) for name in (limit, use))
                    fields = (folder / "memory.stat").read_text().split()
                    yield most - used + int(fields[fields.index(cached) + 1])


@contextmanager
def large_arrays_apart() -> Iterator[None]:
    """Let freed large arrays return to the system at once in a block, also with the C library of Linux.

    It raises the size from which it does so with each array that is freed, up to 32 MB; smaller ones then
    leave gaps, of up to 20 % of the memory of a run. Elsewhere arrays are faster if memory is kept.
    """
    _map_from(_LARGE)
    try:
        yield
    finally:
        _map_from(_LARGEST)


def _map_from(size: int) -> None:
    if sys.platform == "linux":
        library = ctypes.CDLL(None)
        if hasattr(library, "mallopt"):  # glibc
            library.mallopt(_M_TRIM_THRESHOLD, _RETAINED)
            library.mallopt(_M_MMAP_THRESHOLD, size)


def return_freed_memory() -> None:
    """Return freed memory to the system, which the C library of Linux would retain.

    Garbage is collected first, unless automatic collection is disabled, as in the window: VTK's objects may
    be freed in the window's thread only, and this function runs in the computing thread.
    """
    if gc.isenabled():
        gc.collect()
    if sys.platform == "linux":
        library = ctypes.CDLL(None)
        if hasattr(library, "malloc_trim"):  # glibc
            library.malloc_trim(0)


def check_fits(what: object, needed: float, remedy: str) -> None:
    """Raise InputError if more memory is needed than is free.

    Parameters
    ----------
    what : object
        The file or subject, for the message.
    needed : float
        Required memory [bytes].
    remedy : str
        Remedy for the message.

    Raises
    ------
    InputError
        With both numbers in GB (10⁹ bytes).
    """
    free = free_memory()
    if needed > free:
        raise InputError(
            f"{what}: needs {_gigabytes(needed)} of memory, but only {_gigabytes(free)} are free; {remedy}"
        )


def _gigabytes(count: float) -> str:
    return f"{count / 1e9:,.0f} GB" if count > 1e11 else f"{count / 1e9:.3g} GB"
