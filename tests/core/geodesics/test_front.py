"""The CUDA solver, run on the CPU: the same kernels, with blocks of one thread."""

import numpy as np
import pytest

from homolog.geodesics import plan_tables, solve_tables
from homolog.geodesics.cuda import solver as cuda_solver
from homolog.geodesics.cuda.solver import solve_on_cuda
from homolog.progress import no_tick
from homolog.surfaces.mesh import TriangleMesh


def differences(table, other, numbers=np.s_[:]):
    """Differences in codes of all pairs; a pair close to d_max may be missing in one table.

    The vertices of the other table may be renumbered.
    """
    codes = [np.asarray(table.to_csr().todense()) / table.unit for table in (table, other)]
    codes[1] = codes[1][numbers][:, numbers]
    both = (codes[0] > 0) & (codes[1] > 0)
    only = np.maximum(*codes)[(codes[0] > 0) != (codes[1] > 0)]
    assert (only > 64235).all()
    return np.abs(codes[0] - codes[1])[both]


def test_both_solvers_agree_within_two_codes(slotted):
    front = solve_on_cuda(plan_tables([slotted], 8.0), "cpu", 10**9, no_tick)[0]
    sweep = solve_tables([slotted], 8.0)[0]
    assert differences(front, sweep).max() <= 2


def with_coincident_vertices(mesh, near):
    """Split some triangles in three at a point close to one corner (`near`, as a fraction of their size)."""
    some = mesh.faces[::23]
    weights = np.array([1.0 - 2.0 * near, near, near])
    added = np.einsum("k,fkx->fx", weights, mesh.vertices[some])
    names = len(mesh.vertices) + np.arange(len(some))
    parts = [np.stack([some[:, k], some[:, (k + 1) % 3], names], axis=1) for k in range(3)]
    kept = np.delete(mesh.faces, np.s_[::23], axis=0)
    return TriangleMesh(np.concatenate([mesh.vertices, added]), np.concatenate([kept, *parts]))


def renumbered(mesh, seed):
    """Renumber the vertices at random; return the mesh and the new index of each vertex."""
    names = np.random.default_rng(seed).permutation(len(mesh.vertices))
    number = np.argsort(names)
    return TriangleMesh(mesh.vertices[names], number[mesh.faces].astype(mesh.faces.dtype)), number


@pytest.mark.parametrize("near", [3e-2, 1e-2, 1e-3])
def test_both_solvers_agree_on_nearly_coincident_vertices_in_any_order(slotted, near):
    mesh = with_coincident_vertices(slotted, near)
    sweep = solve_tables([mesh], 8.0)[0]
    assert differences(solve_on_cuda(plan_tables([mesh], 8.0), "cpu", 10**9, no_tick)[0], sweep).max() <= 2
    for seed in range(3):
        other, number = renumbered(mesh, seed)
        front = solve_on_cuda(plan_tables([other], 8.0), "cpu", 10**9, no_tick)[0]
        assert differences(sweep, front, number).max() <= 2


def test_a_cohort_in_small_batches_gives_the_tables_of_its_shapes(sphere, slotted):
    meshes, limits = [sphere(400), slotted, sphere(700)], [12.0, 6.0, 9.0]
    plan = plan_tables(meshes, limits)
    together = solve_on_cuda(plan, "cpu", 2_500_000, no_tick)
    for table, mesh, limit in zip(together, meshes, limits, strict=True):
        alone = solve_on_cuda(plan_tables([mesh], limit), "cpu", 10**9, no_tick)[0]
        assert table.n_vertices == len(mesh.vertices)
        assert (table.to_csr() != alone.to_csr()).nnz == 0
        assert table.nbytes == alone.nbytes


def test_blocks_grow_where_the_estimate_was_too_low(slotted, monkeypatch):
    plan = plan_tables([slotted], 6.0)
    enough = solve_on_cuda(plan, "cpu", 10**9, no_tick)[0]
    monkeypatch.setattr(cuda_solver, "block_rows", lambda task: 10)
    grown = solve_on_cuda(plan, "cpu", 2_500_000, no_tick)[0]
    assert (grown.to_csr() != enough.to_csr()).nnz == 0
    assert grown.nbytes == enough.nbytes
