"""Encode the distances of a cluster into a table; average both directions of every pair."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cpu.kernels.patch import LaneCodes, LaneCounts, Scratch, load_code, load_lanes
from homolog.geodesics.kernels.local_solver import DistanceLimits, encode, mean_code
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.kernels.memory import load_int

# Lane loops must not be unrolled by Warp: the compiler then vectorizes them.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.func
def encode_reached(
    scratch: Scratch,
    limits: DistanceLimits,
    mesh_vertex: wp.array(dtype=wp.int32),
    reached: wp.array(dtype=wp.int32),
    block: wp.array(dtype=LaneCodes),
) -> int:
    """List the vertices that any source of a cluster reaches, as indices into the mesh, and their codes."""
    n = int(0)
    for p in range(scratch.size[0]):
        v = load_int(scratch.by_cluster, p)  # cluster by cluster: symmetrization reads rows in order
        u = load_lanes(scratch.u, v)
        codes = LaneCodes()
        any_encoded = int(0)
        for lane in range(LANES):
            in_range = u[lane] <= limits.max_encoded
            any_encoded |= wp.where(in_range, 1, 0)
            codes[lane] = encode(u[lane], limits)
        if any_encoded > 0:
            block[n] = codes
            reached[n] = mesh_vertex[v]
            n += 1
    return n


@wp.kernel
def store_block(
    scratch: Scratch,
    limits: DistanceLimits,
    mesh_vertex: wp.array(dtype=wp.int32),
    reached: wp.array(dtype=wp.int32),
    block: wp.array(dtype=LaneCodes),
    slot: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    is_near: wp.array2d(dtype=wp.uint8),
    n_rows: wp.array(dtype=wp.int32),
    cluster: int,
):
    """Write the block of one cluster, a row for every vertex that one of its sources reaches.

    Marks the clusters of these vertices as near.
    """
    n = encode_reached(scratch, limits, mesh_vertex, reached, block)
    for k in range(n):
        v = load_int(reached, k)
        row[cluster, v] = wp.uint16(k)
        is_near[cluster, slot[v] // LANES] = wp.uint8(1)
    n_rows[0] = n


# Single codes are loaded and stored: reading a whole row right after it was stored would stall the processor.
@wp.func_native("blocks.data[index].c[lane] = code;")
def store_code(blocks: wp.array(dtype=LaneCodes), index: int, lane: int, code: wp.uint16):
    """Set a code of a row."""
    ...


@wp.func
def row_of(
    start: wp.array(dtype=wp.int32), row: wp.array2d(dtype=wp.uint16), cluster: int, vertex: int, spare: int
) -> int:
    """Return a vertex's row in a cluster's block, as an index into all blocks; the spare row if absent."""
    index = int(MISSING)
    if vertex >= 0:
        index = int(row[cluster, vertex])
    return wp.where(index == MISSING, spare, start[cluster] + index)


@wp.kernel
def symmetrize_tiles(
    members: wp.array2d(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    is_near: wp.array2d(dtype=wp.uint8),
    blocks: wp.array(dtype=LaneCodes),
    first: int,
):
    """Replace both directions of every pair of a cluster and those before it by their mean.

    The last row of the blocks is spare and holds MISSING, before and after.
    """
    cluster = first + wp.tid()
    spare = blocks.shape[0] - 1
    for other in range(cluster + 1):
        if is_near[cluster, other] == wp.uint8(0) and is_near[other, cluster] == wp.uint8(0):
            continue
        reverse = LaneCounts()
        for i in range(LANES):
            reverse[i] = row_of(start, row, other, members[cluster, i], spare)
        for j in range(LANES):
            forward = row_of(start, row, cluster, members[other, j], spare)
            for i in range(LANES):
                mean = mean_code(load_code(blocks, forward, i), load_code(blocks, reverse[i], j))
                store_code(blocks, forward, i, mean)
                store_code(blocks, reverse[i], j, mean)
