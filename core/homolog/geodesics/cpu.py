"""Solve on the CPU: clusters of sources dealt to one thread per core."""

import itertools
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from homolog.errors import InputError
from homolog.geodesics import (
    amend_kernels,
    fan_kernels,
    kernels,
    patch_kernels,
    store_kernels,
    sweep_kernels,
)
from homolog.geodesics.fans import Clusters, Fans, build_fans, find_clusters
from homolog.geodesics.intrinsic import Triangulation, triangulate
from homolog.geodesics.lookup import LANES, MISSING
from homolog.geodesics.plan import POINT, TablePlan, Task
from homolog.geodesics.shelf import Shelf
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["deal", "solve_on_cpu"]

STRIP = 8
"""Clusters whose pairs with those before them are averaged in one launch."""
Report = Callable[[float], None]
"""Takes the fraction done; may raise to stop the work."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One mesh ready to be solved."""

    task: Task
    fans: Fans  # vertices numbered by slot: what is near on the surface is then near in memory
    clusters: Clusters  # vertices numbered as in the mesh, which tables are …
    names: Any  # … and the number there of each vertex of the fans
    groups: Any
    margin: Any  # (K,) as of `fan_kernels.find_margins`
    reach: Any
    element: int

    @property
    def n_vertices(self) -> int:
        return len(self.clusters.slot)

    def solver(self) -> tuple[Any, Callable[[int], None]]:
        """Return scratch for one thread, and what solves a cluster into it."""
        n = self.n_vertices
        scratch = patch_kernels.Scratch()
        scratch.u = wp.full(
            n, patch_kernels.Lanes(float(kernels.FAR)), dtype=patch_kernels.Lanes, device="cpu"
        )
        flags = n + 2 * patch_kernels.TOGETHER
        scratch.dirty = wp.zeros(flags, dtype=wp.uint8, device="cpu")
        scratch.place = wp.full(n, flags - 1, dtype=wp.int32, device="cpu")
        for name in ("patch", "found", "bin"):
            setattr(scratch, name, wp.zeros(n, dtype=wp.int32, device="cpu"))
        scratch.bucket = wp.zeros(int(patch_kernels.BUCKETS) + 1, dtype=wp.int32, device="cpu")
        scratch.size = wp.zeros(1, dtype=wp.int32, device="cpu")
        fans = self.fans
        inputs = [scratch, fans.position, fans.start, fans.corners, self.margin, self.reach, self.groups]
        sweep = _recorded(sweep_kernels.sweep_cluster, 1, [*inputs, self.element, 0])
        if self.element != POINT:  # planar fronts know no bearings
            return scratch, lambda cluster: _launch(sweep, cluster)
        inputs = [scratch, self._amendments(), fans.start, fans.corners, fans.turns, self.reach]
        amend = _recorded(amend_kernels.amend_cluster, 1, inputs)

        def solve(cluster: int) -> None:
            _launch(sweep, cluster)
            amend.launch()

        return scratch, solve

    def _amendments(self) -> Any:  # noqa: ANN401
        amends = amend_kernels.Amendments()
        ties = len(self.fans.corners)
        for size, kind, names in (
            (self.n_vertices, patch_kernels.Lanes, ("bearing", "trust", "amendment")),
            (self.n_vertices, wp.int32, ("found", "order", "rivals", "moved", "settled", "end")),
            (ties, wp.int32, ("a", "b")),
            (ties, patch_kernels.Lanes, ("share", "gain")),
        ):
            for name in names:
                setattr(amends, name, wp.zeros(size, dtype=kind, device="cpu"))
        amends.shortest = self.fans.shortest
        return amends


def _by_clusters(task: Task, delaunay: Triangulation, clusters: Clusters, element: int) -> Problem:
    """Return the problem with vertices numbered by slot."""
    names = np.argsort(clusters.slot).astype(np.int32)
    number = np.empty_like(names)
    number[names] = np.arange(len(names), dtype=np.int32)
    mesh = TriangleMesh(task.mesh.vertices[names], number[task.mesh.faces])
    fans = build_fans([mesh], replace(delaunay, tail=number[delaunay.tail], turn=delaunay.turn[names]), "cpu")
    there = clusters.members >= 0
    members = np.where(there, number[clusters.members], -1)
    places = fans.position.numpy()[members]
    centres = np.sum(places, axis=1, where=there[..., None]) / there.sum(axis=1, keepdims=True)
    apart = np.linalg.norm(places - centres[:, None], axis=2)
    groups = patch_kernels.Groups()
    groups.members = wp.array(members, dtype=wp.int32, device="cpu")
    groups.centre = wp.array(centres, dtype=wp.vec3, device="cpu")
    groups.radius = wp.array(np.max(apart, axis=1, where=there, initial=0.0), dtype=wp.float32, device="cpu")
    named = wp.array(names, dtype=wp.int32, device="cpu")
    margin = wp.empty(len(fans.corners), dtype=wp.float32, device="cpu")
    inputs = [fans.start, fans.corners, margin]
    wp.launch(fan_kernels.find_margins, len(names), inputs=inputs, device="cpu")
    return Problem(task, fans, clusters, named, groups, margin, task.kernel_reach(), element)


def solve_on_cpu(plan: TablePlan, which: int, threads: int, tick: Tick) -> GeodesicTable:
    """Return the table of one of a plan's meshes; the same, to the bit, for any number of threads."""
    task = plan.tasks[which]

    def report(done: float) -> None:
        tick(done, f"geodesic distances of {task.name}")

    report(0.0)
    # before the threads, which would each load them
    for module in (kernels, sweep_kernels, amend_kernels, store_kernels):
        wp.load_module(module, device="cpu")
    delaunay = triangulate([task.mesh])
    clusters = find_clusters(delaunay)
    problem = _by_clusters(task, delaunay, clusters, plan.element_code)
    arrays = (_solve_dense if plan.dense else _solve_blocks)(problem, threads, report)
    return GeodesicTable(len(task.mesh.vertices), task.d_max, float(problem.reach.unit), *arrays)


def _solve_dense(problem: Problem, threads: int, report: Report) -> tuple[Any, ...]:
    n = problem.n_vertices
    codes = _missing(n, n)
    members = wp.array(problem.clusters.members, dtype=wp.int32, ndim=2, device="cpu")

    def worker() -> Callable[[int], None]:
        scratch, solve = problem.solver()
        inputs = [scratch, problem.reach, problem.names, *_rows(n), members, codes, 0]
        store = _recorded(store_kernels.store_dense, 1, inputs)

        def solve_cluster(cluster: int) -> None:
            solve(cluster)
            _launch(store, cluster)

        return solve_cluster

    deal(worker, len(problem.clusters.members), threads, lambda done: report(0.95 * done))
    strips = -(-n // store_kernels.TILE)

    def symmetrize(strip: int) -> None:
        wp.launch(store_kernels.symmetrize_strip, 1, inputs=[codes, strip], device="cpu")

    deal(lambda: symmetrize, strips, threads, lambda done: report(0.95 + 0.05 * done))
    return (codes,)


def _missing(n_rows: int, n_columns: int) -> Any:  # noqa: ANN401
    """Return a table without codes; numpy fills it in a fifth of the time that Warp takes on a CPU."""
    return wp.array(np.full((n_rows, n_columns), MISSING, np.uint16), device="cpu", copy=False)


def _rows(n_vertices: int) -> tuple[Any, Any]:
    """Return room for the vertices that a cluster reaches, and for their codes."""
    return (
        wp.empty(n_vertices, dtype=wp.int32, device="cpu"),
        wp.empty(n_vertices, dtype=patch_kernels.Codes, device="cpu"),
    )


def _solve_blocks(problem: Problem, threads: int, report: Report) -> tuple[Any, ...]:
    n, n_clusters = problem.n_vertices, len(problem.clusters.members)
    row = _missing(n_clusters, n)
    near = wp.zeros((n_clusters, n_clusters), dtype=wp.uint8, device="cpu")
    slot = wp.array(problem.clusters.slot, dtype=wp.int32, device="cpu")
    blocks: list[Any] = [None] * n_clusters

    def worker() -> Callable[[int], None]:
        scratch, solve = problem.solver()
        reached, block = _rows(n)
        n_rows = wp.zeros(1, dtype=wp.int32, device="cpu")
        inputs = [scratch, problem.reach, problem.names, reached, block, slot, row, near, n_rows, 0]
        store = _recorded(store_kernels.store_block, 1, inputs)
        rows, count, shelf = block.numpy(), n_rows.numpy(), Shelf()

        def solve_cluster(cluster: int) -> None:
            solve(cluster)
            _launch(store, cluster)
            if count[0] >= MISSING:
                raise InputError(
                    f"{problem.task.name}: d_max reaches over more than 65534 vertices; choose a shorter one"
                )
            blocks[cluster] = shelf.keep(rows[: count[0]])

        return solve_cluster

    deal(worker, n_clusters, threads, lambda done: report(0.95 * done))
    starts = np.concatenate([[0], np.cumsum([len(block) for block in blocks])])
    codes = wp.empty((int(starts[-1]) + 1, LANES), dtype=wp.uint16, device="cpu")
    together = codes.numpy()
    for cluster in range(n_clusters):
        together[starts[cluster] : starts[cluster + 1]] = blocks[cluster]
        blocks[cluster] = None  # memory goes back as the copy grows
    together[-1] = MISSING
    start = wp.array(starts[:-1].astype(np.int32), dtype=wp.int32, device="cpu")
    lanes = wp.array(together, dtype=patch_kernels.Codes, device="cpu", copy=False)

    members = wp.array(problem.clusters.members, dtype=wp.int32, ndim=2, device="cpu")

    def symmetrize(strip: int) -> None:
        first = strip * STRIP
        inputs = [members, start, row, near, lanes, first]
        dim = min(STRIP, n_clusters - first)
        wp.launch(store_kernels.symmetrize_tiles, dim, inputs=inputs, device="cpu")

    deal(lambda: symmetrize, -(-n_clusters // STRIP), threads, lambda done: report(0.95 + 0.05 * done))
    return codes[:-1], row, start, slot


def deal(worker: Callable[[], Callable[[int], None]], n_items: int, threads: int, report: Report) -> None:
    """Deal items to threads until all are done; report from the calling thread, which may raise to stop.

    Parameters
    ----------
    worker : callable
        Called once in each thread: allocates scratch and returns the function that does one item.
    """
    items = itertools.count()  # next() on it is atomic
    stop = threading.Event()
    done = [0] * threads
    failures: list[BaseException] = []

    def loop(thread: int) -> None:
        try:
            work = worker()
            while not stop.is_set() and (item := next(items)) < n_items:
                work(item)
                done[thread] += 1
        except BaseException as failure:  # noqa: BLE001 - raised again by the calling thread
            failures.append(failure)
            stop.set()

    pool = [threading.Thread(target=loop, args=(k,), daemon=True) for k in range(threads)]
    for thread in pool:
        thread.start()
    try:
        while alive := [thread for thread in pool if thread.is_alive()]:
            alive[0].join(0.1)
            report(sum(done) / max(n_items, 1))
    finally:
        stop.set()
        for thread in pool:
            thread.join()
    if failures:
        raise failures[0]
    report(1.0)


def _recorded(kernel: Any, dim: int, inputs: list[Any]) -> Any:  # noqa: ANN401
    """Return a launch on the CPU whose last parameter, the cluster, is set anew each time."""
    return wp.launch(kernel, dim, inputs=inputs, device="cpu", record_cmd=True)


def _launch(command: Any, cluster: int) -> None:  # noqa: ANN401
    command.set_param_by_name("cluster", cluster)
    command.launch()
