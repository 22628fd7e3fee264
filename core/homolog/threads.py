"""Keeping BLAS to one thread where matrices are small."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["blas_threads", "on_one_thread"]

_LARGE = 200  # rows of a matrix from which several threads pay

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def on_one_thread(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Make a function run its linear algebra on one thread.

    Thousands of decompositions of matrices of subjects x subjects are several times slower on two BLAS
    threads that wait for each other than on one, and worse on a busy machine.
    """

    @wraps(function)
    def limited(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*arguments, **named)

    return limited


def blas_threads(rows: int) -> AbstractContextManager[object]:
    """Return a context in which BLAS uses one thread, unless the matrices have many rows."""
    return nullcontext() if rows >= _LARGE else _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
