"""Memory of geodesic tables on a CPU: what is stored, and the peak of a process that solves one.

``PYTHONPATH=core python tests/benchmarks/geodesics_memory.py --size 20000``. The peak has Python, the
libraries and the mesh in it, which are there before the start.
"""

import argparse
import multiprocessing
import resource

import geodesics_meshes
import numpy as np

from homolog.geodesics import solve_tables


def peak() -> float:
    """Return the most memory that this process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def measure(case: tuple[str, int, float]) -> str:
    """Solve one mesh and return a line of the table."""
    name, size, share = case
    mesh = getattr(geodesics_meshes, name)(size)
    before = peak()
    d_max = share * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    table = solve_tables([mesh], d_max, device="cpu")[0]
    return f"| {name} | {len(mesh.vertices)} | {table.nbytes / 1e6:.0f} | {peak():.0f} | {before:.0f} |"


def main() -> None:
    """Print a table; each mesh has a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=20_000)
    parser.add_argument("--share", type=float, default=0.2)
    arguments = parser.parse_args()
    print("| mesh | vertices | stored MB | peak MB | before the start MB |\n|---|---|---|---|---|")
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        cases = [(name, arguments.size, arguments.share) for name in ("icosphere", "bean", "cup", "obtuse")]
        for line in pool.imap(measure, cases):
            print(line, flush=True)


if __name__ == "__main__":
    main()
