"""Kernels that store what was solved for a cluster, and average both directions."""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.kernels import Reach, encode, mean_code
from homolog.geodesics.lookup import LANES, MISSING
from homolog.geodesics.memory_kernels import int_at
from homolog.geodesics.patch_kernels import Codes, Counts, Scratch, code_at, lanes_at

# A lane loop has to stay a loop: the compiler then turns it into vector instructions.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

TILE = 32
"""Rows and columns of a dense table that are averaged with what mirrors them, one tile after another."""


@wp.func_native("codes.data[wp::int64(i) * codes.shape[1] + j] = code;")
def put_dense(codes: wp.array2d(dtype=wp.uint16), i: int, j: int, code: int):
    """Set a code of a dense table."""
    ...


@wp.func_native("return codes.data[wp::int64(i) * codes.shape[1] + j];")
def dense_at(codes: wp.array2d(dtype=wp.uint16), i: int, j: int) -> int:
    """Return a code of a dense table."""
    ...


@wp.func
def encode_reached(
    scratch: Scratch,
    reach: Reach,
    names: wp.array(dtype=wp.int32),
    reached: wp.array(dtype=wp.int32),
    block: wp.array(dtype=Codes),
) -> int:
    """List the vertices that any source of a cluster reaches, by the mesh's numbers, and their codes."""
    n = int(0)
    for p in range(scratch.size[0]):
        v = int_at(scratch.found, p)  # by clusters: both directions of a pair are then read in a row
        u = lanes_at(scratch.u, v)
        codes = Codes()
        some = int(0)
        for lane in range(LANES):
            stored = u[lane] <= reach.stored
            some |= wp.where(stored, 1, 0)
            codes[lane] = encode(u[lane], reach)
        if some > 0:
            block[n] = codes
            reached[n] = names[v]
            n += 1
    return n


@wp.kernel
def store_dense(
    scratch: Scratch,
    reach: Reach,
    names: wp.array(dtype=wp.int32),
    reached: wp.array(dtype=wp.int32),
    block: wp.array(dtype=Codes),
    members: wp.array2d(dtype=wp.int32),
    codes: wp.array2d(dtype=wp.uint16),
    cluster: int,
):
    """Write the rows of one cluster's sources, which hold MISSING so far."""
    n = encode_reached(scratch, reach, names, reached, block)
    for lane in range(LANES):
        m = members[cluster, lane]
        if m >= 0:
            for k in range(n):
                put_dense(codes, m, int_at(reached, k), code_at(block, k, lane))


@wp.kernel
def store_block(
    scratch: Scratch,
    reach: Reach,
    names: wp.array(dtype=wp.int32),
    reached: wp.array(dtype=wp.int32),
    block: wp.array(dtype=Codes),
    slot: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    near: wp.array2d(dtype=wp.uint8),
    n_rows: wp.array(dtype=wp.int32),
    cluster: int,
):
    """Write the block of one cluster, a row for every vertex that one of its sources reaches.

    Marks the clusters of these vertices as near.
    """
    n = encode_reached(scratch, reach, names, reached, block)
    for k in range(n):
        v = int_at(reached, k)
        row[cluster, v] = wp.uint16(k)
        near[cluster, slot[v] // LANES] = wp.uint8(1)
    n_rows[0] = n


# Single codes are read and written in memory: a row that is changed as a whole, and read again before it is
# written, makes the processor wait.
@wp.func_native("blocks.data[at].c[lane] = code;")
def put_code(blocks: wp.array(dtype=Codes), at: int, lane: int, code: wp.uint16):
    """Set a code of a row."""
    ...


@wp.func
def row_of(
    start: wp.array(dtype=wp.int32), row: wp.array2d(dtype=wp.uint16), cluster: int, vertex: int, spare: int
) -> int:
    """Return the row of a vertex in a cluster's block, counted through all blocks; the spare one if none."""
    at = int(MISSING)
    if vertex >= 0:
        at = int(row[cluster, vertex])
    return wp.where(at == MISSING, spare, start[cluster] + at)


@wp.kernel
def symmetrize_tiles(
    members: wp.array2d(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    row: wp.array2d(dtype=wp.uint16),
    near: wp.array2d(dtype=wp.uint8),
    blocks: wp.array(dtype=Codes),
    first: int,
):
    """Replace both directions of every pair of a cluster and those before it by their mean.

    The last row of the blocks is spare and holds MISSING, before and after.
    """
    cluster = first + wp.tid()
    spare = blocks.shape[0] - 1
    for other in range(cluster + 1):
        if near[cluster, other] == wp.uint8(0) and near[other, cluster] == wp.uint8(0):
            continue
        back = Counts()
        for i in range(LANES):
            back[i] = row_of(start, row, other, members[cluster, i], spare)
        for j in range(LANES):
            there = row_of(start, row, cluster, members[other, j], spare)
            for i in range(LANES):
                mean = mean_code(code_at(blocks, there, i), code_at(blocks, back[i], j))
                put_code(blocks, there, i, mean)
                put_code(blocks, back[i], j, mean)


@wp.kernel
def symmetrize_strip(codes: wp.array2d(dtype=wp.uint16), strip: int):
    """Replace both directions of every pair by their mean, for TILE rows and what mirrors them."""
    n = wp.min(TILE * strip + TILE, codes.shape[0])
    for tile in range(strip + 1):
        for i in range(TILE * strip, n):
            j = TILE * tile
            end = wp.min(TILE * tile + TILE, i)
            while j < end:
                there = dense_at(codes, i, j)
                back = dense_at(codes, j, i)
                if wp.min(there, back) != MISSING:  # most pairs are far apart
                    mean = int(mean_code(there, back))
                    put_dense(codes, i, j, mean)
                    put_dense(codes, j, i, mean)
                j += 1
