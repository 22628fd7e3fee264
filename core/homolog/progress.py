"""Progress and cancelling: one callback, called often by everything that takes long."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

__all__ = ["Tick", "no_tick", "part_of", "patiently"]

Tick = Callable[[float, str], None]
"""``tick(fraction, message)``: fraction of this piece of work done, in [0, 1], and what is being done.

A tick raises `homolog.errors.Cancelled` to stop the work at once. Long functions call it at least every
0.2 s, from the thread they were called in."""

_PATIENCE_S = 0.05

_Result = TypeVar("_Result")


def no_tick(fraction: float, message: str) -> None:
    """Ignore progress and never cancel."""


def part_of(tick: Tick, start: float, stop: float) -> Tick:
    """Map the fractions of a piece of work onto [start, stop] of a larger one."""

    def inner(fraction: float, message: str) -> None:
        tick(start + (stop - start) * fraction, message)

    return inner


def patiently(work: Callable[[Tick], _Result], tick: Tick, message: str) -> _Result:
    """Do work that can't tick often enough beside this thread, which ticks meanwhile.

    Parameters
    ----------
    work : callable
        Takes a tick of its own. It must change nothing that others see: if the work is cancelled it is left
        to itself and ends at its next tick, or in its own time.
    tick : Tick
        Called every 0.05 s, and at the end, with what the work said last.
    message : str
        What is being done, until the work says so itself.
    """
    newest = (0.0, message)
    stopped: list[BaseException] = []

    def inner(fraction: float, message: str) -> None:
        nonlocal newest
        newest = (fraction, message)
        if stopped:
            raise stopped[0]

    executor = ThreadPoolExecutor(1)
    try:
        future = executor.submit(work, inner)
        done = False
        while not done:
            done = bool(wait([future], _PATIENCE_S).done)
            tick(*newest)
        return future.result()
    except BaseException as error:
        stopped.append(error)
        raise
    finally:
        executor.shutdown(wait=False)
