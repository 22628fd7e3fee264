"""Plan geodesic tables before they are solved: checks of the meshes, longest distance, memory."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from homolog.errors import InputError
from homolog.geodesics.kernels import local_solver
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, edges
from homolog.threads import cores, in_threads

__all__ = ["TablePlan", "Task", "block_rows", "plan_tables", "table_bytes"]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One mesh to solve.

    Attributes
    ----------
    name : str
        Name of the subject, for messages.
    mesh : TriangleMesh
        A surface that passed `check_mesh`.
    d_max : float
        Longest distance [mm] that the table keeps.
    max_distance : float
        Longest distance [mm] to encode: d_max, or an upper bound of all distances on the mesh.
    mean_edge : float
        Mean edge length [mm].
    area : float
        Of the surface [mm²].
    """

    name: str
    mesh: TriangleMesh
    d_max: float
    max_distance: float
    mean_edge: float
    area: float

    def kernel_limits(self) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return range and resolution for kernels."""
        limits = local_solver.DistanceLimits()
        limits.unit = self.max_distance / int(local_solver.D_MAX_CODE)
        limits.max_encoded = (MISSING - 1) * limits.unit
        limits.propagation_limit = max(limits.max_encoded, self.max_distance + self.mean_edge)
        return limits


@dataclass(frozen=True, slots=True)
class TablePlan:
    """The geodesic tables of a cohort, to be solved.

    Attributes
    ----------
    tasks : tuple of Task
        One for each table.
    nbytes : int
        Predicted size of all tables [bytes], mostly within 15 %.
    """

    tasks: tuple[Task, ...]
    nbytes: int


def plan_tables(
    meshes: Sequence[TriangleMesh],
    d_max: float | Sequence[float],
    *,
    names: Sequence[str] | None = None,
    memory_limit: int | None = None,
    tick: Tick = no_tick,
) -> TablePlan:
    """Check the meshes and predict the size of their tables.

    Parameters
    ----------
    meshes, d_max, names, memory_limit, tick
        See `homolog.geodesics.solve_tables`.

    Returns
    -------
    TablePlan

    Raises
    ------
    InputError
        If `check_mesh` refuses a mesh, d_max is not positive, or the tables would exceed the limit.
    """
    labels = [f"mesh {k + 1}" for k in range(len(meshes))] if names is None else names
    limits = np.broadcast_to(np.asarray(d_max, float), len(meshes)).tolist()
    tasks = []
    for task in in_threads(
        lambda given: _task(*given), list(zip(labels, meshes, limits, strict=True)), cores()
    ):
        tick(0.0, f"mesh of {task.name} checked")
        tasks.append(task)
    nbytes = sum(table_bytes(task) for task in tasks)
    if memory_limit is not None and nbytes > memory_limit:
        raise InputError(
            f"geodesic tables of {len(meshes)} shapes would take about {nbytes / 1e9:.3g} GB, above the "
            f"limit of {memory_limit / 1e9:.3g} GB: raise the limit, shorten d_max or use coarser meshes"
        )
    return TablePlan(tuple(tasks), nbytes)


def _task(name: str, mesh: TriangleMesh, d_max: float) -> Task:
    """Check a mesh, and bound its distances if d_max exceeds the diagonal of the bounding box."""
    if not d_max > 0.0:
        raise InputError(f"{name}: d_max is {d_max}; geodesic distances need a positive length in mm")
    check_mesh(mesh, name, may_open=True)
    is_short = d_max < float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    bound = d_max if is_short else min(d_max, 2.0 * _reach(mesh))
    return Task(name, mesh, d_max, bound, mesh.mean_edge, mesh.area)


def _reach(mesh: TriangleMesh) -> float:
    """Return the largest distance along edges from the first vertex of a piece [mm]."""
    ends = edges(mesh.faces)
    lengths = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    graph = coo_array((lengths, tuple(ends.T)), shape=(len(mesh.vertices),) * 2).tocsr()
    pieces = connected_components(graph, directed=False)[1]
    firsts = np.unique(pieces, return_index=True)[1]
    return float(dijkstra(graph, directed=False, indices=firsts, min_only=True).max())


def block_rows(task: Task) -> int:
    """Estimate the number of rows in the blocks of a table from the area of a flat disc.

    Curved surfaces mostly need fewer.
    """
    n = len(task.mesh.vertices)
    radius = task.max_distance + 3.0 * task.mean_edge  # of a cluster: about 2.5 edges
    return int(1.05 * n / LANES * min(n, n * math.pi * radius**2 / task.area))


def table_bytes(task: Task) -> int:
    """Predict the size of a table [bytes]."""
    return int(2.1 * len(task.mesh.vertices) ** 2 / LANES) + 2 * LANES * block_rows(task)
