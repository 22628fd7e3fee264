"""Multithreading, and limiting BLAS to one thread for small matrices."""

import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["MOST_THREADS", "blas_threads", "cores", "in_threads", "on_one_thread", "switching_often"]

_LARGE = 200  # least number of rows for which several threads are faster

MOST_THREADS = 8
"""Further threads would wait for the interpreter lock."""

_SWITCH_INTERVAL = 0.0002  # s; 5 ms by default

_Item = TypeVar("_Item")
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(
    function: Callable[[_Item], _Result], items: Iterable[_Item], threads: int
) -> Iterator[_Result]:
    """Yield a function's results in the order of the items, computing a few ahead on other threads."""
    threads = min(threads, MOST_THREADS)
    if threads == 1:
        yield from map(function, items)
        return
    pool, ahead = ThreadPoolExecutor(threads), deque[Future[_Result]]()
    try:
        for item in items:
            ahead.append(pool.submit(function, item))
            if len(ahead) > threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def on_one_thread(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorate a function to run its linear algebra on one thread.

    Products and decompositions of small matrices are several times slower on two BLAS threads that wait for
    each other, and a thousand times slower on a busy machine. With one thread their last digits do not depend
    on the number of cores.
    """

    @wraps(function)
    def limited(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        with _one_thread():
            return function(*arguments, **named)

    return limited


def blas_threads(rows: int, least: int = _LARGE) -> AbstractContextManager[object]:
    """Return a context in which BLAS uses one thread, unless the matrices have at least `least` rows."""
    return nullcontext() if rows >= least else _one_thread()


class _Switching:
    """The switch interval of the interpreter, which is short while a block of any thread is open."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._usual_s = sys.getswitchinterval()

    @contextmanager
    def often(self) -> Iterator[None]:
        """Shorten the interval, and restore it when the last user leaves."""
        with self._lock:
            if self._users == 0:
                self._usual_s = sys.getswitchinterval()
                sys.setswitchinterval(min(self._usual_s, _SWITCH_INTERVAL))
            self._users += 1
        try:
            yield
        finally:
            with self._lock:
                self._users -= 1
                if self._users == 0:
                    sys.setswitchinterval(self._usual_s)


_SWITCHING = _Switching()


def switching_often() -> AbstractContextManager[None]:
    """Return a context in which threads pass the interpreter lock on quickly.

    With Python's interval many threads that launch kernels wait for the lock longer than for the kernels.
    """
    return _SWITCHING.often()


_lock = threading.Lock()
_limiting = 0  # number of active blocks that limit BLAS, over all threads


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit BLAS, whose threads are shared by the process, until the last of overlapping blocks ends."""
    global _limiting
    libraries = _threads_at_first()
    with _lock:
        _limiting += 1
        if _limiting == 1:
            for library, _ in libraries:
                _set_threads(library, 1)
    try:
        yield
    finally:
        with _lock:
            _limiting -= 1
            if _limiting == 0:
                for library, threads in libraries:
                    _set_threads(library, threads)


def _set_threads(library: Any, threads: int) -> None:  # noqa: ANN401 - threadpoolctl has no types
    """Set a library's threads from any thread: threadpoolctl 3.8 only obeys the first thread that did."""
    clear = getattr(library, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)
    library.set_num_threads(threads)
    if clear is not None:
        clear()


@cache
def _threads_at_first() -> list[tuple[Any, int]]:
    """Return the libraries with a BLAS, and their numbers of threads before any limit."""
    import scipy.linalg  # noqa: F401 - has a BLAS of its own, which counts only if it is loaded

    libraries = ThreadpoolController().select(user_api="blas").lib_controllers
    return [(library, library.num_threads) for library in libraries]
