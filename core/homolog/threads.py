"""Keeping BLAS to one thread where matrices are small."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["blas_threads", "on_one_thread"]

_LARGE = 200  # rows of a matrix from which several threads pay

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def on_one_thread(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Make a function run its linear algebra on one thread.

    Many products and decompositions of small matrices are several times slower on two BLAS threads that wait
    for each other than on one, a thousand times on a busy machine. And their last digits then do not depend
    on the number of cores.
    """

    @wraps(function)
    def limited(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        with _one_thread():
            return function(*arguments, **named)

    return limited


def blas_threads(rows: int) -> AbstractContextManager[object]:
    """Return a context in which BLAS uses one thread, unless the matrices have many rows."""
    return nullcontext() if rows >= _LARGE else _one_thread()


class _Limit:
    """How many blocks want one thread: the limit holds for the whole process, and for as long as any does."""

    lock = threading.Lock()
    count = 0
    limiter: Any = None


@contextmanager
def _one_thread() -> Iterator[None]:
    with _Limit.lock:
        if _Limit.count == 0:
            _Limit.limiter = _controller().limit(limits=1, user_api="blas")
        _Limit.count += 1
    try:
        yield
    finally:
        with _Limit.lock:
            _Limit.count -= 1
            if _Limit.count == 0:
                _Limit.limiter.restore_original_limits()


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 - has a BLAS of its own, which counts only if it is loaded

    return ThreadpoolController()
