"""Kernels that turn the codes of a table into the rows of a sparse matrix."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cpu.kernels.patch import LaneCodes, LaneCounts, load_code
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.kernels.memory import load_int

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.func_native("columns.data[index] = column; distances.data[index] = distance;")
def store_entry(
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
    index: wp.int64,
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
    row_end: wp.array(dtype=wp.int64),
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
):
    """Write the entries of each row; `row_end` holds where it begins, and afterwards where it ends."""
    i = wp.tid()
    k = row_end[i]
    for j in range(codes.shape[1]):
        code = int(codes[i, j])
        if code != MISSING:
            columns[k] = j
            distances[k] = float(code) * unit
            k += wp.int64(1)
    row_end[i] = k


@wp.kernel
def count_blocks(
    codes: wp.array(dtype=LaneCodes),
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
    n = LaneCounts(0)
    for k in range(start[cluster], last):
        codes_of_row = codes[k]
        for lane in range(LANES):
            n[lane] += wp.where(int(codes_of_row[lane]) != MISSING, 1, 0)
    for lane in range(LANES):
        if vertex[cluster, lane] >= 0:
            count[vertex[cluster, lane]] = wp.int64(n[lane])


@wp.kernel
def fill_blocks(
    codes: wp.array(dtype=LaneCodes),
    row: wp.array2d(dtype=wp.uint16),
    start: wp.array(dtype=wp.int32),
    vertex: wp.array2d(dtype=wp.int32),
    unit: float,
    row_end: wp.array(dtype=wp.int64),
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
    row_vertices: wp.array(dtype=wp.int32),
):
    """Write the entries of the rows of one cluster's vertices; `row_end` as in `fill_dense`.

    `row_vertices` is scratch, one entry for each vertex.
    """
    cluster = wp.tid()
    spare = wp.int64(columns.shape[0] - 1)  # in place of a branch, which would be mispredicted half the time
    n = int(0)
    for v in range(row.shape[1]):
        row_vertices[n] = v
        n += wp.where(int(row[cluster, v]) != MISSING, 1, 0)
    for lane in range(LANES):
        i = vertex[cluster, lane]
        if i >= 0:
            k = row_end[i]
            for p in range(n):
                v = load_int(row_vertices, p)
                code = load_code(codes, start[cluster] + int(row[cluster, v]), lane)
                present = code != MISSING
                store_entry(columns, distances, wp.where(present, k, spare), v, float(code) * unit)
                k += wp.int64(wp.where(present, 1, 0))
            row_end[i] = k
