"""Pausing and cancelling: wished for from any thread, obeyed by the one that works."""

import threading
from collections.abc import Callable

from homolog.errors import Cancelled

__all__ = ["Reins"]


class Reins:
    """What those who watch a piece of work want of it."""

    def __init__(self) -> None:
        self._wishes = threading.Condition()
        self._cancelled = False
        self._paused = False

    def cancel(self) -> None:
        """Ask the work to end; may be called often and at any time."""
        with self._wishes:
            self._cancelled = True
            self._wishes.notify_all()

    def set_paused(self, paused: bool) -> None:
        """Ask the work to wait, or to go on."""
        with self._wishes:
            self._paused = paused
            self._wishes.notify_all()

    def obey(self, say_waiting: Callable[[], None]) -> bool:
        """Wait as long as that is wished for, having said so first; called by the one that works.

        Returns
        -------
        bool
            Whether it waited.

        Raises
        ------
        Cancelled
            If the work is to end.
        """
        waits = self._paused and not self._cancelled
        if waits:
            say_waiting()
            with self._wishes:
                self._wishes.wait_for(lambda: self._cancelled or not self._paused)
        if self._cancelled:
            raise Cancelled("cancelled")
        return waits
