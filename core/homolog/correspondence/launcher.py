"""Launch kernels on every core of the CPU or on one CUDA device."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import warp as wp

from homolog.device import cores

__all__ = ["Launcher", "load_kernels"]

SMALL = 2048  # below this many threads a second core costs more than it brings
LARGE = 32768  # more threads than this a core are launched bit by bit: some 0.1 s each


def load_kernels(device: str) -> None:
    """Compile what an optimization needs on a device, or load what was compiled before."""
    for part in ("geodesics", "correspondence"):
        wp.load_module(f"homolog.{part}", device=device, recursive=True)


class Launcher:
    """Runs kernels whose first argument is the index of their first thread.

    A Warp launch on the CPU is one loop on the calling thread that releases the interpreter lock, so the
    range is dealt to one Python thread a core. Results do not depend on how it is dealt.

    Parameters
    ----------
    device : str
        Warp alias.
    threads : int, optional
        On the CPU; one a core if not given.
    breathe : callable, optional
        Called before every launch on the CPU, and within long work on the host, which it may stop by raising.
    """

    def __init__(
        self, device: str, threads: int | None = None, breathe: Callable[[], None] | None = None
    ) -> None:
        self.device = device
        self.cores = 1 if device != "cpu" else threads or cores()
        self.breathe = breathe or (lambda: None)
        self._pool = ThreadPoolExecutor(self.cores) if self.cores > 1 else None

    def __call__(self, kernel: Any, count: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401 - Warp has no types
        """Launch a kernel for indices 0 … count - 1 and wait for it on the CPU."""
        if self.device != "cpu":
            wp.launch(kernel, dim=count, inputs=[0, *inputs], device=self.device)
            return
        for begin in range(0, count, LARGE * self.cores):
            self.breathe()
            self._launch(kernel, begin, min(count, begin + LARGE * self.cores), inputs)

    def _launch(self, kernel: Any, begin: int, end: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401
        size = end - begin
        if self._pool is None or size < SMALL:
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
