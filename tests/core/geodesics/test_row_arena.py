"""Blocks are copied unchanged, and their memory is freed."""

import numpy as np
import psutil

from homolog.geodesics.cpu.row_arena import RowArena
from homolog.geodesics.kernels.lookup import LANES


def rows(count, start=0):
    return (start + np.arange(count * LANES, dtype=np.uint32)).astype(np.uint16).reshape(count, LANES)


def test_copies_do_not_change_with_their_source():
    arena, buffer = RowArena(), np.empty((300_000, LANES), np.uint16)
    kept, expected = [], []
    counts = (1, 70_000, 70_000, 300_000, 3)  # more than a chunk holds, in all and alone
    for number, count in enumerate(counts):
        buffer[:count] = rows(count, number)
        kept.append(arena.copy_in(buffer[:count]))
        expected.append(rows(count, number))
    for rows_kept, rows_expected in zip(kept, expected, strict=True):
        np.testing.assert_array_equal(rows_kept, rows_expected)


def test_memory_is_freed_block_by_block():
    process, arena, block = psutil.Process(), RowArena(), rows(2000)
    kept = [arena.copy_in(block) for _ in range(2000)]  # 128 MB
    full = process.memory_info().rss
    del kept[:1000]
    assert process.memory_info().rss < full - 40_000_000
