"""Kernel that turns the blocks of a table into the rows of a sparse matrix."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cpu.kernels.patch import LaneCodes, load_code
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
def fill_entries(
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
    """Write the entries of the rows of one cluster's vertices (-1: a lane without one).

    `row_end` holds where each row begins, and afterwards where it ends; `row_vertices` is scratch, one entry
    for each vertex.
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
