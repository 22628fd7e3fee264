"""Launch kernels on every core of the CPU or on one CUDA device."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import warp as wp

from homolog.device import cores

__all__ = ["Launcher", "load_kernels"]

MIN_PARALLEL_THREADS = 2048  # below it a second core does not pay
MAX_CHUNK_THREADS = 32768  # per core and launch, some 0.1 s, so that the run can be cancelled


def load_kernels(device: str) -> None:
    """Compile the kernels of an optimization for a device, or load them from Warp's cache."""
    for part in ("geodesics", "correspondence"):
        wp.load_module(f"homolog.{part}", device=device, recursive=True)


class Launcher:
    """Launches kernels whose first argument is the index of their first thread.

    A Warp launch on the CPU is one loop on the calling thread, which releases the interpreter lock. The range
    is therefore divided among one Python thread per core. Results do not depend on the division.

    Parameters
    ----------
    device : str
        Warp alias.
    threads : int, optional
        On the CPU; one a core if not given.
    poll_cancel : callable, optional
        Called before every launch on the CPU and during long work on the host; raises to cancel.
    """

    def __init__(
        self, device: str, threads: int | None = None, poll_cancel: Callable[[], None] | None = None
    ) -> None:
        self.device = device
        self.cores = 1 if device != "cpu" else threads or cores()
        self.poll_cancel = poll_cancel or (lambda: None)
        self._pool = ThreadPoolExecutor(self.cores) if self.cores > 1 else None

    def __call__(self, kernel: Any, count: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401 - Warp has no types
        """Launch a kernel for indices 0 … count - 1 and wait for it on the CPU."""
        if self.device != "cpu":
            wp.launch(kernel, dim=count, inputs=[0, *inputs], device=self.device)
            return
        for begin in range(0, count, MAX_CHUNK_THREADS * self.cores):
            self.poll_cancel()
            self._launch(kernel, begin, min(count, begin + MAX_CHUNK_THREADS * self.cores), inputs)

    def _launch(self, kernel: Any, begin: int, end: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401
        size = end - begin
        if self._pool is None or size < MIN_PARALLEL_THREADS:
            wp.launch(kernel, dim=size, inputs=[begin, *inputs], device=self.device)
            return
        cuts = [begin + size * part // self.cores for part in range(self.cores + 1)]
        jobs = [
            self._pool.submit(
                wp.launch, kernel, dim=stop - start, inputs=[start, *inputs], device=self.device
            )
            for start, stop in pairwise(cuts)
        ]
        for job in jobs:
            job.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
