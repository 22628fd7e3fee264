"""Solve a cohort's tables on a GPU: clusters of all meshes in batches that fit its memory."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.errors import InputError
from homolog.geodesics.cuda.front import (
    advance,
    largest_batch,
    make_front,
    start,
)
from homolog.geodesics.cuda.kernels import block as block_kernels
from homolog.geodesics.cuda.kernels import store as store_kernels
from homolog.geodesics.kernels import local_solver
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.mesh.fans import Clusters, Fans, build_fans, find_clusters
from homolog.geodesics.mesh.intrinsic import triangulate
from homolog.geodesics.plan import TablePlan, Task, block_rows
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick

__all__ = ["solve_on_cuda"]

_WORK_PER_LAUNCH = 900_000
"""Vertices times clusters per multiprocessor in one launch: about 0.1 s, the interval at which users can
cancel."""


@dataclass(frozen=True, slots=True, eq=False)
class DeviceCohort:
    """Meshes, clusters and distance limits on the device."""

    fans: Fans
    clusters: Clusters
    sources: Any
    limits: list[Any]

    @property
    def max_vertices(self) -> int:
        """Vertices of the largest mesh."""
        return int(np.diff(self.fans.first).max())


def solve_on_cuda(plan: TablePlan, device: str, scratch: int, tick: Tick) -> list[GeodesicTable]:
    """Solve the tables of a plan on a GPU.

    Parameters
    ----------
    plan : TablePlan
        The plan of all meshes.
    device : str
        Warp alias; the tables stay there.
    scratch : int
        Memory [bytes] on the device for the distances of one batch of clusters.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    list of GeodesicTable
        One table for each task of the plan.
    """
    cohort = _upload(plan, device)
    ends = np.searchsorted(cohort.clusters.shape, np.arange(len(plan.tasks) + 1)).tolist()
    n_clusters = len(cohort.clusters.shape)
    n = cohort.max_vertices
    tables = []
    with wp.ScopedDevice(device):
        n_multiprocessors = max(1, wp.get_device().sm_count)
        batch = min(largest_batch(n, scratch), max(1, _WORK_PER_LAUNCH * n_multiprocessors // n), n_clusters)
        front = make_front(batch, n)
        stores = [_Store(cohort, task, k, ends[k], ends[k + 1]) for k, task in enumerate(plan.tasks)]
        for begin in range(0, n_clusters, batch):
            end = min(begin + batch, n_clusters)
            shapes = range(int(cohort.clusters.shape[begin]), int(cohort.clusters.shape[end - 1]) + 1)
            message = f"geodesic distances of {plan.tasks[shapes[0]].name}"
            tick(begin / n_clusters, message)
            start(front, cohort.sources, range(begin, end))
            advance(front, cohort.sources, range(begin, end))
            for k in shapes:
                low, high = max(begin, ends[k]), min(end, ends[k + 1])
                stores[k].add(front, slice(low - begin, high - begin), low - ends[k])
                if high == ends[k + 1]:
                    task, unit = plan.tasks[k], float(cohort.limits[k].unit)
                    arrays = stores[k].finish()
                    tables.append(GeodesicTable(len(task.mesh.vertices), task.d_max, unit, *arrays))
        tick(1.0, "geodesic distances")
    return tables


def _upload(plan: TablePlan, device: str) -> DeviceCohort:
    """Triangulate and cluster the meshes on the host, and copy the results to the device."""
    meshes = [task.mesh for task in plan.tasks]
    delaunay = triangulate(meshes)
    fans, clusters = build_fans(meshes, delaunay, device), find_clusters(delaunay)
    limits = [task.kernel_limits() for task in plan.tasks]
    sources = block_kernels.Sources()
    with wp.ScopedDevice(device):
        sources.members = wp.array(clusters.members, dtype=wp.int32, ndim=2)
        sources.shape = wp.array(clusters.shape, dtype=wp.int32)
        sources.first = wp.array(fans.first.astype(np.int32), dtype=wp.int32)
        sources.limits = wp.array(limits, dtype=local_solver.DistanceLimits)
        sources.position = fans.position
        sources.fan = fans.start
        sources.corners = fans.corners
        sources.margin = fans.margin
    return DeviceCohort(fans, clusters, sources, limits)


class _Store:
    """Encodes the distances of one mesh, batch by batch, into blocks."""

    def __init__(self, cohort: DeviceCohort, task: Task, shape: int, begin: int, end: int) -> None:
        n = int(np.diff(cohort.fans.first)[shape])
        self._limits = cohort.limits[shape]
        self._members = cohort.sources.members[begin:end]
        slot = cohort.clusters.slot[cohort.fans.first[shape] : cohort.fans.first[shape + 1]] - LANES * begin
        self._slot = wp.array(slot, dtype=wp.int32)
        self._row = wp.empty((end - begin, n), dtype=wp.uint16)
        self._start = wp.empty(end - begin, dtype=wp.int32)
        self._name = task.name
        self._blocks = wp.empty((block_rows(task), LANES), dtype=wp.uint16)
        self._rows = 0

    def add(self, front: Any, which: slice, at: int) -> None:  # noqa: ANN401
        u, patch = front.u[which], front.patch[which]
        size = front.size[which]
        n_clusters, longest = len(size), int(size.numpy().max())
        reached = wp.empty((n_clusters, longest), dtype=wp.int32)
        inputs = [u, patch, size, self._limits, reached]
        wp.launch(store_kernels.mark_reached, reached.shape, inputs=inputs)
        wp.utils.array_scan(reached.flatten(), reached.flatten(), inclusive=True)
        first = self._rows
        self._rows += int(reached[n_clusters - 1, longest - 1 : longest].numpy()[0])
        self._grow(first)
        start, row = self._start[at : at + n_clusters], self._row[at : at + n_clusters]
        row.fill_(MISSING)
        inputs = [u, patch, self._limits, reached, first, start, row, self._blocks[first : self._rows]]
        wp.launch(store_kernels.store_front_blocks, reached.shape, inputs=inputs)

    def _grow(self, used: int) -> None:
        """Grow if the estimate was too low."""
        if self._rows > self._blocks.shape[0]:
            larger = wp.empty((int(1.3 * self._rows), LANES), dtype=wp.uint16)
            if used:
                wp.copy(larger[:used], self._blocks[:used])
            self._blocks = larger

    def finish(self) -> tuple[Any, ...]:
        sizes = np.diff(np.append(self._start.numpy(), self._rows))
        if sizes.max() >= MISSING:
            raise InputError(
                f"{self._name}: d_max reaches over more than 65534 vertices; choose a shorter one"
            )
        blocks = self._blocks[: self._rows]
        dim = (len(sizes), len(sizes), LANES)
        inputs = [self._members, self._start, self._row, blocks]
        wp.launch(store_kernels.symmetrize_blocks, dim, inputs=inputs)
        return blocks, self._row, self._start, self._slot
