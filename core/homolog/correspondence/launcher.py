"""Launch kernels on every core of the CPU or on one CUDA device."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import warp as wp

from homolog.device import cores

__all__ = ["Launcher"]

SMALL = 2048  # below this many threads a second core costs more than it brings


class Launcher:
    """Runs kernels whose first argument is the index of their first thread.

    A Warp launch on the CPU is one loop on the calling thread that releases the interpreter lock, so the
    range is dealt to one Python thread a core. Results do not depend on how it is dealt.
    """

    def __init__(self, device: str, threads: int | None = None) -> None:
        self.device = device
        self.cores = 1 if device != "cpu" else threads or cores()
        self._pool = ThreadPoolExecutor(self.cores) if self.cores > 1 else None

    def __call__(self, kernel: Any, count: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401 - Warp has no types
        """Launch a kernel for indices 0 … count - 1 and wait for it on the CPU."""
        if self._pool is None or count < SMALL:
            wp.launch(kernel, dim=count, inputs=[0, *inputs], device=self.device)
            return
        cuts = [count * part // self.cores for part in range(self.cores + 1)]
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
