import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from threadpoolctl import threadpool_info

from homolog.threads import in_threads, on_one_thread


@on_one_thread
def limited():
    """Return the threads of each BLAS within a limit."""
    return blas()


def blas():
    """Return the threads of each BLAS."""
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_blas_has_one_thread_until_the_outermost_function_ends():
    limited()
    before = blas()

    @on_one_thread
    def outer():
        return limited(), blas()

    assert outer() == ({1}, {1})
    assert blas() == before


def test_blas_has_one_thread_in_a_second_thread_and_until_the_last_of_two_ends():
    before = blas()
    limited()  # the main thread has limited BLAS first, and lives on
    inside, end = threading.Event(), threading.Event()

    @on_one_thread
    def wait():
        inside.set()
        assert end.wait(30.0)

    with ThreadPoolExecutor(2) as pool:
        assert pool.submit(limited).result() == {1}
        waiting = pool.submit(wait)
        assert inside.wait(30.0)
        assert pool.submit(limited).result() == {1}
        assert blas() == {1}
        end.set()
        waiting.result()
    assert blas() == before


@pytest.mark.parametrize("threads", [1, 3])
def test_a_failure_in_a_thread_reaches_the_caller(threads):
    def work(item):
        if item == 5:
            raise ValueError(f"item {item}")
        return item

    results = in_threads(work, range(10), threads)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="item 5"):
        next(results)
