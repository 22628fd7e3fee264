"""Solve the table of a mesh on the CPU: clusters of sources one after another, or in parallel."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import Array
from homolog.device import shared
from homolog.errors import InputError
from homolog.geodesics.cpu.kernels import patch as patch_kernels
from homolog.geodesics.cpu.kernels import store as store_kernels
from homolog.geodesics.cpu.kernels import sweep as sweep_kernels
from homolog.geodesics.kernels import fans, intrinsic, local_solver, lookup
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.mesh.fans import Clusters, build_fans, find_clusters, group_members
from homolog.geodesics.mesh.intrinsic import triangulate
from homolog.geodesics.plan import Task, block_rows
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import in_threads

__all__ = ["solve_on_cpu"]

CLUSTERS_PER_LAUNCH = 8
"""Clusters that are symmetrized in one launch."""
Report = Callable[[float], None]
"""Takes the fraction done; may raise to cancel."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedMesh:
    """One mesh ready to be solved."""

    task: Task
    clusters: Clusters  # vertices numbered as in the mesh
    mesh_vertex: Any  # (V,) vertex of the mesh for each vertex of the fans
    fans: Any  # vertices renumbered by slot: neighbours on the surface are then neighbours in memory
    groups: Any
    limits: Any


def _prepare(task: Task) -> PreparedMesh:
    """Renumber the vertices by slot and compute what the kernels need."""
    delaunay = triangulate([task.mesh])
    clusters = find_clusters(delaunay)
    mesh_vertex = np.argsort(clusters.slot).astype(np.int32)
    number = np.empty_like(mesh_vertex)
    number[mesh_vertex] = np.arange(len(mesh_vertex), dtype=np.int32)
    mesh = TriangleMesh(task.mesh.vertices[mesh_vertex], number[task.mesh.faces])
    sides = replace(delaunay.sides, tail=number[delaunay.sides.tail])
    fans = build_fans([mesh], replace(delaunay, sides=sides), "cpu")
    members = np.where(clusters.members >= 0, number[clusters.members], -1)
    groups = group_members(members, fans.position.numpy()[members], "cpu")
    return PreparedMesh(task, clusters, shared(mesh_vertex), fans, groups, task.kernel_limits())


def load_kernels() -> None:
    """Load the kernels of `solve_on_cpu`; otherwise each of several threads would load them."""
    for module in (local_solver, intrinsic, fans, lookup, sweep_kernels, store_kernels):
        wp.load_module(module, device="cpu")


def solve_on_cpu(task: Task, threads: int, tick: Tick) -> GeodesicTable:
    """Solve the table of one mesh; the result is bit-identical for any number of threads."""

    def report(done: float) -> None:
        tick(done, f"geodesic distances of {task.name}")

    report(0.0)
    prepared = _prepare(task)
    arrays = _solve_clusters(prepared, threads, report)
    return GeodesicTable(len(task.mesh.vertices), task.d_max, float(prepared.limits.unit), *arrays)


class _Worker:
    """Solves clusters one after another, in scratch memory of its own."""

    def __init__(self, prepared: PreparedMesh, slot: Any, row: Any, is_near: Any) -> None:  # noqa: ANN401
        n, limits = len(prepared.clusters.slot), prepared.limits
        scratch = patch_kernels.Scratch()
        unreached = patch_kernels.Lanes(float(local_solver.UNREACHED))
        scratch.u = wp.full(n, unreached, dtype=patch_kernels.Lanes, device="cpu")
        flags = n + 2 * patch_kernels.FLAGS_PER_WORD
        scratch.active = wp.zeros(flags, dtype=wp.uint8, device="cpu")
        scratch.patch_index = wp.full(n, flags - 1, dtype=wp.int32, device="cpu")
        for name in ("patch", "by_cluster", "bucket_index"):
            setattr(scratch, name, wp.zeros(n, dtype=wp.int32, device="cpu"))
        scratch.bucket = wp.zeros(int(patch_kernels.N_BUCKETS) + 1, dtype=wp.int32, device="cpu")
        scratch.size = wp.zeros(1, dtype=wp.int32, device="cpu")
        reached = wp.empty(n, dtype=wp.int32, device="cpu")
        block = wp.empty(n, dtype=patch_kernels.LaneCodes, device="cpu")
        n_rows = wp.zeros(1, dtype=wp.int32, device="cpu")
        mesh = [prepared.fans, limits, prepared.groups]
        table = [limits, prepared.mesh_vertex, reached, block, slot, row, is_near, n_rows]
        self._launches = [
            wp.launch(kernel, 1, inputs=[scratch, *inputs, 0], device="cpu", record_cmd=True)
            for kernel, inputs in ((sweep_kernels.sweep_cluster, mesh), (store_kernels.store_block, table))
        ]
        self._block, self._n_rows = block.numpy(), n_rows.numpy()

    def solve(self, cluster: int) -> Array:
        """Return the block of a cluster."""
        for launch in self._launches:
            launch.set_param_by_name("cluster", cluster)
            launch.launch()
        return np.array(self._block[: self._n_rows[0]])


def _solve_clusters(prepared: PreparedMesh, threads: int, report: Report) -> tuple[Any, ...]:
    """Return the arrays of the table."""
    n_clusters, n = len(prepared.clusters.members), len(prepared.clusters.slot)
    row = wp.array(np.full((n_clusters, n), MISSING, np.uint16), device="cpu", copy=False)
    is_near = wp.zeros((n_clusters, n_clusters), dtype=wp.uint8, device="cpu")
    slot = wp.array(prepared.clusters.slot, dtype=wp.int32, device="cpu")
    local = threading.local()

    def solve(cluster: int) -> Array:
        if not hasattr(local, "worker"):
            local.worker = _Worker(prepared, slot, row, is_near)
        return local.worker.solve(cluster)  # type: ignore[no-any-return]

    joined = np.empty((block_rows(prepared.task) + 1, LANES), np.uint16)
    starts, end = np.empty(n_clusters, np.int32), 0
    for cluster, block in enumerate(in_threads(solve, range(n_clusters), threads)):
        if len(block) >= MISSING:
            raise InputError(
                f"{prepared.task.name}: d_max reaches over more than 65534 vertices; choose a shorter one"
            )
        starts[cluster], end = end, end + len(block)
        if end >= len(joined):
            joined = np.concatenate([joined, np.empty((end + end // 3 + 1 - len(joined), LANES), np.uint16)])
        joined[end - len(block) : end] = block
        report(0.95 * (cluster + 1) / n_clusters)
    joined[end] = MISSING  # the spare row of symmetrize_tiles
    codes = wp.array(joined[: end + 1], dtype=wp.uint16, ndim=2, device="cpu", copy=False)
    start = wp.array(starts, dtype=wp.int32, device="cpu")
    _symmetrize(prepared, (codes, start, row, is_near), threads, lambda done: report(0.95 + 0.05 * done))
    return codes[:-1], row, start, slot


def _symmetrize(prepared: PreparedMesh, arrays: tuple[Any, ...], threads: int, report: Report) -> None:
    """Replace both directions of every pair by their mean, in place."""
    codes, start, row, is_near = arrays
    n_clusters = len(prepared.clusters.members)
    lanes = wp.array(codes.numpy(), dtype=patch_kernels.LaneCodes, device="cpu", copy=False)
    members = wp.array(prepared.clusters.members, dtype=wp.int32, ndim=2, device="cpu")

    def symmetrize(first: int) -> None:
        inputs = [members, start, row, is_near, lanes, first]
        dim = min(CLUSTERS_PER_LAUNCH, n_clusters - first)
        wp.launch(store_kernels.symmetrize_tiles, dim, inputs=inputs, device="cpu")

    strips = range(0, n_clusters, CLUSTERS_PER_LAUNCH)
    for done, _ in enumerate(in_threads(symmetrize, strips, threads), start=1):
        report(done / len(strips))
