"""The front of all clusters of a batch, advanced and amended: launches of the front's kernels."""

from collections.abc import Callable
from typing import Any

import warp as wp

from homolog.geodesics import front_amend_kernels as amending
from homolog.geodesics import front_kernels
from homolog.geodesics.bearing_kernels import ROUNDS, UNKNOWN
from homolog.geodesics.lookup import LANES

__all__ = ["BYTES_PER_VERTEX", "amend_front", "make_amendments", "make_front", "run_front"]

STEPS = 16
"""Steps launched before the host looks whether anything is left to do; an idle step takes microseconds."""
ROUNDS_AT_ONCE = 4
"""Rounds of amendments launched before the host looks whether anything moved."""
BYTES_PER_VERTEX = 4 * 4 * LANES + 4 + 8 + 4
"""Scratch of a cluster for each vertex: u, bearings, rivals, amendments, queued, lists, marks."""


def make_front(batch: int, n: int, lanes: int = LANES) -> Any:  # noqa: ANN401 - a wp.struct has no type
    """Return a front of so many clusters, vertices and lanes, on the current device."""
    front = front_kernels.Front()
    front.u = wp.empty((batch, n, lanes), dtype=wp.float32)
    front.queued = wp.empty((batch, n), dtype=wp.int32)
    front.lists = wp.empty((2, batch, n), dtype=wp.int32)
    front.counts = wp.empty((3, batch), dtype=wp.int32)
    front.last = wp.empty(1, dtype=wp.int32)
    return front


def make_amendments(batch: int, n: int, lanes: int = LANES) -> Any:  # noqa: ANN401
    """Return what `amend_front` needs for such a front, on the current device."""
    amends = amending.FrontAmendments()
    amends.bearing = wp.empty((batch, n, lanes), dtype=wp.float32)
    amends.amendment = wp.empty((batch, n, lanes), dtype=wp.float32)
    amends.filled = wp.empty((batch, int(amending.BINS)), dtype=wp.int32)
    amends.rivals = wp.empty((batch, n, lanes), dtype=wp.int32)
    amends.moved = wp.empty(batch, dtype=wp.int32)
    amends.last = wp.empty(1, dtype=wp.int32)
    return amends


def run_front(front: Any, sources: Any, clusters: range, element: int, pause: Callable[[], None]) -> None:  # noqa: ANN401
    """Advance some clusters until nothing changes; the front has what is to be done in step 1."""
    threads = (len(clusters), int(front_kernels.WALKERS), front.u.shape[2])
    inputs = [front, sources, clusters.start, element, 1]
    step = wp.launch(front_kernels.step_front, threads, inputs=inputs, record_cmd=True)
    done = 0
    while int(front.last.numpy()[0]) > done:
        pause()
        for _ in range(STEPS):
            done += 1
            step.set_param_by_name("step", done)
            step.launch()


def amend_front(
    front: Any,  # noqa: ANN401
    amends: Any,  # noqa: ANN401
    sources: Any,  # noqa: ANN401
    turns: Any,  # noqa: ANN401
    clusters: range,
    pause: Callable[[], None],
) -> None:
    """Amend the distances of some clusters whose front has come to rest."""
    n_clusters, (_, n, lanes) = len(clusters), front.u.shape
    amends.bearing.fill_(float(UNKNOWN))
    amends.amendment.zero_()
    for array in (amends.filled, amends.moved, amends.last):
        array.zero_()
    wp.launch(amending.bin_reached, (n_clusters, n), inputs=[front, amends, sources, clusters.start])
    wp.launch(amending.end_rings, n_clusters, inputs=[front, amends])
    wp.launch(amending.list_reached, (n_clusters, n), inputs=[front, amends])
    walkers = 1 if front.u.device.is_cpu else int(front_kernels.WALKERS)  # on the CPU one goes near to far
    inputs = [front, amends, sources, turns, clusters.start, walkers]
    wp.launch(amending.find_front_bearings, (n_clusters, walkers, lanes), inputs=inputs)
    inputs.append(1)
    settle = wp.launch(amending.settle_front, (n_clusters, walkers, lanes), inputs=inputs, record_cmd=True)
    done = 0
    while done < int(ROUNDS) and done <= int(amends.last.numpy()[0]):
        pause()
        for _ in range(ROUNDS_AT_ONCE):
            done += 1
            settle.set_param_by_name("round", done)
            settle.launch()
    wp.launch(amending.add_amendments, (n_clusters, n, lanes), inputs=[front, amends])
