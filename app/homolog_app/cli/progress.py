"""Progress of a command (a bar with the time left, JSON lines or nothing) and what ends it early."""

import argparse
import json
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TextIO

__all__ = ["Progress", "add_progress_option", "handling", "remaining_seconds", "show_progress"]


_WIDTH = 28
_REDRAW_S = 0.1
_LINE_S = 10.0


def add_progress_option(parser: argparse.ArgumentParser) -> None:
    """Declare ``--progress``."""
    parser.add_argument(
        "--progress",
        choices=["bar", "json", "none"],
        default="bar",
        help="bar (default), json (one object per line on standard output) or none",
    )


def remaining_seconds(fraction: float, elapsed: float) -> float | None:
    """Seconds left if the work goes on as fast as so far; None while that can't be told."""
    return elapsed * (1.0 - fraction) / fraction if fraction > 0.01 and elapsed > 1.0 else None


class Progress:
    """Where progress goes. Its `tick` can be handed to whatever takes a `homolog.progress.Tick`."""

    def __init__(self, mode: str, stream: TextIO) -> None:
        self._mode = mode
        self._stream = stream
        self._moves = mode == "bar" and stream.isatty()
        self._started = time.monotonic()
        self._drawn = 0.0
        self._said: str | None = ""

    def tick(self, fraction: float, message: str) -> None:
        """Show the progress of a piece of work that has no phases."""
        self.show(fraction, message, remaining_seconds(fraction, time.monotonic() - self._started))

    def show(
        self, fraction: float, message: str, eta_s: float | None = None, phase: str | None = None
    ) -> None:
        """Show a fraction of the whole [0, 1], what is being done and the seconds left, where known."""
        now = time.monotonic()
        pause = _LINE_S if self._mode == "bar" and not self._moves else _REDRAW_S
        if self._mode == "none" or (now - self._drawn < pause and phase == self._said and fraction < 1.0):
            return
        self._drawn, self._said = now, phase
        if self._mode == "json":
            eta = None if eta_s is None else round(eta_s, 1)
            record = {"phase": phase, "fraction": round(fraction, 4), "message": message, "eta_s": eta}
            self._stream.write(json.dumps(record) + "\n")
        else:
            named = phase is None or message.startswith(phase)
            line = _line(fraction, message if named else f"{phase}: {message}", eta_s)
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(f"\r\x1b[2K{line[:width]}" if self._moves else f"{line}\n")
        self._stream.flush()

    def close(self) -> None:
        """Wipe the bar."""
        if self._moves:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()


def _line(fraction: float, message: str, eta_s: float | None) -> str:
    done = round(_WIDTH * fraction)
    left = "" if eta_s is None else f" {int(eta_s) // 60}:{int(eta_s) % 60:02d} left"
    return f"[{'#' * done}{'.' * (_WIDTH - done)}] {100 * fraction:3.0f} %{left}  {message}"


@contextmanager
def show_progress(mode: str) -> Iterator[Progress]:
    """Give the `Progress` of a command and tidy up after it.

    JSON lines go to standard output, the bar to standard error (a line every ten seconds where that is
    no terminal).
    """
    progress = Progress(mode, sys.stdout if mode == "json" else sys.stderr)
    try:
        yield progress
    finally:
        progress.close()


@contextmanager
def handling(number: int, handle: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Let a function answer a signal within the block; to be used in the main thread."""
    before = signal.signal(number, handle)
    try:
        yield
    finally:
        signal.signal(number, before)
