"""``homolog geodesics``: the distances between the vertices of a surface."""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog_app.cli.progress import add_progress_option, show_progress

__all__ = ["add_geodesics", "run_geodesics"]


def add_geodesics(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "geodesics",
        description="Geodesic distances between all vertices of a closed surface, as a sparse matrix.",
    )
    parser.add_argument("mesh", type=Path, help="closed surface: .vtp, .vtk, .ply, .stl or .obj")
    parser.add_argument(
        "--d-max", type=float, required=True, metavar="MM", help="greatest distance to compute; inf for all"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.npz", help="write a SciPy sparse matrix (scipy.sparse.load_npz)"
    )
    parser.add_argument("--device", default="auto", help="auto, cpu, cuda:0 …; auto takes the first GPU")
    parser.add_argument(
        "--element",
        choices=["point", "linear"],
        default="point",
        help="local solver: fronts from a point (default) or planar fronts, as in the paper",
    )
    parser.add_argument(
        "--memory-limit", type=float, default=8.0, metavar="GB", help="largest table allowed (default 8)"
    )
    parser.add_argument(
        "--verify",
        type=int,
        nargs="?",
        const=32,
        metavar="SOURCES",
        help="compare this number of random rows (default 32) with exact distances; needs tvb-gdist",
    )
    add_progress_option(parser)


def run_geodesics(arguments: argparse.Namespace) -> int:
    """Compute, write and verify as asked; returns the exit code."""
    from homolog.device import choose_device, describe_device, device_faults
    from homolog.files.meshes import read_mesh
    from homolog.geodesics import measure_accuracy, plan_tables, solve_plan

    if arguments.out is not None and arguments.out.suffix != ".npz":
        raise InputError(f"{arguments.out}: the matrix is written as .npz; use that suffix")
    if arguments.verify is not None and arguments.verify < 1:
        raise InputError(f"--verify {arguments.verify}: at least one source is needed")
    mesh = read_mesh(arguments.mesh)
    plan = plan_tables(
        [mesh],
        arguments.d_max,
        names=[str(arguments.mesh)],
        element=arguments.element,
        memory_limit=int(1e9 * arguments.memory_limit),
    )
    device = choose_device(arguments.device)
    kind = "dense" if plan.dense else "block"
    _say(
        f"{len(mesh.vertices)} vertices, mean edge {mesh.mean_edge:.3g} mm; {kind} table of about "
        f"{plan.nbytes / 1e6:.0f} MB on {describe_device(device)}"
    )
    with show_progress(arguments.progress) as progress, device_faults(device):
        start = time.perf_counter()
        table = solve_plan(plan, device=device, tick=progress.tick)[0]
        seconds = time.perf_counter() - start
        _say(f"solved in {seconds:.2f} s, {table.nbytes / 1e6:.0f} MB, steps of {table.unit:.3g} mm")
        if arguments.out is not None:
            _say(f"{_write(arguments.out, table)} distances in {arguments.out}")
        if arguments.verify is not None:
            _say(str(measure_accuracy(mesh, table, arguments.verify, tick=progress.tick)))
    return 0


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _write(path: Path, table: Any) -> int:  # noqa: ANN401 - a GeodesicTable, slow to import
    """Write the matrix whole or not at all; return how many entries it has."""
    import scipy.sparse

    from homolog.files.atomic import atomic_write

    matrix = table.to_csr()
    with atomic_write(path) as part:
        scipy.sparse.save_npz(part, matrix, compressed=False)
    return int(matrix.nnz)
