"""Plan tables before they are solved: longest distance, storage and memory."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from homolog.device import cores
from homolog.errors import InputError
from homolog.geodesics.kernels import local_solver
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, edges

__all__ = ["TablePlan", "Task", "block_rows", "plan_tables"]

DENSE_BUDGET = 1_500_000_000
"""Limit [bytes] up to which a cohort's tables are dense, which is faster to read than blocks."""
DENSE_TABLE_LIMIT = 250_000_000
"""Limit [bytes] for each dense table (11 180 vertices)."""
DENSE_LIMIT = 8_000_000_000
"""Limit [bytes] for a cohort's dense tables, also where blocks would take more."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One mesh to solve.

    Attributes
    ----------
    name : str
        Subject, for messages.
    mesh : TriangleMesh
        A surface that passed `check_mesh`.
    d_max : float
        Longest distance [mm] that the table keeps.
    max_distance : float
        Longest distance [mm] to encode: d_max, or an upper bound of all distances on the mesh.
    mean_edge : float
        Mean edge length [mm].
    """

    name: str
    mesh: TriangleMesh
    d_max: float
    max_distance: float
    mean_edge: float

    def kernel_limits(self) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return range and resolution for kernels."""
        limits = local_solver.DistanceLimits()
        limits.unit = self.max_distance / int(local_solver.D_MAX_CODE)
        limits.max_encoded = (MISSING - 1) * limits.unit
        limits.propagation_limit = max(limits.max_encoded, self.max_distance + self.mean_edge)
        return limits


@dataclass(frozen=True, slots=True)
class TablePlan:
    """How the tables of a cohort will be solved and stored.

    Attributes
    ----------
    tasks : tuple of Task
        One for each table.
    dense : bool
        Dense tables, or blocks.
    nbytes : int
        Predicted size of all tables [bytes]; exact for dense ones.
    """

    tasks: tuple[Task, ...]
    dense: bool
    nbytes: int


def plan_tables(
    meshes: Sequence[TriangleMesh],
    d_max: float | Sequence[float],
    *,
    names: Sequence[str] | None = None,
    memory_limit: int | None = None,
    tick: Tick = no_tick,
) -> TablePlan:
    """Check the meshes, choose the storage and predict its size.

    Parameters
    ----------
    meshes, d_max, names, memory_limit, tick
        As of `homolog.geodesics.solve_tables`.

    Returns
    -------
    TablePlan

    Raises
    ------
    InputError
        For a mesh that `check_mesh` refuses, for d_max that is not positive, and for tables above the limit.
    """
    labels = [f"mesh {k + 1}" for k in range(len(meshes))] if names is None else names
    limits = np.broadcast_to(np.asarray(d_max, float), len(meshes)).tolist()
    with ThreadPoolExecutor(min(cores(), 8)) as pool:
        tasks = []
        for task in pool.map(_task, labels, meshes, limits):
            tick(0.0, f"mesh of {task.name} checked")
            tasks.append(task)
    squares = [2 * len(mesh.vertices) ** 2 for mesh in meshes]
    dense, blocks = sum(squares), sum(_block_bytes(task) for task in tasks)
    ceiling = math.inf if memory_limit is None else memory_limit
    small = dense <= DENSE_BUDGET and max(squares, default=0) <= DENSE_TABLE_LIMIT
    if dense <= min(ceiling, DENSE_LIMIT) and (small or dense <= blocks):
        return TablePlan(tuple(tasks), dense=True, nbytes=dense)
    if blocks > ceiling:
        raise InputError(
            f"geodesic tables of {len(meshes)} shapes would take about {blocks / 1e9:.3g} GB, above the "
            f"limit of {ceiling / 1e9:.3g} GB: raise the limit, shorten d_max or use coarser meshes"
        )
    return TablePlan(tuple(tasks), dense=False, nbytes=blocks)


def _task(name: str, mesh: TriangleMesh, d_max: float) -> Task:
    check_mesh(mesh, name)
    if not d_max > 0.0:
        raise InputError(f"{name}: d_max is {d_max}; geodesic distances need a positive length in mm")
    return Task(name, mesh, d_max, min(d_max, _longest(mesh, d_max)), mesh.mean_edge)


def _longest(mesh: TriangleMesh, d_max: float) -> float:
    """Return an upper bound of all distances on the mesh, inf if d_max is plainly below it."""
    if d_max < np.linalg.norm(np.ptp(mesh.vertices, axis=0)):
        return math.inf
    pairs = edges(mesh.faces)
    lengths = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
    graph = coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(len(mesh.vertices),) * 2)
    return 2.0 * float(dijkstra(graph.tocsr(), directed=False, indices=np.array([0])).max())


def block_rows(task: Task) -> int:
    """Return about how many rows a block table has, from the area of a flat disc.

    Curved surfaces mostly need less.
    """
    n = len(task.mesh.vertices)
    radius = task.max_distance + 3.0 * task.mean_edge  # of a cluster: about 2.5 edges
    return int(1.05 * n / LANES * min(n, n * math.pi * radius**2 / task.mesh.area))


def _block_bytes(task: Task) -> int:
    return int(2.1 * len(task.mesh.vertices) ** 2 / LANES) + 2 * LANES * block_rows(task)
