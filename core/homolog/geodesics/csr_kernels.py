"""Kernels that turn the codes of a table into the rows of a sparse matrix."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.lookup import LANES, MISSING
from homolog.geodesics.memory_kernels import int_at
from homolog.geodesics.patch_kernels import Codes, Counts, code_at

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.func_native("columns.data[at] = column; distances.data[at] = distance;")
def put_entry(
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
    at: wp.int64,
    column: int,
    distance: float,
):
    """Write an entry."""
    ...


@wp.kernel
def count_dense(codes: wp.array2d(dtype=wp.uint16), count: wp.array(dtype=wp.int64)):
    """Count the entries of each row."""
    i = wp.tid()
    n = int(0)
    for j in range(codes.shape[1]):
        n += wp.where(int(codes[i, j]) != MISSING, 1, 0)
    count[i] = wp.int64(n)


@wp.kernel
def fill_dense(
    codes: wp.array2d(dtype=wp.uint16),
    unit: float,
    end: wp.array(dtype=wp.int64),
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
):
    """Write the entries of each row; `end` holds where it begins, and afterwards where it ends."""
    i = wp.tid()
    k = end[i]
    for j in range(codes.shape[1]):
        code = int(codes[i, j])
        if code != MISSING:
            columns[k] = j
            distances[k] = float(code) * unit
            k += wp.int64(1)
    end[i] = k


@wp.kernel
def count_blocks(
    codes: wp.array(dtype=Codes),
    row: wp.array2d(dtype=wp.uint16),
    start: wp.array(dtype=wp.int32),
    vertex: wp.array2d(dtype=wp.int32),
    count: wp.array(dtype=wp.int64),
):
    """Count the entries of the rows of one cluster's vertices (-1: a lane without one)."""
    cluster = wp.tid()
    last = codes.shape[0]
    if cluster + 1 < start.shape[0]:
        last = start[cluster + 1]
    n = Counts(0)
    for k in range(start[cluster], last):
        near = codes[k]
        for lane in range(LANES):
            n[lane] += wp.where(int(near[lane]) != MISSING, 1, 0)
    for lane in range(LANES):
        if vertex[cluster, lane] >= 0:
            count[vertex[cluster, lane]] = wp.int64(n[lane])


@wp.kernel
def fill_blocks(
    codes: wp.array(dtype=Codes),
    row: wp.array2d(dtype=wp.uint16),
    start: wp.array(dtype=wp.int32),
    vertex: wp.array2d(dtype=wp.int32),
    unit: float,
    end: wp.array(dtype=wp.int64),
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
    reached: wp.array(dtype=wp.int32),
):
    """Write the entries of the rows of one cluster's vertices; `end` as in `fill_dense`.

    `reached` is scratch, one entry for each vertex.
    """
    cluster = wp.tid()
    spare = wp.int64(columns.shape[0] - 1)  # in place of a branch, which would be mispredicted half the time
    n = int(0)
    for v in range(row.shape[1]):
        reached[n] = v
        n += wp.where(int(row[cluster, v]) != MISSING, 1, 0)
    for lane in range(LANES):
        i = vertex[cluster, lane]
        if i >= 0:
            k = end[i]
            for p in range(n):
                v = int_at(reached, p)
                code = code_at(codes, start[cluster] + int(row[cluster, v]), lane)
                there = code != MISSING
                put_entry(columns, distances, wp.where(there, k, spare), v, float(code) * unit)
                k += wp.int64(wp.where(there, 1, 0))
            end[i] = k
