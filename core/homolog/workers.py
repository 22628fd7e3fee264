"""Processes that work on single subjects in parallel and can be terminated at any time."""

import atexit
import os
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from multiprocessing.util import get_temp_dir

__all__ = ["main_guard_hint", "worker_processes"]

_THREADS = "OPENBLAS_NUM_THREADS"
_SERVER_FOLDER = "HOMOLOG_SERVER_FOLDER"
_PRELOADED = ["homolog.workers", "homolog.grooming.cohort"]


@contextmanager
def worker_processes(count: int, *, fresh: bool = False) -> Iterator[Executor]:
    """Yield an executor of several processes, which are terminated at the end of the block.

    Parameters
    ----------
    count : int
        Largest number of processes.
    fresh : bool
        Whether to start each as a new program with the current environment, which takes a second or two.

    Yields
    ------
    Executor
    """
    context = get_context("spawn") if fresh else _server() or get_context("spawn")
    others = set(active_children())
    reader, writer = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(count, mp_context=context, initializer=_live_with, initargs=(reader,))
    try:
        yield executor
    finally:
        _terminate(executor, set(active_children()) - others)
        writer.close()
        reader.close()


def _terminate(executor: ProcessPoolExecutor, processes: set[BaseProcess]) -> None:
    """Terminate the processes and shut down the executor, even during the transfer of a result.

    Its thread would wait forever for the rest of the result, since this process also holds the sending end.
    """
    for process in processes:
        process.terminate()
    executor._result_queue._writer.close()  # type: ignore[attr-defined] # noqa: SLF001 - there is no public way
    executor.shutdown(cancel_futures=True)


def main_guard_hint() -> str:
    """Return a hint for user scripts without a main guard, which workers would run again."""
    main = sys.modules.get("__main__")
    is_script = str(getattr(main, "__file__", "")).endswith(".py") and getattr(main, "__spec__", None) is None
    return ', and start the work of a script below if __name__ == "__main__":' if is_script else ""


def _server() -> BaseContext | None:
    """Return the context that forks workers from a server process with the required modules.

    Forking this process would not be safe because of its threads, Warp and windows. On macOS no fork is safe.
    """
    if not sys.platform.startswith("linux"):
        return None
    from multiprocessing import forkserver

    context = get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    own = {
        _THREADS: os.environ.get(_THREADS, "1"),
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "CUDA_VISIBLE_DEVICES": "",  # a GPU context would not survive the fork
        _SERVER_FOLDER: get_temp_dir(),
    }
    before = {name: os.environ.get(name) for name in own}
    os.environ.update(own)  # the server inherits the environment at its start
    try:
        forkserver.ensure_running()
    except OSError:  # for example, if the temporary folder's name is too long for a socket
        return None
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return context


def _live_with(parent: Connection) -> None:
    """Ignore Ctrl-C, and end with the parent even if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault(_THREADS, "1")  # each process has its core

    def watch() -> None:
        try:
            parent.recv_bytes()
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _tidy_server() -> None:
    """In the server of processes: remove the folder of its socket when the program has ended.

    Python removes it in the program, which can't do so when it is killed.
    """
    folder = os.environ.pop(_SERVER_FOLDER, None)
    if folder is not None:
        atexit.register(shutil.rmtree, folder, ignore_errors=True)


_tidy_server()
