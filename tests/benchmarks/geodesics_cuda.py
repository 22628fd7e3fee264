"""Geodesic tables on a GPU: agreement with the CPU, device time, a whole cohort, bounded memory.

Needs numpy, scipy, scikit-image and warp only: ``PYTHONPATH=core python tests/benchmarks/geodesics_cuda.py``.
Device time is the sum of what the device did (kernels, copies, fills), by CUDA events; wall time is that
of the whole call.
"""

import argparse
import time
import traceback
from collections import defaultdict
from pathlib import Path

import geodesics_meshes as meshes
import numpy as np
import warp as wp

from homolog.correspondence import Shape
from homolog.device import describe_device
from homolog.geodesics import solve_tables
from homolog.geodesics.cuda.solver import solve_on_cuda
from homolog.geodesics.plan import plan_tables
from homolog.progress import no_tick
from homolog.surfaces.mesh import TriangleMesh

PHASES = {
    "advance_front": "solve",
    "build_patches": "patches",
    "count_patch_vertices": "patches",
    "store_front": "store",
    "mark_reached": "store",
    "symmetrize": "symmetrize",
    "corners": "fans",
    "memset": "fill",
    "memtile": "fill",
    "memcpy": "copy",
}

AGREE = (
    (meshes.obtuse, 2000),
    (meshes.cup, 2000),
    (meshes.bean, 3100),
    (meshes.obtuse, 1000),
    (meshes.bean, 900),
    (meshes.cup, 2600),
    (meshes.icosphere, 3000),
    (meshes.bean, 4300),
    (meshes.cup, 4300),
)
REAL = {"vertebrae": 10, "ventricles": 8, "wide12": 2}
"""How many surfaces of each groomed cohort are compared."""


def groomed(path: Path) -> list[Shape]:
    """Return the shapes that optimizer.py has stored."""
    from optimizer import load  # needs more than the rest

    return load(path)


def reach_of(mesh: TriangleMesh, share: float) -> float:
    """Return a part of the bounding box' diagonal [mm]."""
    return share * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def compare(name: str, mesh: TriangleMesh, share: float, device: str) -> None:
    """Print how far the tables of CPU and GPU, and of two runs on the GPU, are apart in codes."""
    d_max = reach_of(mesh, share)
    tables = [solve_tables([mesh], d_max, device=where)[0] for where in ("cpu", device, device)]
    dense = [np.asarray(table.to_csr().todense()) / table.unit for table in tables]
    for label, item, other in (("CPU/GPU", dense[0], dense[1]), ("GPU/GPU", dense[1], dense[2])):
        both = (item > 0) & (other > 0)
        codes = np.abs(item - other)[both]
        print(
            f"agree  {name:10s} V {len(mesh.vertices):6d} {label} pairs {both.sum():9d} "
            f"in one only {((item > 0) != (other > 0)).sum():5d} codes: max {codes.max():4.1f} "
            f"over 2: {100 * (codes > 2.5).mean():.4f} %",
            flush=True,
        )


def measure(name: str, shapes: list[TriangleMesh], share: float, device: str, repeats: int = 3) -> None:
    """Print device and wall times of the tables of some shapes."""
    limits = [reach_of(mesh, share) for mesh in shapes]
    walls = []
    for _ in range(repeats):
        wp.synchronize_device(device)
        begin = time.perf_counter()
        tables = solve_tables(shapes, limits, device=device)
        wp.synchronize_device(device)
        walls.append(1e3 * (time.perf_counter() - begin))
        last = tables
        del tables
    begin = time.perf_counter()
    planned = plan_tables(shapes, limits)
    checks = 1e3 * (time.perf_counter() - begin)
    nbytes = sum(table.nbytes for table in last)
    del last
    wp.timing_begin(wp.TIMING_ALL)
    solve_tables(shapes, limits, device=device)
    spent = defaultdict(float)
    for activity in wp.timing_end():
        phase = next((p for key, p in PHASES.items() if key in activity.name), "other")
        spent[phase] += activity.elapsed
    print(
        f"time   {name:10s} V {sum(len(m.vertices) for m in shapes):6d} {100 * share:3.0f} %"
        f"{nbytes / 1e6:8.1f} MB (predicted {planned.nbytes / 1e6:8.1f}) "
        f"device {sum(spent.values()):8.2f} ms [{', '.join(f'{p} {t:.2f}' for p, t in spent.items())}] "
        f"wall {min(walls):8.1f} ms (first {walls[0]:.1f}), of it checks {checks:.1f}",
        flush=True,
    )


def bounded(device: str, n_vertices: int, scratch: int) -> None:
    """Print the peak of device memory for a large mesh whose batches may take `scratch` bytes."""
    mesh = meshes.icosphere(n_vertices)
    planned = plan_tables([mesh], reach_of(mesh, 0.2))
    begin = time.perf_counter()
    table = solve_on_cuda(planned, device, scratch, no_tick)[0]
    wp.synchronize_device(device)
    peak = 0 if device == "cpu" else wp.get_mempool_used_mem_high(device)
    print(
        f"memory large      V {len(mesh.vertices):6d}  20 % {table.nbytes / 1e9:.2f} GB "
        f"peak {peak / 1e9:.2f} GB wall {time.perf_counter() - begin:.2f} s",
        flush=True,
    )


def main() -> None:
    """Run every part; a part that fails says so and the others still run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0", help="cpu is for trying out this script")
    parser.add_argument("--quick", action="store_true", help="small sizes only")
    parser.add_argument("--shapes", type=Path, help="folder that optimizer.py has groomed: real surfaces too")
    arguments = parser.parse_args()
    device, quick = arguments.device, arguments.quick
    wp.init()
    print(f"Warp {wp.config.version}, numpy {np.__version__}, {describe_device(device)}")
    if device != "cpu":
        wp.set_mempool_release_threshold(device, 1.0)  # keep memory between the calls
    begin = time.perf_counter()
    solve_tables([meshes.icosphere(100)], 10.0, device=device)
    print(f"first call, with compilation: {time.perf_counter() - begin:.1f} s")

    def large() -> None:
        bounded(device, *((3000, 10_000_000) if quick else (100_000, 2_000_000_000)))

    def agreement() -> None:
        for size in (1000, 2000) if quick else (2000, 5000, 10_000):
            compare("bean", meshes.bean(size), 0.2, device)
        for make, size in AGREE[:2] if quick else AGREE:
            compare(make.__name__, make(size), 0.2, device)
        for name, count in REAL.items() if arguments.shapes else ():
            for shape in groomed(arguments.shapes / f"{name}.npz")[:count]:
                compare(name, shape.mesh, 0.2, device)

    def beans() -> None:
        for share in (0.1, 0.2):
            for size in (1000,) if quick else (2000, 5000, 10_000, 20_000, 40_000):
                measure("bean", [meshes.bean(size)], share, device)

    def others() -> None:
        for make in (meshes.icosphere, meshes.cup, meshes.obtuse):
            for size in (2000,) if quick else (5000, 20_000):
                measure(make.__name__, [make(size)], 0.2, device)

    def cohort() -> None:
        random = np.random.default_rng(5)
        count, size = (3, 1000) if quick else (20, 5000)
        shapes = [meshes.bean(size, random.uniform(-10, 10), random.normal(8, 2)) for _ in range(count)]
        for share in (0.1, 0.2):
            measure(f"{count} beans", shapes, share, device)

    for part in (large, agreement, beans, others, cohort):
        try:
            part()
        except Exception:  # noqa: BLE001 - one part must not hide the others
            traceback.print_exc()


if __name__ == "__main__":
    main()
