"""Signals of the system, handled for a while."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["handling"]


@contextmanager
def handling(number: int, handle: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Let a function answer a signal within the block; to be used in the main thread."""
    before = signal.signal(number, handle)
    try:
        yield
    finally:
        signal.signal(number, before)
