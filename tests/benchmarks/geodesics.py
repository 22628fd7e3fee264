"""Geodesic distances beside their peers: CPU seconds for all sources, and errors, in one run on one machine.

Needs the bench extra: ``python tests/benchmarks/geodesics.py --sizes 2000 5000 --shares 0.1 0.2``. Real
surfaces are added where HOMOLOG_DATA names their folder.
"""

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path

import geodesics_meshes
import geodesics_peers
import matplotlib.pyplot as plt
import numpy as np
from geodesics_peers import PEERS, WHOLE, exact_rows
from scipy import ndimage
from skimage.measure import marching_cubes

from homolog.geodesics import solve_tables
from homolog.io.meshes import read_mesh
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified

QUICK = 5.0  # seconds: what takes less is called three times, and the best one counts
GENERATED = ("icosphere", "bean", "cup", "obtuse")


def real_surfaces(folder: Path, n_vertices: int) -> Iterator[tuple[str, TriangleMesh]]:
    """Yield a vertebra's surface and a left ventricle's myocardium, simplified to a size."""
    import SimpleITK

    vertebra = read_mesh(sorted((folder / "vertebra_l1_verse" / "meshes").glob("*.ply"))[0])
    image = SimpleITK.ReadImage(sorted((folder / "lv_acdc_dev" / "myo_iso").glob("*.nrrd"))[0])
    volume = np.pad(SimpleITK.GetArrayFromImage(image) > 0, 3).astype(np.float32)
    vertices, faces, _, _ = marching_cubes(ndimage.gaussian_filter(volume, 1.0), 0.5)
    for name, mesh in (("vertebra", vertebra), ("ventricle", TriangleMesh(vertices, faces[:, ::-1]))):
        yield name, simplified(mesh, n_vertices)


def diagonal(mesh: TriangleMesh) -> float:
    """Return the bounding box' diagonal [mm]."""
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def compare(name: str, mesh: TriangleMesh, share: float, n_sources: int) -> None:
    """Print a row of the table for each peer."""
    n, d_max = len(mesh.vertices), share * diagonal(mesh)
    sources = np.sort(np.random.default_rng(0).choice(n, n_sources, replace=False))
    truth = exact_rows(mesh, d_max, sources)
    pairs = (truth > 0) & (truth <= d_max)
    ours = 0.0
    for peer, call in PEERS.items():
        begin = time.perf_counter()
        rows, seconds = call(mesh, d_max, sources)
        if time.perf_counter() - begin < QUICK:
            seconds = min(seconds, *(call(mesh, d_max, sources)[1] for _ in range(2)))
        ours = ours or seconds
        there = pairs & np.isfinite(rows) & (rows > 0) & (rows < 1e30)
        error = np.abs(rows[there] / truth[there] - 1)
        far = error[truth[there] > 3 * mesh.mean_edge]
        missing = np.count_nonzero(pairs & (truth < 0.99 * d_max) & ~there)
        print(
            f"| {name} | {n} | {100 * share:.0f} % | {peer} | {seconds:.2f} | {seconds / ours:.2f} | "
            f"{100 * error.mean():.3f} | {100 * np.percentile(error, 99):.2f} | {100 * far.max():.2f} | "
            f"{missing} |",
            flush=True,
        )


def threads(mesh: TriangleMesh) -> None:
    """Print the wall time on one and two threads, best of five."""
    walls = {1: [], 2: []}
    for _ in range(5):
        for count, result in walls.items():
            begin = time.perf_counter()
            solve_tables([mesh], 0.2 * diagonal(mesh), threads=count)
            result.append(time.perf_counter() - begin)
    first, two = min(walls[1]), min(walls[2])
    print(
        f"{len(mesh.vertices)} vertices, 20 %: one thread {first:.3f} s, two {two:.3f} s: {first / two:.2f} x"
    )


def growth(picture: Path, sizes: tuple[int, ...] = (1000, 2000, 4000, 8000, 16_000)) -> None:
    """Draw CPU seconds and memory against the vertices (at 20 %) and against d_max (at 5000 vertices)."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    series = {
        "vertices": [(len(m.vertices), m, 0.2) for m in map(geodesics_meshes.bean, sizes)],
        "d_max / diagonal": [(s, geodesics_meshes.bean(5000), s) for s in (0.05, 0.1, 0.2, 0.4)],
    }
    for ax, (label, cases) in zip(axes, series.items(), strict=True):
        result = []
        for x, mesh, share in cases:
            begin = time.process_time()
            table = solve_tables([mesh], share * diagonal(mesh), threads=1)[0]
            result.append((x, time.process_time() - begin, table.to_csr().nnz * 2 / 1e6))
        x, seconds, megabytes = np.array(result).T
        for values, name in ((seconds, "CPU seconds, one thread"), (megabytes, "codes in reach [MB]")):
            slope = np.polyfit(np.log(x), np.log(values), 1)[0]
            ax.loglog(x, values, "o-", label=f"{name}: slope {slope:.2f}")
            print(f"{name} against {label}: slope {slope:.2f}; {', '.join(f'{v:.3g}' for v in values)}")
        ax.set_xlabel(label)
        ax.set_xticks(x, [f"{item:g}" for item in x])
        ax.minorticks_off()
        ax.legend()
        ax.grid(alpha=0.3)
    figure.savefig(picture, dpi=150)


def main() -> None:
    """Print the table, then threads and growth where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="*", default=[2000, 5000])
    parser.add_argument("--shares", type=float, nargs="*", default=[0.1, 0.2])
    parser.add_argument("--meshes", nargs="*", default=[*GENERATED, "real"])
    parser.add_argument("--sources", type=int, default=24)
    parser.add_argument(
        "--whole", type=int, default=WHOLE, help="vertices up to which gdist's whole matrix is timed"
    )
    parser.add_argument("--threads", action="store_true")
    parser.add_argument("--growth", type=Path)
    arguments = parser.parse_args()
    geodesics_peers.WHOLE = arguments.whole
    solve_tables([geodesics_meshes.icosphere(100)], 5.0)[0].to_csr()  # compiles
    if arguments.sizes:
        print("| mesh | vertices | d_max | program | CPU s | / ours | mean % | p99 % | max % | missing |")
        print("|---|---|---|---|---|---|---|---|---|---|")
    for size in arguments.sizes:
        cases = [
            (name, getattr(geodesics_meshes, name)(size)) for name in arguments.meshes if name in GENERATED
        ]
        if "real" in arguments.meshes and (folder := os.environ.get("HOMOLOG_DATA")):
            cases += real_surfaces(Path(folder), size)
        for name, mesh in cases:
            for share in arguments.shares:
                compare(name, mesh, share, arguments.sources)
    if arguments.threads:
        threads(geodesics_meshes.bean(5000))
    if arguments.growth:
        growth(arguments.growth)


if __name__ == "__main__":
    main()
