"""Processes that groom subjects side by side, and that can be ended at once."""

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from multiprocessing.connection import Connection

__all__ = ["worker_processes"]


@contextmanager
def worker_processes(count: int) -> Iterator[Executor]:
    """Give an executor of several processes; when the block is left they end, whatever they are doing."""
    context = get_context("spawn")  # a fork of a process with threads, Warp or a window is not safe
    others = set(active_children())
    reader, writer = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(count, mp_context=context, initializer=_live_with, initargs=(reader,))
    try:
        yield executor
    finally:
        for process in set(active_children()) - others:
            process.terminate()
        executor.shutdown(cancel_futures=True)
        writer.close()
        reader.close()


def _live_with(parent: Connection) -> None:
    """Leave Ctrl-C to the parent, and end with it even if it is killed: the pipe breaks then."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # each process has its core

    def watch() -> None:
        try:
            parent.recv_bytes()
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
