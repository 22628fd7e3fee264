"""Geodesic tables solved on a GPU."""

import numpy as np
import pytest

from homolog.geodesics import plan_tables, solve_tables
from homolog.geodesics.cuda.solver import solve_on_cuda
from homolog.progress import no_tick

pytestmark = pytest.mark.cuda


def codes_of(table):
    return table.to_csr().toarray() / table.unit


def assert_codes_agree(table, other, tolerance):
    """Compare two tables of one mesh; a pair close to d_max may be missing in one."""
    codes, others = codes_of(table), codes_of(other)
    both = (codes > 0) & (others > 0)
    assert np.abs(codes - others)[both].max() <= tolerance
    assert (np.maximum(codes, others)[(codes > 0) != (others > 0)] > 64235).all()


def test_gpu_and_cpu_agree_within_two_codes(slotted, gpu):
    here, there = (solve_tables([slotted], 8.0, device=where)[0] for where in ("cpu", gpu))
    assert_codes_agree(here, there, 2)


def test_two_runs_on_a_gpu_agree_within_two_codes(slotted, gpu):
    once, again = (solve_tables([slotted], 8.0, device=gpu)[0] for _ in range(2))
    assert_codes_agree(once, again, 2)


def test_small_batches_on_a_gpu_give_the_tables_of_a_whole_cohort(sphere, slotted, gpu):
    plan = plan_tables([sphere(400), slotted, sphere(700)], [12.0, 6.0, 9.0])
    whole, batched = (solve_on_cuda(plan, gpu, scratch, no_tick) for scratch in (10**9, 2_500_000))
    for table, other in zip(whole, batched, strict=True):
        assert_codes_agree(table, other, 2)
