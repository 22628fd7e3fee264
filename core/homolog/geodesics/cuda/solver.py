"""Solve a cohort's tables on a GPU: clusters of all meshes in batches that fit its memory."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import IntArray
from homolog.errors import InputError
from homolog.geodesics.cuda.front import advance, make_front, start
from homolog.geodesics.cuda.kernels import block as block_kernels
from homolog.geodesics.cuda.kernels import store as store_kernels
from homolog.geodesics.kernels import local_solver
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.mesh.fans import Clusters, build_fans, find_clusters, group_members
from homolog.geodesics.mesh.intrinsic import triangulate
from homolog.geodesics.plan import TablePlan, Task, block_rows
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick

__all__ = ["solve_on_cuda"]

_WORK_PER_LAUNCH = 900_000
"""Vertices times clusters per multiprocessor in one launch: about 0.1 s, the interval at which users can
cancel."""
_BYTES_PER_VERTEX = 4 * LANES + 8
"""Of a cluster's front: distances, flag, place in the patch."""
_LAST_INT = 2**31 - 1
"""Kernels index memory with 32-bit integers."""


@dataclass(frozen=True, slots=True, eq=False)
class DeviceCohort:
    """Meshes and clusters on the device; the clusters and first vertices of all meshes on the host, too."""

    sources: Any
    clusters: Clusters
    first: IntArray
    limits: list[Any]


def solve_on_cuda(plan: TablePlan, device: str, scratch: int, tick: Tick) -> list[GeodesicTable]:
    """Solve the tables of a plan on a GPU, with `scratch` bytes for the distances of a batch of clusters."""
    cohort = _upload(plan, device)
    ends = np.searchsorted(cohort.clusters.shape, np.arange(len(plan.tasks) + 1)).tolist()
    n_clusters = len(cohort.clusters.shape)
    n = int(np.diff(cohort.first).max())
    tables = []
    with wp.ScopedDevice(device):
        n_multiprocessors = max(1, wp.get_device().sm_count)
        fits = min(scratch // (_BYTES_PER_VERTEX * n), _LAST_INT // (LANES * n))
        batch = min(max(1, fits), max(1, _WORK_PER_LAUNCH * n_multiprocessors // n), n_clusters)
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
    first = delaunay.sides.first_vertex
    members = clusters.members + np.where(clusters.members >= 0, first[clusters.shape][:, None], 0)
    sources = block_kernels.Sources()
    sources.groups = group_members(clusters.members, fans.position.numpy()[members], device)
    sources.shape = wp.array(clusters.shape, dtype=wp.int32, device=device)
    sources.first = wp.array(first, dtype=wp.int32, device=device)
    sources.limits = wp.array(limits, dtype=local_solver.DistanceLimits, device=device)
    sources.fans = fans
    return DeviceCohort(sources, clusters, first, limits)


class _Store:
    """Encodes the distances of one mesh, batch by batch, into blocks."""

    def __init__(self, cohort: DeviceCohort, task: Task, shape: int, begin: int, end: int) -> None:
        first, last = cohort.first[shape : shape + 2]
        self._limits = cohort.limits[shape]
        self._members = cohort.sources.groups.members[begin:end]
        slot = cohort.clusters.slot[first:last] - LANES * begin
        self._slot = wp.array(slot, dtype=wp.int32)
        self._row = wp.empty((end - begin, last - first), dtype=wp.uint16)
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
