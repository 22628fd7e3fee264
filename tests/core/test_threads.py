from threadpoolctl import threadpool_info

from homolog.threads import on_one_thread


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
