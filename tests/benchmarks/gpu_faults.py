"""A GPU whose memory is full, and one that is lost, for real: optimizations have to end with a message.

``python tests/benchmarks/gpu_faults.py SHAPES`` with shapes from ``optimizer.py shapes``. Each try runs in a
process of its own, since a CUDA context does not outlive an illegal access to memory.
"""

import argparse
import subprocess
import sys
import traceback
from pathlib import Path

import numpy as np
import optimizer
import warp as wp

from homolog.correspondence import optimize
from homolog.device import device_faults
from homolog.errors import InputError
from homolog.settings import OptimizeSettings

FREE_MB = (40, 100, 150, 200, 300, 600)
TICKS = (3, 30, 45, 80, 100, 120, 150, 200, 300, 390)


@wp.kernel
def write_anywhere(values: wp.array(dtype=float)):
    """Write far outside of an array: CUDA then gives the context up, as when a GPU falls off the bus."""
    values[(wp.tid() + 1) << 30] = 1.0


def fill_memory(device: str, free: int) -> list[wp.array]:
    """Take memory until only so many bytes are free; return what holds it."""
    held = []
    for size in (1 << 30, 16 << 20):
        while wp.get_device(device).free_memory > free + size:
            held.append(wp.empty(size, dtype=wp.uint8, device=device))
    return held


def attempt(shapes: Path, fault: str, amount: int, device: str) -> None:
    """Print how one optimization ends."""
    ticks, target = 0, wp.zeros(1, dtype=float, device=device)
    wp.load_module(device=device)

    def tick(*_: object) -> None:
        nonlocal ticks
        ticks += 1
        if fault == "lost" and ticks == amount:
            wp.launch(write_anywhere, 1, inputs=[target], device=device)

    held = fill_memory(device, amount << 20) if fault == "full" else []
    try:
        with device_faults(device):
            result = optimize(
                optimizer.load(shapes), OptimizeSettings(particles=256), device=device, tick=tick
            )
        said = f"finished, all finite: {np.isfinite(result.local).all()}"
    except InputError as error:
        said = f"message: {error}"
    except Exception as error:  # noqa: BLE001 - what should not happen is what is looked for
        frames = traceback.extract_tb(error.__traceback__)[-4:]
        said = f"NO MESSAGE: {type(error).__name__}: {error} at {frames}"
    print(f"outcome: {fault} {amount} ({len(held)} blocks held), tick {ticks}: {said}"[:400], flush=True)


def main() -> None:
    """Try every fault."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--one", nargs=2, help="a fault and its amount: one try in this process")
    arguments = parser.parse_args()
    if arguments.one:
        attempt(arguments.folder / "wide5.npz", arguments.one[0], int(arguments.one[1]), arguments.device)
        return
    for fault, amounts in (("full", FREE_MB), ("lost", TICKS)):
        for amount in amounts:
            options = [sys.executable, __file__, str(arguments.folder), "--device", arguments.device]
            done = subprocess.run([*options, "--one", fault, str(amount)], capture_output=True, text=True)
            messages = [line for line in done.stdout.splitlines() if line.startswith("outcome")]
            print(
                messages[0]
                if messages
                else f"{fault} {amount}: ended by {done.returncode}: {done.stderr[-300:]}"
            )


if __name__ == "__main__":
    main()
