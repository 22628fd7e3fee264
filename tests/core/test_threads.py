import threading

import numpy as np
from threadpoolctl import threadpool_info

from homolog.threads import on_one_thread


def blas():
    """Return the threads of each BLAS."""
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_blas_has_one_thread_until_the_last_of_several_functions_ends():
    np.linalg.inv(np.eye(3))
    entered, leave = threading.Event(), threading.Event()

    @on_one_thread
    def wait():
        entered.set()
        assert leave.wait(30.0)

    before = blas()
    first = threading.Thread(target=wait)
    first.start()
    assert entered.wait(30.0)
    assert set(on_one_thread(blas)()) == {1}
    assert set(blas()) == {1}  # the first still works
    leave.set()
    first.join()
    assert blas()[: len(before)] == before
