"""Progress and cancelling: one callback, called often by everything that takes long."""

from collections.abc import Callable

__all__ = ["Tick", "no_tick", "part_of"]

Tick = Callable[[float, str], None]
"""``tick(fraction, message)``: fraction of this piece of work done, in [0, 1], and what is being done.

A tick raises `homolog.errors.Cancelled` to stop the work at once. Long functions call it at least every
0.2 s, from the thread they were called in."""


def no_tick(fraction: float, message: str) -> None:
    """Ignore progress and never cancel."""


def part_of(tick: Tick, start: float, stop: float) -> Tick:
    """Map the fractions of a piece of work onto [start, stop] of a larger one."""

    def inner(fraction: float, message: str) -> None:
        tick(start + (stop - start) * fraction, message)

    return inner
