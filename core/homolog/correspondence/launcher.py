"""Launch kernels on every core of the CPU or on one CUDA device."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import count as counter
from itertools import pairwise
from queue import SimpleQueue
from typing import Any

import warp as wp

from homolog.arrays import DeviceArray
from homolog.threads import cores, switching_often

__all__ = ["Launcher", "Transfer", "copy_between", "load_kernels", "push"]

MIN_PIECE_THREADS = 512  # below it another core does not pay
MAX_PIECE_THREADS = 32768  # some 0.1 s, so that the run can be cancelled
PIECES_PER_CORE = 4  # of a sequence of kernels, so that cores which are done early take from the others
MAX_RECORDED = 32
CPU_KERNELS = (
    "coherence",
    "functions",
    "particles",
    "sampling",
    "step",
)  # others: CUDA only

_Launch = tuple[Any, int, Sequence[Any]]  # kernel, number of threads, inputs after the index of the first


def load_kernels(device: str) -> None:
    """Compile the kernels of an optimization for a device, or several, or load them from Warp's cache."""
    for alias in device.split(","):
        wp.load_module("homolog.geodesics", device=alias, recursive=True)
        if alias == "cpu":
            for part in CPU_KERNELS:
                wp.load_module(f"homolog.correspondence.kernels.{part}", device=alias)
        else:
            wp.load_module("homolog.correspondence", device=alias, recursive=True)


class Launcher:
    """Launches kernels whose first argument is the index of their first thread.

    A Warp launch on the CPU is one loop on the calling thread, which releases the interpreter lock. The range
    is therefore cut into pieces, which the calling thread and one thread for each further core take one after
    another. Launches are recorded, as Warp's check and packing of arguments, under the lock, takes as long as
    many of the kernels. Results do not depend on the division.

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
        self._sequence: list[_Launch] | None = None
        self._recorded: dict[tuple[Any, ...], tuple[Sequence[_Launch], list[tuple[Any, ...]]]] = {}
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._threads = [
            threading.Thread(target=self._work, name=f"kernels-{number}", daemon=True)
            for number in range(1, self.cores)
        ]
        self._open = ExitStack()
        if self.cores > 2:
            self._open.enter_context(switching_often())
        for thread in self._threads:
            thread.start()

    def __call__(self, kernel: Any, count: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401 - Warp has no types
        """Launch a kernel for indices 0 … count - 1 and wait for it on the CPU."""
        if self.device != "cpu":
            wp.launch(kernel, dim=count, inputs=[0, *inputs], device=self.device)
        elif self._sequence is not None:
            self._sequence.append((kernel, count, inputs))
        else:
            self._finish(*self._start([(kernel, count, inputs)], 1))

    @contextmanager
    def beside(self, launches: Callable[[], None], per_shape: int) -> Iterator[None]:
        """Run the body of the block on this thread while kernels run, and wait for both.

        Parameters
        ----------
        launches : callable
            Launches kernels for all particles. One may read what those before it wrote on the same shape.
        per_shape : int
            Particles of a shape.
        """
        if self.device != "cpu":
            launches()
            yield
            return
        self._sequence = []
        try:
            launches()
            sequence = self._sequence
        finally:
            self._sequence = None
        if sequence[0][1] < per_shape * self.cores:  # fewer shapes than cores: divide each kernel's particles
            *before, last = sequence
            for launch in before:
                self._finish(*self._start([launch], 1))
            sequence, per_shape = [last], 1
        started = self._start(sequence, per_shape)
        try:
            yield
        finally:
            self._finish(*started)

    def in_order(self, launches: Callable[[], None], per_shape: int) -> None:
        """Launch kernels for all particles one after another, as `beside` does, and wait for them."""
        with self.beside(launches, per_shape):
            pass

    def forget(self) -> None:
        """Release the arrays of previous launches."""
        self._recorded.clear()

    def close(self) -> None:
        """Stop the threads."""
        self.forget()
        self._open.close()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads:
            thread.join()
        self._threads = []

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            task()

    def _start(
        self, sequence: Sequence[_Launch], block: int
    ) -> tuple[Callable[[], bool], SimpleQueue[Any], int]:
        """Begin a sequence of kernels, all of which run on one piece before the next is taken.

        Returns
        -------
        tuple
            What runs the next piece (False if there is none), where results arrive, and how many will.
        """
        self.poll_cancel()
        pieces = self._pieces(sequence, block)
        indices, results = counter(), SimpleQueue[BaseException | None]()

        def run_next() -> bool:
            index = next(indices)
            if index >= len(pieces):
                return False
            failure: BaseException | None = None
            try:
                for command in pieces[index]:
                    command.launch()
            except BaseException as error:  # noqa: BLE001 - raised again by the calling thread
                failure = error
            results.put(failure)
            return True

        def run_all() -> None:
            while run_next():
                pass

        for _ in range(min(len(self._threads), len(pieces) - 1)):
            self._tasks.put(run_all)
        return run_next, results, len(pieces)

    def _finish(self, run_next: Callable[[], bool], results: "SimpleQueue[Any]", expected: int) -> None:
        """Process pieces, and wait until all are done."""
        cancelled: BaseException | None = None
        while run_next():
            if cancelled is None:
                try:
                    self.poll_cancel()
                except BaseException as error:  # noqa: BLE001 - raised when no thread is in a kernel
                    cancelled = error
        failures = [results.get() for _ in range(expected)]
        if cancelled is not None:
            raise cancelled
        for failure in failures:
            if failure is not None:
                raise failure

    def _pieces(self, sequence: Sequence[_Launch], block: int) -> list[tuple[Any, ...]]:
        """Return the recorded launches of each piece."""
        key = (block, *(_identity(item) for launch in sequence for item in (*launch[:2], *launch[2])))
        if key not in self._recorded:
            if len(self._recorded) >= MAX_RECORDED:
                self.forget()
            # the inputs are kept too, as their identities must not pass to others
            self._recorded[key] = (sequence, self._record(sequence, block))
        return self._recorded[key][1]

    def _record(self, sequence: Sequence[_Launch], block: int) -> list[tuple[Any, ...]]:
        blocks = sequence[0][1] // block
        most = self.cores * (PIECES_PER_CORE if block > 1 else 1)
        fewest = -(-blocks * block // MAX_PIECE_THREADS)
        number = max(fewest, min(most, blocks * block // MIN_PIECE_THREADS)) if self.cores > 1 else fewest
        number = max(1, min(blocks, number))
        cuts = [block * (blocks * part // number) for part in range(number + 1)]
        return [
            tuple(
                wp.launch(kernel, stop - start, inputs=[start, *inputs], device="cpu", record_cmd=True)
                for kernel, _, inputs in sequence
            )
            for start, stop in pairwise(cuts)
        ]


def _identity(item: Any) -> Any:  # noqa: ANN401
    return item if isinstance(item, int | float) else id(item)


def copy_between(
    target: DeviceArray, source: DeviceArray, target_offset: int = 0, source_offset: int = 0, count: int = 0
) -> None:
    """Copy between devices, ordered after previous and before later launches on both."""
    apart = target.device != source.device
    if apart:
        target.device.stream.wait_stream(source.device.stream)
    wp.copy(target, source, target_offset, source_offset, count)
    if apart:
        source.device.stream.wait_stream(target.device.stream)


def push(target: DeviceArray, source: DeviceArray) -> None:
    """Copy to another device without waiting for its previous launches, none of which may use the target."""
    apart = target.device != source.device
    wp.copy(target, source, stream=source.device.stream if apart else None)
    if apart:
        target.device.stream.wait_stream(source.device.stream)


class Transfer:
    """Copies from a CUDA device to another one while both go on with other work.

    The target arrays may be in use only by launches that the source device has waited for. On one device
    copies are ordered like launches.

    Parameters
    ----------
    source, target : str
        Warp aliases.
    """

    def __init__(self, source: str, target: str) -> None:
        self._source, self._target = wp.get_device(source), wp.get_device(target)
        self._stream = wp.Stream(source) if source != target else None

    def start(self) -> None:
        """Begin copies after all previous launches on the source device."""
        if self._stream is not None:
            self._stream.wait_stream(self._source.stream)

    def copy(self, target: DeviceArray, source: DeviceArray, target_offset: int, count: int) -> None:
        """Copy the first `count` elements."""
        wp.copy(target, source, target_offset, 0, count, stream=self._stream)

    def finish(self) -> None:
        """Let later launches on both devices wait for the copies."""
        if self._stream is not None:
            for device in (self._source, self._target):
                device.stream.wait_stream(self._stream)
