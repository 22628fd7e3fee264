"""Kernels that turn the codes of a table into the rows of a sparse matrix."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.lookup import LANES, MISSING

wp.set_module_options({"enable_backward": False})


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
    codes: wp.array2d(dtype=wp.uint16),
    row: wp.array2d(dtype=wp.uint16),
    start: wp.array(dtype=wp.int32),
    vertex: wp.array2d(dtype=wp.int32),
    count: wp.array(dtype=wp.int64),
):
    """Count the entries of the rows of one cluster's vertices (-1: a lane without one)."""
    cluster = wp.tid()
    for v in range(row.shape[1]):
        near = int(row[cluster, v])
        if near != MISSING:
            for lane in range(LANES):
                source = vertex[cluster, lane]
                if source >= 0 and int(codes[start[cluster] + near, lane]) != MISSING:
                    count[source] += wp.int64(1)


@wp.kernel
def fill_blocks(
    codes: wp.array2d(dtype=wp.uint16),
    row: wp.array2d(dtype=wp.uint16),
    start: wp.array(dtype=wp.int32),
    vertex: wp.array2d(dtype=wp.int32),
    unit: float,
    end: wp.array(dtype=wp.int64),
    columns: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
):
    """Write the entries of the rows of one cluster's vertices; `end` as in `fill_dense`."""
    cluster = wp.tid()
    for v in range(row.shape[1]):
        near = int(row[cluster, v])
        if near != MISSING:
            for lane in range(LANES):
                source = vertex[cluster, lane]
                code = int(codes[start[cluster] + near, lane])
                if source >= 0 and code != MISSING:
                    k = end[source]
                    columns[k] = v
                    distances[k] = float(code) * unit
                    end[source] = k + wp.int64(1)
