"""Exceptions, grouped by who can fix the cause, and paths that users give."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

__all__ = [
    "Cancelled",
    "HomologError",
    "InUseError",
    "InputError",
    "NumericalError",
    "WorkerDiedError",
    "is_out_of_memory",
    "listed",
    "path_of",
    "user_message",
]

_NO_MEMORY = (
    "Failed to allocate",
    "out of memory",
    "failed to map segment",
    "Cannot allocate memory",
    "bad_alloc",
)
"""Texts of Warp, CUDA, the loader of libraries, the C library and C++ where there is no memory."""
_NO_THREAD, _NO_KERNEL = "can't start new thread", "kernel build failed"


class HomologError(Exception):
    """Base of all errors that Homolog raises deliberately."""


class InputError(HomologError, ValueError):
    """The user can fix the cause: the message names the subject or file, the fault and the remedy.

    It is also a `ValueError`, which libraries commonly catch.
    """


class InUseError(InputError):
    """Another program has the project open."""


class NumericalError(HomologError, ArithmeticError):
    """A computation failed: the message names the subject and the step. Also an `ArithmeticError`."""


class WorkerDiedError(NumericalError):
    """A worker process died; its subjects can be started again."""


class Cancelled(HomologError):
    """The user cancelled: raised by a callback to stop the work, never shown as an error."""


def user_message(error: BaseException) -> str | None:
    """Return the message for the user, or None if the error is a defect of the program.

    The user can fix system errors that name a file, such as missing permissions, missing packages, and too
    little memory, too few threads, or kernels that can't be compiled.
    """
    if isinstance(error, InputError | NumericalError):
        return str(error)
    if is_out_of_memory(error):
        import psutil

        used = psutil.Process().memory_info()
        return (
            f"too little memory ({error or 'an array'}), while the program takes {used.rss / 1e9:.2g} GB "
            f"({used.vms / 1e9:.2g} GB of addresses); use fewer particles or coarser meshes, free memory, or "
            "raise the limit (ulimit -v)"
        )
    if _NO_THREAD in str(error):
        return (
            "the system refuses another thread; end other programs, or raise the limits of processes and of "
            "memory (ulimit -u, ulimit -v)"
        )
    if _NO_KERNEL in str(error):
        return (
            f"kernels can't be compiled ({error}); set WARP_CACHE_PATH to a folder with free space, and see "
            "homolog doctor"
        )
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check its permissions, or choose another location"
    if isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        if not package.startswith("homolog"):
            return f"the Python package {package} is not installed; install it with: pip install {package}"
    return None


def path_of(value: str | PathLike[str], what: str = "path") -> Path:
    """Return a path that a user gives; raise InputError if it is something else."""
    try:
        return Path(value)
    except TypeError as error:
        raise InputError(f"{what}: give the path of a file or folder, not {type(value).__name__}") from error


def listed(names: Sequence[str], most: int = 5) -> str:
    """Return names for a message, at most some of them with the number of the others."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether memory ran out, by the class or text of the exception or of what caused it."""
    is_it = isinstance(error, MemoryError) or any(text in str(error) for text in _NO_MEMORY)
    return is_it or (error.__cause__ is not None and is_out_of_memory(error.__cause__))
