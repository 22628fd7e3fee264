"""Solve the table of a mesh on the CPU: clusters of sources in parallel, one thread per core."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from operator import length_hint
from typing import Any

import numpy as np
import warp as wp

from homolog.errors import InputError
from homolog.geodesics.cpu.kernels import patch as patch_kernels
from homolog.geodesics.cpu.kernels import store as store_kernels
from homolog.geodesics.cpu.kernels import sweep as sweep_kernels
from homolog.geodesics.cpu.row_arena import RowArena
from homolog.geodesics.kernels import local_solver
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.mesh.fans import Clusters, Fans, build_fans, find_clusters
from homolog.geodesics.mesh.intrinsic import Triangulation, triangulate
from homolog.geodesics.plan import TablePlan, Task
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["parallel_for", "solve_on_cpu"]

CLUSTERS_PER_LAUNCH = 8
"""Clusters that are symmetrized in one launch."""
Report = Callable[[float], None]
"""Takes the fraction done; may raise to cancel."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedMesh:
    """One mesh ready to be solved."""

    task: Task
    fans: Fans  # vertices renumbered by slot: neighbours on the surface are then neighbours in memory
    clusters: Clusters  # vertices numbered as in the mesh
    mesh_vertex: Any  # (V,) vertex of the mesh for each vertex of the fans
    groups: Any
    limits: Any

    @property
    def n_vertices(self) -> int:
        """Number of vertices of the mesh."""
        return len(self.clusters.slot)

    def solver(self) -> tuple[Any, Callable[[int], None]]:
        """Allocate the scratch memory of a thread; return it and a function that solves a cluster into it."""
        n = self.n_vertices
        scratch = patch_kernels.Scratch()
        scratch.u = wp.full(
            n, patch_kernels.Lanes(float(local_solver.UNREACHED)), dtype=patch_kernels.Lanes, device="cpu"
        )
        flags = n + 2 * patch_kernels.FLAGS_PER_WORD
        scratch.active = wp.zeros(flags, dtype=wp.uint8, device="cpu")
        scratch.patch_index = wp.full(n, flags - 1, dtype=wp.int32, device="cpu")
        for name in ("patch", "by_cluster", "bucket_index"):
            setattr(scratch, name, wp.zeros(n, dtype=wp.int32, device="cpu"))
        scratch.bucket = wp.zeros(int(patch_kernels.N_BUCKETS) + 1, dtype=wp.int32, device="cpu")
        scratch.size = wp.zeros(1, dtype=wp.int32, device="cpu")
        fans = self.fans
        inputs = [scratch, fans.position, fans.start, fans.corners, fans.margin, self.limits, self.groups]
        sweep = _recorded(sweep_kernels.sweep_cluster, 1, [*inputs, 0])
        return scratch, lambda cluster: _launch(sweep, cluster)


def _prepare(task: Task, delaunay: Triangulation, clusters: Clusters) -> PreparedMesh:
    """Renumber the vertices by slot and compute what the kernels need."""
    mesh_vertex = np.argsort(clusters.slot).astype(np.int32)
    number = np.empty_like(mesh_vertex)
    number[mesh_vertex] = np.arange(len(mesh_vertex), dtype=np.int32)
    mesh = TriangleMesh(task.mesh.vertices[mesh_vertex], number[task.mesh.faces])
    fans = build_fans(
        [mesh],
        replace(delaunay, tail=number[delaunay.tail]),
        "cpu",
    )
    is_member = clusters.members >= 0
    members = np.where(is_member, number[clusters.members], -1)
    positions = fans.position.numpy()[members]
    centres = np.sum(positions, axis=1, where=is_member[..., None]) / is_member.sum(axis=1, keepdims=True)
    distances = np.linalg.norm(positions - centres[:, None], axis=2)
    groups = patch_kernels.Groups()
    groups.members = wp.array(members, dtype=wp.int32, device="cpu")
    groups.centre = wp.array(centres, dtype=wp.vec3, device="cpu")
    groups.radius = wp.array(
        np.max(distances, axis=1, where=is_member, initial=0.0), dtype=wp.float32, device="cpu"
    )
    mesh_vertex_array = wp.array(mesh_vertex, dtype=wp.int32, device="cpu")
    return PreparedMesh(task, fans, clusters, mesh_vertex_array, groups, task.kernel_limits())


def solve_on_cpu(plan: TablePlan, which: int, threads: int, tick: Tick) -> GeodesicTable:
    """Solve the table of one mesh of a plan; the result is bit-identical for any number of threads.

    Parameters
    ----------
    plan : TablePlan
        The plan of all meshes.
    which : int
        Index of the mesh.
    threads : int
        Number of threads.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    GeodesicTable
    """
    task = plan.tasks[which]

    def report(done: float) -> None:
        tick(done, f"geodesic distances of {task.name}")

    report(0.0)
    # otherwise each thread would load them
    for module in (local_solver, sweep_kernels, store_kernels):
        wp.load_module(module, device="cpu")
    delaunay = triangulate([task.mesh])
    clusters = find_clusters(delaunay)
    prepared = _prepare(task, delaunay, clusters)
    arrays = _solve_clusters(prepared, threads, report)
    return GeodesicTable(len(task.mesh.vertices), task.d_max, float(prepared.limits.unit), *arrays)


def _solve_clusters(prepared: PreparedMesh, threads: int, report: Report) -> tuple[Any, ...]:
    n, n_clusters = prepared.n_vertices, len(prepared.clusters.members)
    row = wp.array(np.full((n_clusters, n), MISSING, np.uint16), device="cpu", copy=False)
    is_near = wp.zeros((n_clusters, n_clusters), dtype=wp.uint8, device="cpu")
    slot = wp.array(prepared.clusters.slot, dtype=wp.int32, device="cpu")
    blocks: list[Any] = [None] * n_clusters

    def worker() -> Callable[[int], None]:
        scratch, solve = prepared.solver()
        reached = wp.empty(n, dtype=wp.int32, device="cpu")
        block = wp.empty(n, dtype=patch_kernels.LaneCodes, device="cpu")
        n_rows = wp.zeros(1, dtype=wp.int32, device="cpu")
        inputs = [
            scratch,
            prepared.limits,
            prepared.mesh_vertex,
            reached,
            block,
            slot,
            row,
            is_near,
            n_rows,
            0,
        ]
        store = _recorded(store_kernels.store_block, 1, inputs)
        rows, count, arena = block.numpy(), n_rows.numpy(), RowArena()

        def solve_cluster(cluster: int) -> None:
            solve(cluster)
            _launch(store, cluster)
            if count[0] >= MISSING:
                raise InputError(
                    f"{prepared.task.name}: d_max reaches over more than 65534 vertices; choose a shorter one"
                )
            blocks[cluster] = arena.copy_in(rows[: count[0]])

        return solve_cluster

    parallel_for(worker, n_clusters, threads, lambda done: report(0.95 * done))
    codes, start = _joined(blocks)
    arrays = (codes, start, row, is_near)
    _symmetrize(prepared, arrays, threads, lambda done: report(0.95 + 0.05 * done))
    return codes[:-1], row, start, slot


def _joined(blocks: list[Any]) -> tuple[Any, Any]:
    """Join the blocks, and add a spare row of MISSING; return the codes and the first row of each block."""
    starts = np.concatenate([[0], np.cumsum([len(block) for block in blocks])])
    codes = wp.empty((int(starts[-1]) + 1, LANES), dtype=wp.uint16, device="cpu")
    joined = codes.numpy()
    for cluster in range(len(blocks)):
        joined[starts[cluster] : starts[cluster + 1]] = blocks[cluster]
        blocks[cluster] = None  # free it while the copy grows
    joined[-1] = MISSING
    return codes, wp.array(starts[:-1].astype(np.int32), dtype=wp.int32, device="cpu")


def _symmetrize(prepared: PreparedMesh, arrays: tuple[Any, ...], threads: int, report: Report) -> None:
    """Replace both directions of every pair by their mean, in place."""
    codes, start, row, is_near = arrays
    n_clusters = len(prepared.clusters.members)
    lanes = wp.array(codes.numpy(), dtype=patch_kernels.LaneCodes, device="cpu", copy=False)
    members = wp.array(prepared.clusters.members, dtype=wp.int32, ndim=2, device="cpu")

    def symmetrize(strip: int) -> None:
        first = strip * CLUSTERS_PER_LAUNCH
        inputs = [members, start, row, is_near, lanes, first]
        dim = min(CLUSTERS_PER_LAUNCH, n_clusters - first)
        wp.launch(store_kernels.symmetrize_tiles, dim, inputs=inputs, device="cpu")

    parallel_for(lambda: symmetrize, -(-n_clusters // CLUSTERS_PER_LAUNCH), threads, report)


def parallel_for(
    worker: Callable[[], Callable[[int], None]], n_items: int, threads: int, report: Report
) -> None:
    """Process items in parallel from a shared counter; report from the calling thread, which may cancel.

    Parameters
    ----------
    worker : callable
        Called once in each thread: allocates scratch memory and returns the function that processes one item.
    n_items : int
        Items are 0 … n_items - 1.
    threads : int
        Number of threads.
    report : callable
        Takes the fraction done.
    """
    items, stop = iter(range(n_items)), threading.Event()  # the threads share the iterator: next() is atomic

    def loop() -> None:
        try:
            work = worker()
            while not stop.is_set() and (item := next(items, None)) is not None:
                work(item)
        finally:
            stop.set()  # no items are left, or one has failed

    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(loop) for _ in range(threads)]
        try:
            while wait(futures, 0.1).not_done:
                report(1.0 - length_hint(items) / max(n_items, 1))
        finally:
            stop.set()
    for future in futures:
        future.result()
    report(1.0)


def _recorded(kernel: Any, dim: int, inputs: list[Any]) -> Any:  # noqa: ANN401
    """Record a launch on the CPU whose last parameter, the cluster, is set before each replay."""
    return wp.launch(kernel, dim, inputs=inputs, device="cpu", record_cmd=True)


def _launch(command: Any, cluster: int) -> None:  # noqa: ANN401
    command.set_param_by_name("cluster", cluster)
    command.launch()
