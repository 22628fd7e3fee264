"""How much memory there is, so that what can't fit is refused before it is begun."""

import ctypes
import gc
import sys
from typing import Protocol, TypeVar

import numpy as np
import psutil
from numpy.typing import NDArray

from homolog.errors import InputError

__all__ = ["Store", "check_fits", "free_memory", "in_memory", "resident_memory", "return_freed_memory"]

_Item = TypeVar("_Item", bound=np.generic)


class Store(Protocol):
    """Where the arrays of shapes lie while they are used: in memory, or in files mapped into it."""

    def __call__(self, array: NDArray[_Item], /) -> NDArray[_Item]:
        """Return an array of the same values that is used in place of the given one."""
        ...


def in_memory(array: NDArray[_Item], /) -> NDArray[_Item]:
    """Return the array itself."""
    return array


def resident_memory() -> int:
    """Return how much memory this process takes, mapped files included [bytes]."""
    return int(psutil.Process().memory_info().rss)


def free_memory() -> int:
    """Return how much memory this machine can still give [bytes]."""
    return int(psutil.virtual_memory().available)


def return_freed_memory() -> None:
    """Return to the system what this process has freed, which the C library of Linux keeps otherwise."""
    gc.collect()
    if sys.platform == "linux":
        library = ctypes.CDLL(None)
        if hasattr(library, "malloc_trim"):  # of glibc
            library.malloc_trim(0)


def check_fits(what: object, needed: float, remedy: str) -> None:
    """Refuse what would need more memory than is free.

    Parameters
    ----------
    what : object
        File or subject, for the message.
    needed : float
        Memory that it will take [bytes].
    remedy : str
        What the user can do about it.

    Raises
    ------
    InputError
        Naming both numbers in GB (10⁹ bytes).
    """
    free = free_memory()
    if needed > free:
        raise InputError(
            f"{what}: needs {_gigabytes(needed)} of memory, but only {_gigabytes(free)} are free; {remedy}"
        )


def _gigabytes(count: float) -> str:
    return f"{count / 1e9:,.0f} GB" if count > 1e11 else f"{count / 1e9:.3g} GB"
