"""The compute device: choice, description, errors."""

import ctypes.util
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

import warp as wp

from homolog.arrays import Array
from homolog.errors import InputError, is_out_of_memory
from homolog.threads import cores

__all__ = ["choose_device", "describe_device", "device_faults", "launch_on_cores", "shared"]

_PIECES_PER_CORE = 4
"""Number of pieces per core of a launch on the CPU, to balance the load."""


def _start_warp() -> None:
    """Initialize Warp without its message on a missing CUDA driver or hidden GPUs.

    Such machines are supported, and `describe_device` names the device in use.
    """
    wp.config.log_level = wp.LOG_WARNING
    hidden = os.environ.get("CUDA_VISIBLE_DEVICES") in ("", "-1")
    if not hidden and (ctypes.util.find_library("cuda") or ctypes.util.find_library("nvcuda")):
        wp.init()
        return
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


_start_warp()


def choose_device(name: str = "auto") -> str:
    """Return the Warp alias of the device to compute on.

    Parameters
    ----------
    name : str
        ``"auto"`` (first CUDA device, else the CPU), ``"cpu"``, ``"cuda:<n>"``, or several of one kind
        separated by commas.

    Returns
    -------
    str
        ``"cpu"``, ``"cuda:<n>"`` or several, separated by commas.

    Raises
    ------
    InputError
        If a named device does not exist; the message lists the existing ones.
    """
    present = ["cpu", *(device.alias for device in wp.get_cuda_devices())]
    if name == "auto":
        return present[1] if len(present) > 1 else "cpu"
    aliases = ["cuda:0" if item == "cuda" else item for item in name.split(",")]
    for alias in aliases:
        if alias not in present:
            raise InputError(
                f"device {alias!r} is not on this machine; use one of: auto, {', '.join(present)}"
            )
    if len({alias == "cpu" for alias in aliases}) > 1:
        raise InputError(f"device {name!r}: the CPU and GPUs can't share a run; use either")
    return ",".join(aliases)


def describe_device(alias: str) -> str:
    """Return a description, such as ``"cuda:0 (NVIDIA H100, 80 GB)"`` or ``"CPU (2 cores)"``."""
    if "," in alias:
        return " and ".join(describe_device(item) for item in alias.split(","))
    if alias == "cpu":
        return f"CPU ({cores()} cores)"
    device = wp.get_device(alias)
    return f"{alias} ({device.name}, {device.total_memory / 2**30:.0f} GB)"


@contextmanager
def device_faults(alias: str) -> Iterator[None]:
    """Convert Warp's exceptions on a lost GPU or full memory into an error with a remedy.

    The run does not switch devices by itself, because results would differ in the last digits.

    Raises
    ------
    InputError
        With the device, the fault and how to continue from the saved state.
    """
    try:
        yield
    except Exception as error:
        full = is_out_of_memory(error)
        # Warp raises these two, no class of its own: Exception if kernels can't be loaded
        from_warp = type(error) in (RuntimeError, Exception) and (full or alias != "cpu")
        if not from_warp and not isinstance(error, MemoryError):
            raise
        what = "has too little memory" if full else "failed"
        remedy = (
            "free memory, or use fewer particles or coarser meshes"
            if full
            else "continue when it works again"
        )
        others = "those of the devices that work, or on cpu" if "," in alias else "the device cpu"
        elsewhere = "" if alias == "cpu" else f"; or resume on {others}"
        raise InputError(f"{alias}: {what} ({error}); saved data are kept: {remedy}{elsewhere}") from error


def launch_on_cores(kernel: Any, count: int, inputs: Sequence[Any]) -> None:  # noqa: ANN401
    """Launch a kernel on the CPU, whose first argument is the index of its first thread, on all cores."""
    wp.load_module(kernel.module, device="cpu")  # otherwise each thread would load it
    pieces = min(count, _PIECES_PER_CORE * cores() if cores() > 1 else 1)
    cuts = [count * number // pieces for number in range(pieces + 1)] if count else []

    def launch(begin: int, end: int) -> None:
        wp.launch(kernel, end - begin, inputs=[begin, *inputs], device="cpu")

    if pieces == 1:
        launch(0, count)
        return
    list(_launching_threads(os.getpid()).map(launch, cuts[:-1], cuts[1:]))


@cache
def _launching_threads(_process: int) -> ThreadPoolExecutor:
    """Return the threads of `launch_on_cores`, kept because new threads cost more than many launches."""
    return ThreadPoolExecutor(cores(), thread_name_prefix="launches")


def shared(array: Array) -> Any:  # noqa: ANN401
    """Return a Warp array on the CPU that shares the memory of a contiguous array."""
    return wp.array(array, dtype=wp.dtype_from_numpy(array.dtype), device="cpu", copy=False)
