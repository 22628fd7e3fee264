"""Keeping BLAS to one thread where matrices are small."""

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["on_one_thread"]

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


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
