"""Device milliseconds of an iteration by kernel, on a CUDA device.

    python tests/benchmarks/optimizer_phases.py FOLDER --sizes 100x1024 300x1024 500x1024

FOLDER as of `optimizer.py`, with the ten beans. Kernels are timed one by one, outside the CUDA graph: their
sum leaves out what a graph spends between them, which the last column (the same iterations as a graph) has.
"""

import argparse
import collections
import time
from pathlib import Path

import warp as wp
from optimizer import an_engine

from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.schedule import Weights
from homolog.device import choose_device, describe_device

GROUPS = 10


def by_kernel(engine):
    """Return milliseconds and launches of an iteration by kernel."""
    wp.timing_begin(cuda_filter=wp.TIMING_ALL)
    for _ in range(LIST_ITERATIONS):
        engine._move()
    spent, launches = collections.Counter(), collections.Counter()
    for item in wp.timing_end():
        name = item.name.removeprefix("forward kernel ")
        spent[name] += item.elapsed / LIST_ITERATIONS
        launches[name] += 1 / LIST_ITERATIONS
    return spent, launches


def graph_ms(engine):
    """Return milliseconds of an iteration as users have it, neighbour lists included."""
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(GROUPS):
        engine.iterate()
    wp.synchronize()
    return 1000.0 * (time.perf_counter() - start) / (GROUPS * LIST_ITERATIONS)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--sizes", nargs="+", default=["100x1024", "300x1024", "500x1024"])
    arguments = parser.parse_args()
    device = choose_device(arguments.device)
    print(describe_device(device))
    for size in arguments.sizes:
        engine = an_engine(arguments.folder, device, *map(int, size.split("x")))
        engine.start_stage([Weights(Term(0.02, 1.0), Term(0.05, 0.1), 0.5)] * 1000)
        for _ in range(GROUPS):
            engine.iterate()
        wp.synchronize()
        spent, launches = by_kernel(engine)
        print(
            f"\n{size}: kernels {sum(spent.values()):.3f} ms, as a graph {graph_ms(engine):.3f} ms",
            flush=True,
        )
        for name, ms in spent.most_common():
            print(f"  {ms:9.4f} ms  {launches[name]:6.1f} launches  {name}", flush=True)


if __name__ == "__main__":
    main()
