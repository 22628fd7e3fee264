"""What tables will take, before they are solved: reach, storage and memory."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from homolog.device import cores
from homolog.errors import InputError
from homolog.geodesics import kernels
from homolog.geodesics.lookup import LANES, MISSING
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, edges

__all__ = ["Element", "TablePlan", "Task", "block_rows", "plan_tables"]

Element = Literal["point", "linear"]
"""Local solver: fronts from a point, or the paper's planar fronts, which are some percent too long."""

POINT = 0
"""Number of the point element in kernels."""
DENSE_BUDGET = 1_500_000_000
"""Tables of a cohort are dense, which is faster to read, while all take no more than this [bytes] …"""
DENSE_SHAPE = 250_000_000
"""… and each no more than this (11 180 vertices)."""
DEFAULT_LIMIT = 8_000_000_000
"""Ceiling for the tables of a cohort [bytes] where the caller names none."""


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
    reach : float
        Longest distance [mm] that codes have to hold: d_max, or what the mesh allows.
    edge : float
        Mean edge [mm].
    """

    name: str
    mesh: TriangleMesh
    d_max: float
    reach: float
    edge: float

    def kernel_reach(self) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return what kernels need to know of the reach."""
        reach = kernels.Reach()
        reach.unit = self.reach / int(kernels.LAST)
        reach.stored = (MISSING - 1) * reach.unit
        reach.limit = max(reach.stored, self.reach + self.edge)
        reach.edge = self.edge
        return reach


@dataclass(frozen=True, slots=True)
class TablePlan:
    """How the tables of a cohort will be solved and stored.

    Attributes
    ----------
    tasks : tuple of Task
        One for each table.
    element : {"point", "linear"}
        Local solver.
    dense : bool
        Dense tables, or blocks.
    nbytes : int
        Predicted size of all tables [bytes]; exact for dense ones.
    """

    tasks: tuple[Task, ...]
    element: Element
    dense: bool
    nbytes: int

    @property
    def element_code(self) -> int:
        """The element's number in kernels."""
        return POINT if self.element == "point" else 1


def plan_tables(
    meshes: Sequence[TriangleMesh],
    d_max: float | Sequence[float],
    *,
    names: Sequence[str] | None = None,
    element: Element = "point",
    memory_limit: int | None = None,
    tick: Tick = no_tick,
) -> TablePlan:
    """Check the meshes, choose the storage and predict its size; parameters as for `solve_tables`.

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
    ceiling = DEFAULT_LIMIT if memory_limit is None else memory_limit
    small = dense <= DENSE_BUDGET and max(squares, default=0) <= DENSE_SHAPE
    if dense <= ceiling and (small or dense <= blocks):
        return TablePlan(tuple(tasks), element, dense=True, nbytes=dense)
    if blocks > ceiling:
        raise InputError(
            f"geodesic tables of {len(meshes)} shapes would take about {blocks / 1e9:.3g} GB, above the "
            f"limit of {ceiling / 1e9:.3g} GB: raise the limit, shorten d_max or use coarser meshes"
        )
    return TablePlan(tuple(tasks), element, dense=False, nbytes=blocks)


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
    radius = task.reach + 3.0 * task.edge  # of a cluster: about 2.5 edges
    return int(1.05 * n / LANES * min(n, n * math.pi * radius**2 / task.mesh.area))


def _block_bytes(task: Task) -> int:
    return int(2.1 * len(task.mesh.vertices) ** 2 / LANES) + 2 * LANES * block_rows(task)
