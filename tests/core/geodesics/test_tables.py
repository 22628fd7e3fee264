import numpy as np
import pytest

from homolog import geodesic_distances
from homolog.geodesics import measure_accuracy, solve_tables
from homolog.geodesics.table import ARRAYS
from homolog.surfaces.mesh import TriangleMesh


def arcs(mesh, radius=30.0):
    chord = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[None], axis=2)
    return 2 * radius * np.arcsin(np.minimum(chord / (2 * radius), 1.0))


def test_distances_on_a_sphere_are_its_arcs(sphere):
    mesh = sphere(1500)
    table = solve_tables([mesh], 15.0)[0]
    matrix, exact = table.to_csr().toarray(), arcs(mesh)
    near = (exact > 0) & (exact < 14.9)
    error = matrix[near] / exact[near] - 1
    assert np.abs(error).mean() < 0.002
    assert np.abs(error).max() < 0.01


def test_a_table_has_every_pair_up_to_d_max_and_no_other(sphere):
    mesh = sphere(800)
    matrix, exact = solve_tables([mesh], 12.0)[0].to_csr().toarray(), arcs(mesh)
    off_diagonal = ~np.eye(len(matrix), dtype=bool)
    assert (matrix[off_diagonal & (exact < 11.9)] > 0).all()
    assert (matrix[exact > 12.1] == 0).all()
    assert matrix.max() <= 12.0 * (1 + 1e-5)


def test_a_table_is_symmetric_and_zero_on_the_diagonal(slotted):
    matrix = solve_tables([slotted], 8.0)[0].to_csr()
    assert (matrix != matrix.T).nnz == 0
    assert (matrix.diagonal() == 0).all()
    stored = matrix.copy()
    stored.data[:] = 1
    assert (stored.diagonal() == 1).all()


def test_the_result_does_not_depend_on_the_number_of_threads(slotted):
    first, three = (solve_tables([slotted], 8.0, threads=threads)[0] for threads in (1, 3))
    for name in ARRAYS:
        assert np.array_equal(getattr(first, name).numpy(), getattr(three, name).numpy())


def test_blocks_grow_where_the_estimate_is_too_low(slotted, monkeypatch):
    enough = solve_tables([slotted], 6.0)[0]
    monkeypatch.setattr("homolog.geodesics.cpu.solver.block_rows", lambda task: 10)
    grown = solve_tables([slotted], 6.0)[0]
    for name in ARRAYS:
        assert np.array_equal(getattr(grown, name).numpy(), getattr(enough, name).numpy())


def test_distances_on_a_flat_side_are_straight(plate):
    matrix = geodesic_distances(plate.vertices, plate.faces, 6.0, device="cpu").tocoo()
    a, b = plate.vertices[matrix.row], plate.vertices[matrix.col]
    inside = (np.abs(a[:, :2] - 10) < 6).all(axis=1) & (np.abs(b[:, :2] - 10) < 6).all(axis=1)
    same = inside & (a[:, 2] == b[:, 2])
    assert np.count_nonzero(same) > 5000
    straight = np.linalg.norm(a - b, axis=1)[same]
    assert np.abs(matrix.data[same] - straight).max() < 1e-3


def test_the_other_side_of_a_thin_wall_is_far(plate):
    table = geodesic_distances(plate.vertices, plate.faces, 15.0, device="cpu")
    n = len(plate.vertices) // 2
    middle = 21 * 10 + 10
    assert table[middle, middle + n] == 0  # 20.5 mm around the rim, 0.5 mm through the plate
    near_rim = 21 * 2 + 10
    assert table[near_rim, near_rim + n] == pytest.approx(4.5, rel=1e-3)


def test_infinite_d_max_gives_every_pair(sphere):
    mesh = sphere(300)
    table = solve_tables([mesh], np.inf)[0]
    assert table.to_csr().nnz == 300**2
    exact = arcs(mesh)
    error = np.abs(table.to_csr().toarray() - exact) / (30 * np.pi)
    assert error.mean() < 0.01
    assert error.max() < 0.05  # all shortest paths meet at the antipode: the hardest place there is


def test_d_max_beyond_the_mesh_gives_every_pair(sphere):
    assert solve_tables([sphere(300)], 1e9)[0].to_csr().nnz == 300**2


@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_the_unit_of_length_does_not_matter(slotted, factor):
    scaled = TriangleMesh(slotted.vertices * factor, slotted.faces)
    first, other = solve_tables([slotted], 8.0)[0], solve_tables([scaled], 8.0 * factor)[0]
    codes = [table.codes.numpy().astype(int) for table in (first, other)]
    apart = np.abs(codes[0] - codes[1])[(codes[0] < 65535) & (codes[1] < 65535)]
    assert ((codes[0] == 65535) != (codes[1] == 65535)).mean() < 1e-4  # at the very rim
    assert (apart > 2).mean() < 1e-3  # where two ways are equally long, rounding chooses
    assert apart.max() <= 64


def test_the_place_in_the_world_does_not_matter(slotted):
    moved = TriangleMesh(slotted.vertices + np.array([-512.0, 1024.0, 4096.0]), slotted.faces)
    assert np.array_equal(
        solve_tables([slotted], 8.0)[0].codes.numpy(), solve_tables([moved], 8.0)[0].codes.numpy()
    )


def test_errors_against_the_exact_solver_are_within_the_goal(slotted):
    accuracy = measure_accuracy(slotted, solve_tables([slotted], 6.5)[0], 48)  # 20 % of the diagonal
    assert accuracy.pairs > 3000
    assert accuracy.missing == 0
    assert accuracy.mean < 0.0006
    assert accuracy.p99 < 0.004
    assert accuracy.worst_far < 0.015
    assert "p99" in str(accuracy)


def test_real_surfaces_are_as_accurate(data):
    from homolog.io.meshes import read_mesh

    mesh = read_mesh(sorted((data / "vertebra_l1_verse" / "meshes").glob("*.ply"))[0])
    accuracy = measure_accuracy(mesh, solve_tables([mesh], 2.5)[0], 4)
    assert accuracy.missing == 0
    assert accuracy.mean < 0.0005
    assert accuracy.p99 < 0.003
