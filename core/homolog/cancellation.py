"""Cooperative pause and cancel, requested from any thread."""

import threading
from collections.abc import Callable

from homolog.errors import Cancelled

__all__ = ["CancelToken"]


class CancelToken:
    """Requests to pause or cancel a piece of work."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._cancelled = False
        self._paused = False

    def cancel(self) -> None:
        """Request cancellation; may be called repeatedly, at any time."""
        with self._condition:
            self._cancelled = True
            self._condition.notify_all()

    def set_paused(self, paused: bool) -> None:
        """Request the work to pause or to resume."""
        with self._condition:
            self._paused = paused
            self._condition.notify_all()

    def wait_while_paused(self, on_pause: Callable[[], None]) -> bool:
        """Wait while paused; called by the working thread, which calls `on_pause` before it waits.

        Returns
        -------
        bool
            Whether the work was paused.

        Raises
        ------
        Cancelled
            If cancellation was requested.
        """
        waited = self._paused and not self._cancelled
        if waited:
            on_pause()
            with self._condition:
                self._condition.wait_for(lambda: self._cancelled or not self._paused)
        if self._cancelled:
            raise Cancelled("cancelled")
        return waited
