"""Progress and cancellation by one callback, which all long computations call often."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TypeVar

from homolog.errors import InputError
from homolog.threads import MOST_THREADS

__all__ = [
    "LatestTick",
    "Tick",
    "each_in_threads",
    "no_tick",
    "part_of",
    "run_in_background",
    "run_in_threads",
    "tick_of",
]

Tick = Callable[[float, str], None]
"""``tick(fraction, message)``: completed fraction of the work in [0, 1], and the current step.

A tick raises `homolog.errors.Cancelled` to stop the work at once. Long functions call it at least every
0.2 s, from the thread they were called in."""

_TICK_INTERVAL_S = 0.05

_Result = TypeVar("_Result")


def no_tick(fraction: float, message: str) -> None:
    """Ignore progress and never cancel."""


def tick_of(callback: Callable[[float, str], object] | None) -> Tick:
    """Return a tick that calls a user's function; without one, a tick that does nothing."""
    if callback is None:
        return no_tick
    if not callable(callback):
        raise InputError(f"callback: give a function of a fraction and a message, not {callback!r}")

    def tick(fraction: float, message: str) -> None:
        callback(fraction, message)

    return tick


class LatestTick:
    """A tick that can be repeated, by what only looks whether the user has cancelled.

    Parameters
    ----------
    tick : Tick
    message : str
        Message of a repetition before the first call.
    """

    def __init__(self, tick: Tick, message: str) -> None:
        self._tick, self._latest = tick, (0.0, message)

    def __call__(self, fraction: float, message: str) -> None:
        """Tick, and remember it."""
        self._latest = fraction, message
        self._tick(fraction, message)

    def repeat(self) -> None:
        """Tick as in the latest call."""
        self._tick(*self._latest)


def part_of(tick: Tick, start: float, stop: float) -> Tick:
    """Map the fractions of a piece of work onto [start, stop] of a larger one.

    Parameters
    ----------
    tick : Tick
        Of the whole.
    start, stop : float
        Where the piece begins and ends in it, in [0, 1].

    Returns
    -------
    Tick
        For the piece.
    """

    def inner(fraction: float, message: str) -> None:
        tick(start + (stop - start) * fraction, message)

    return inner


def run_in_background(work: Callable[[Tick], _Result], tick: Tick, message: str) -> _Result:
    """Run a function that can't tick often in a background thread, while this thread ticks.

    Parameters
    ----------
    work : callable
        Takes its own tick. It must not change shared state: after cancellation it runs on in the background
        until its next tick or its end.
    tick : Tick
        Called every 0.05 s, and at the end, with the newest progress of the work.
    message : str
        Message until the work reports its own.
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
            done = bool(wait([future], _TICK_INTERVAL_S).done)
            tick(*newest)
        return future.result()
    except BaseException as error:
        stopped.append(error)
        raise
    finally:
        executor.shutdown(wait=False)


def run_in_threads(
    works: Sequence[Callable[[Tick], _Result]], tick: Tick, message: str, threads: int
) -> list[_Result]:
    """Run independent works on several threads, while this thread ticks; return their results in order.

    Parameters
    ----------
    works, tick, message, threads
        As of `each_in_threads`.
    """
    results = dict(each_in_threads(works, tick, message, threads))
    return [results[index] for index in range(len(works))]


def each_in_threads(
    works: Sequence[Callable[[Tick], _Result]], tick: Tick, message: str | None, threads: int
) -> Iterator[tuple[int, _Result]]:
    """Run independent works on several threads, while this thread ticks, and yield results as they come.

    Parameters
    ----------
    works : sequence of callable
        Each takes its own tick, and should call it often: after cancellation it runs until then. Works must
        not change shared state.
    tick : Tick
        Called every 0.05 s, and at the end, with the mean of the fractions of all works.
    message : str or None
        None passes the newest message of the works on.
    threads : int
        At most `MOST_THREADS` are used.

    Yields
    ------
    tuple of int and object
        Index and result of a work.
    """
    stopped: list[BaseException] = []
    fractions, newest = [0.0] * len(works), ""

    def started(index: int) -> _Result:
        def inner(fraction: float, message: str) -> None:
            nonlocal newest
            fractions[index], newest = fraction, message
            if stopped:
                raise stopped[0]

        return works[index](inner)

    executor = ThreadPoolExecutor(min(threads, MOST_THREADS))
    try:
        running = {executor.submit(started, index): index for index in range(len(works))}
        while running:
            done = wait(running, _TICK_INTERVAL_S, FIRST_EXCEPTION).done
            for future in sorted(done, key=running.__getitem__):
                index = running.pop(future)
                fractions[index] = 1.0
                yield index, future.result()
            tick(sum(fractions) / len(fractions), newest if message is None else message)
    except BaseException as error:
        stopped.append(error)
        raise
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
