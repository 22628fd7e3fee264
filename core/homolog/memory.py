"""How much memory there is, so that what can't fit is refused before it is begun."""

import psutil

from homolog.errors import InputError

__all__ = ["check_fits", "free_memory"]


def free_memory() -> int:
    """Return how much memory this machine can still give [bytes]."""
    return int(psutil.virtual_memory().available)


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
