"""Solve geodesic tables of meshes on the CPU or on a GPU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Protocol

import warp as wp

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

__all__ = ["GeodesicSolver", "check_room", "each_table", "solve_tables"]

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
        Surfaces, closed or with rims (see `check_mesh`).
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
