"""Geodesic tables of meshes: the calls that other parts use."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import warp as wp
from scipy.sparse import csr_array

from homolog.arrays import Array
from homolog.device import choose_device
from homolog.errors import InputError
from homolog.geodesics import kernels
from homolog.geodesics.cpu import cores, solve_on_cpu
from homolog.geodesics.cuda import solve_on_cuda
from homolog.geodesics.plan import plan_tables
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Element", "local_distances", "solve_table", "solve_tables"]

Element = Literal["point", "linear"]
"""Local solver: fronts from a point, or the paper's planar fronts, which are some percent too long."""

CHANGED = 3e-5
"""Improvements below this part of the mean edge are not passed on: the order of updates, so the device, then
makes no more than a code of difference (docs/geodesics.md)."""


def solve_tables(
    meshes: Sequence[TriangleMesh],
    d_max: float | Sequence[float],
    *,
    device: str = "cpu",
    memory_limit: int | None = None,
    element: Element = "point",
    tick: Tick = no_tick,
    names: Sequence[str] | None = None,
    threads: int | None = None,
) -> list[GeodesicTable]:
    """Return the geodesic tables of a cohort's meshes.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        Closed surfaces (see `check_mesh`).
    d_max : float or sequence of float
        All vertex pairs up to this geodesic distance [mm] are stored; inf for complete tables. Distances
        up to r between arbitrary points need r plus two longest edges.
    device : str
        ``"auto"``, ``"cpu"`` or ``"cuda:<n>"``: where to solve and where the tables stay.
    memory_limit : int, optional
        Ceiling for all tables together [bytes].
    element : {"point", "linear"}
        Local solver.
    tick : Tick
        Progress and cancelling.
    names : sequence of str, optional
        Subjects, for messages.
    threads : int, optional
        Threads on the CPU, one per core if not given; the result does not depend on it.

    Raises
    ------
    InputError
        For a mesh or d_max that can't be used, or tables above the memory limit.
    """
    labels = [f"mesh {k + 1}" for k in range(len(meshes))] if names is None else list(names)
    limits = [float(d) for d in np.broadcast_to(np.asarray(d_max, float), len(meshes))]
    plan = plan_tables(meshes, limits, labels, memory_limit)
    where = choose_device(device)
    kind = ["point", "linear"].index(element)
    reaches = [local_reach(mesh, length) for mesh, length in zip(meshes, plan.reaches, strict=True)]
    if where != "cpu":
        scratch = _scratch(where, plan.nbytes)
        return solve_on_cuda(
            meshes,
            reaches,
            limits,
            labels,
            dense=plan.dense,
            element=kind,
            device=where,
            scratch=scratch,
            tick=tick,
        )
    tables = []
    for k, (mesh, label) in enumerate(zip(meshes, labels, strict=True)):
        inner = part_of(tick, k / len(meshes), (k + 1) / len(meshes))
        table = solve_on_cpu(
            mesh,
            reaches[k],
            limits[k],
            label,
            dense=plan.dense,
            element=kind,
            threads=threads or cores(),
            tick=inner,
        )
        tables.append(table)
    return tables


def solve_table(
    mesh: TriangleMesh,
    d_max: float,
    *,
    device: str = "cpu",
    element: Element = "point",
    memory_limit: int | None = None,
    tick: Tick = no_tick,
    name: str = "mesh",
    threads: int | None = None,
) -> GeodesicTable:
    """Return the geodesic table of one mesh; see `solve_tables`."""
    return solve_tables(
        [mesh],
        d_max,
        device=device,
        memory_limit=memory_limit,
        element=element,
        tick=tick,
        names=[name],
        threads=threads,
    )[0]


def local_distances(vertices: Array, faces: Array, d_max: float, device: str | None = None) -> csr_array:
    """Return the geodesic distances between all vertices of a closed triangle mesh up to d_max.

    Parameters
    ----------
    vertices : (V, 3) array
        Positions, in any unit of length.
    faces : (F, 3) int array
        Vertex indices, consistently oriented.
    d_max : float
        Longest distance; inf for all.
    device : str, optional
        ``"cpu"`` or ``"cuda:<n>"``; the first GPU if there is one, else the CPU, if not given.

    Returns
    -------
    (V, V) float32 csr_array
        Symmetric; absent entries are farther than d_max apart, the zeros of the diagonal are stored.
        Fixed-point rounding is 8e-6 d_max at most.
    """
    mesh = TriangleMesh(np.asarray(vertices), np.asarray(faces))
    return solve_table(mesh, d_max, device=device or "auto").to_csr()


def local_reach(mesh: TriangleMesh, length: float) -> Any:  # noqa: ANN401 - a wp.struct has no type
    reach = kernels.Reach()
    reach.unit = length / int(kernels.LAST)
    reach.stored = 65534 * reach.unit
    reach.slack = mesh.mean_edge
    reach.changed = CHANGED * mesh.mean_edge
    return reach


def _scratch(device: str, table_bytes: int) -> int:
    """Return how much memory a batch may take beside the tables: half of what is left."""
    free = int(wp.get_device(device).free_memory)
    left = free - 2 * table_bytes  # a shape's blocks exist twice while they are joined
    if left < free // 10:
        raise InputError(
            f"geodesic tables of {table_bytes / 1e9:.1f} GB do not fit the {free / 1e9:.1f} GB that are free "
            f"on {device}: solve on the CPU, shorten d_max or use coarser meshes"
        )
    return left // 2
