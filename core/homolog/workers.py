"""Processes that groom subjects side by side, and that can be ended at once."""

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection

__all__ = ["worker_processes"]


@contextmanager
def worker_processes(count: int | None) -> Iterator[Executor]:
    """Give an executor of so many processes; when the block is left they end, whatever they are doing.

    Parameters
    ----------
    count : int or None
        One for each core if None.
    """
    context = get_context("spawn")  # a fork of a process with threads, Warp or a window is not safe
    reader, writer = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(
        count or _cores(), mp_context=context, initializer=_live_with, initargs=(reader,)
    )
    try:
        yield executor
    finally:
        writer.close()
        executor.shutdown(cancel_futures=True)
        reader.close()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _live_with(parent: Connection) -> None:
    """Leave Ctrl-C to the parent, and end with it: the pipe breaks when it closes its end or is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        try:
            parent.recv_bytes()
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
