"""Solve geodesic tables of meshes on the CPU or on a GPU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Protocol

import numpy as np
import warp as wp
from scipy.sparse import csr_array

from homolog.arrays import ArrayLike
from homolog.device import choose_device
from homolog.errors import InputError
from homolog.geodesics.cpu.solver import load_kernels, solve_on_cpu
from homolog.geodesics.cuda.solver import solve_on_cuda
from homolog.geodesics.plan import TablePlan, Task, plan_tables, table_bytes
from homolog.geodesics.table import GeodesicTable
from homolog.memory import free_memory
from homolog.progress import Tick, each_in_threads, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import MOST_THREADS, cores, switching_often

__all__ = ["GeodesicSolver", "check_room", "each_table", "geodesic_distances", "solve_tables"]

_SOLVER_TABLES = 4
"""The solver of a mesh needs less memory than this many of its tables."""
_FEW_THREADS = 2
"""They do not wait for the interpreter lock."""


class GeodesicSolver(Protocol):
    """Solves geodesic tables for an optimization: `solve_tables`, or another method.

    Parameters and result are those of `solve_tables`.
    """

    def __call__(
        self,
        meshes: Sequence[TriangleMesh],
        d_max: Sequence[float],
        /,
        *,
        device: str,
        names: Sequence[str],
        tick: Tick,
    ) -> Sequence[GeodesicTable]:
        """Return a table for each mesh, on the device."""
        ...


def solve_tables(
    meshes: Sequence[TriangleMesh],
    d_max: float | Sequence[float],
    *,
    device: str = "auto",
    memory_limit: int | None = None,
    names: Sequence[str] | None = None,
    tick: Tick = no_tick,
    threads: int | None = None,
) -> list[GeodesicTable]:
    """Solve the geodesic tables of a cohort's meshes.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        Surfaces, closed or with rims (see `check_surface`).
    d_max : float or sequence of float
        Longest geodesic distance [mm] to store, for all meshes or for each; inf stores all pairs. Distances
        up to r between arbitrary points need r plus twice the longest edge.
    device : str
        ``"auto"``, ``"cpu"`` or ``"cuda:<n>"``: the device that solves the tables and stores them.
    memory_limit : int, optional
        Limit for all tables together [bytes]; the free memory of the device if not given.
    names : sequence of str, optional
        Names of the subjects, for messages.
    tick : Tick
        Progress and cancellation.
    threads : int, optional
        Number of threads on the CPU; one per core if not given. The result does not depend on it.

    Returns
    -------
    list of GeodesicTable
        One table for each mesh, on the device.

    Raises
    ------
    InputError
        If a mesh or d_max is invalid, or the tables exceed the memory limit.
    """
    plan = plan_tables(meshes, d_max, names=names, memory_limit=memory_limit, tick=tick)
    tables = dict(each_table(plan, device=device, tick=tick, threads=threads))
    return [tables[index] for index in range(len(plan.tasks))]


def each_table(
    plan: TablePlan,
    *,
    device: str = "auto",
    tick: Tick = no_tick,
    threads: int | None = None,
) -> Iterator[tuple[int, GeodesicTable]]:
    """Solve the tables of a plan, and yield each as soon as it is solved.

    On the CPU several meshes are solved at once, on one thread each if there are enough meshes.

    Parameters
    ----------
    plan : TablePlan
        The plan, from `plan_tables`.
    device, tick, threads
        See `solve_tables`.

    Yields
    ------
    tuple of int and GeodesicTable
        Index of a task, and its table on the device.

    Raises
    ------
    InputError
        If the tables exceed the memory of the device.
    """
    where = choose_device(device)
    check_room(plan, where)
    if where != "cpu":
        room = (int(wp.get_device(where).free_memory) - plan.nbytes) // 2  # half of what the tables leave
        yield from enumerate(solve_on_cuda(plan, where, room, tick))
        return
    load_kernels()
    threads = min(threads or cores(), MOST_THREADS)
    largest = max(map(table_bytes, plan.tasks), default=1)
    fitting = (free_memory() - plan.nbytes) // (_SOLVER_TABLES * largest)
    at_once = max(1, min(threads, len(plan.tasks), fitting))

    def solve(task: Task, tick: Tick) -> GeodesicTable:
        return solve_on_cpu(task, threads // at_once, tick)

    works = [partial(solve, task) for task in plan.tasks]
    with switching_often() if at_once > _FEW_THREADS else nullcontext():
        yield from each_in_threads(works, tick, None, at_once)


def geodesic_distances(
    vertices: ArrayLike, faces: ArrayLike, d_max: float, *, device: str = "auto"
) -> csr_array:
    """Return the geodesic distances between all vertices of a triangle mesh up to d_max.

    The mesh may have rims, across which no path leads, and pieces, between which there are no distances.

    Parameters
    ----------
    vertices : (V, 3) array_like
        Positions, in any unit of length.
    faces : (F, 3) array_like of int
        Vertex indices, consistently oriented.
    d_max : float
        Longest distance, in the unit of the vertices; inf for all.
    device : str
        ``"auto"`` (the first GPU if there is one, else the CPU), ``"cpu"`` or ``"cuda:<n>"``.

    Returns
    -------
    (V, V) float32 csr_array
        Symmetric. Pairs farther apart than d_max have no entry; the zeros of the diagonal are stored.
        The rounding error is at most 8e-6 d_max.

    Raises
    ------
    InputError
        If the mesh is not an oriented manifold, d_max is not positive, or the device does not exist.

    References
    ----------
    Z. Fu et al., "A fast iterative method for solving the eikonal equation on triangulated surfaces", SIAM
    Journal on Scientific Computing 33 (2011) 2468-2488; docs/geodesics.md describes the differences.

    Examples
    --------
    >>> import homolog as hl
    >>> vertices = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    >>> faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    >>> distances = hl.geodesic_distances(vertices, faces, d_max=2.0)  # an octahedron's neighbours
    >>> distances.nnz, distances[0, 2].round(3)
    (30, np.float32(1.414))
    """
    mesh = TriangleMesh(np.asarray(vertices), np.asarray(faces))
    return solve_tables([mesh], d_max, device=device)[0].to_csr()


def check_room(plan: TablePlan, device: str) -> None:
    """Check that the tables of a plan fit into the free memory of a device.

    Raises
    ------
    InputError
        If they do not, with both sizes.
    """
    free = free_memory() if device == "cpu" else int(wp.get_device(device).free_memory)
    if plan.nbytes > 0.9 * free:
        remedy = "limit the memory (files)" if device == "cpu" else "use several GPUs or the CPU"
        raise InputError(
            f"geodesic tables of {len(plan.tasks)} shapes take {plan.nbytes / 1e9:.3g} GB, but "
            f"{free / 1e9:.3g} GB are free on {device}: {remedy}, fewer particles or a core set"
        )
