"""Blocks are kept as they were, and leave no memory behind."""

import numpy as np
import psutil

from homolog.geodesics.lookup import LANES
from homolog.geodesics.shelf import Shelf


def rows(count, start=0):
    return (start + np.arange(count * LANES, dtype=np.uint32)).astype(np.uint16).reshape(count, LANES)


def test_what_is_kept_stays_as_it_was():
    shelf, buffer = Shelf(), np.empty((300_000, LANES), np.uint16)
    kept, expected = [], []
    counts = (1, 70_000, 70_000, 300_000, 3)  # more than a piece holds, in all and alone
    for number, count in enumerate(counts):
        buffer[:count] = rows(count, number)
        kept.append(shelf.keep(buffer[:count]))
        expected.append(rows(count, number))
    for one, other in zip(kept, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_memory_goes_back_block_by_block():
    process, shelf, block = psutil.Process(), Shelf(), rows(2000)
    kept = [shelf.keep(block) for _ in range(2000)]  # 128 MB
    full = process.memory_info().rss
    del kept[:1000]
    assert process.memory_info().rss < full - 40_000_000
