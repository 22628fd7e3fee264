import numpy as np
import pytest

from homolog.errors import InputError
from homolog.geodesics import solve_tables
from homolog.geodesics.cache import load_table


def same(first, other):
    return all(
        getattr(first, name) is getattr(other, name) is None
        or np.array_equal(getattr(first, name).numpy(), getattr(other, name).numpy())
        for name in ("codes", "row", "start", "slot")
    ) and (first.n_vertices, first.d_max, first.unit) == (other.n_vertices, other.d_max, other.unit)


def test_a_table_is_solved_once(sphere, slotted, tmp_path, storage):
    said = []
    first = solve_tables([sphere(300), slotted], 7.0, cache=tmp_path)
    second = solve_tables(
        [sphere(300), slotted], 7.0, cache=tmp_path, names=["a", "b"], tick=lambda _, text: said.append(text)
    )
    assert len(list(tmp_path.iterdir())) == 2
    assert all(same(*pair) for pair in zip(first, second, strict=True))
    assert said == ["mesh of a checked", "mesh of b checked", "geodesic distances"]  # nobody's


def test_other_meshes_and_parameters_are_solved_anew(sphere, tmp_path):
    solve_tables([sphere(300)], 7.0, cache=tmp_path)
    solve_tables([sphere(301)], 7.0, cache=tmp_path)
    solve_tables([sphere(300)], 7.5, cache=tmp_path)
    solve_tables([sphere(300)], 7.0, element="linear", cache=tmp_path)
    solve_tables([sphere(300)], 7.0, memory_limit=150_000, cache=tmp_path)
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-500], lambda data: b"", lambda data: data[:200] + bytes(len(data) - 200)]
)
def test_a_damaged_file_is_solved_anew(sphere, tmp_path, damage):
    first = solve_tables([sphere(300)], 7.0, cache=tmp_path)[0]
    file = next(tmp_path.iterdir())
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert same(first, solve_tables([sphere(300)], 7.0, cache=tmp_path)[0])
    assert len(file.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_is_named(sphere, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="can't be written"):
        solve_tables([sphere(100)], 7.0, cache=tmp_path / "file" / "tables")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("row", lambda item: np.full_like(item, 60000)),
        ("start", lambda item: item - 1),
        ("slot", lambda item: item + 10**6),
        ("slot", lambda item: item[:-1]),
        ("codes", lambda item: item[:1]),
        ("codes", lambda item: item.astype(np.int32)),
        ("facts", lambda item: item * 2.0),
        ("facts", lambda item: item * np.inf),
    ],
)
def test_a_file_whose_entries_would_lead_kernels_out_of_it_is_solved_anew(sphere, tmp_path, name, change):
    first = solve_tables([sphere(300)], 7.0, memory_limit=150_000, cache=tmp_path)[0]
    file = next(tmp_path.iterdir())
    with np.load(file) as stored:
        arrays = dict(stored)
    np.savez(file, **(arrays | {name: change(arrays[name])}))
    assert load_table(file, "cpu") is None
    assert same(first, solve_tables([sphere(300)], 7.0, memory_limit=150_000, cache=tmp_path)[0])


def test_a_dense_file_that_claims_more_vertices_than_it_holds_is_none(sphere, tmp_path):
    solve_tables([sphere(300)], 7.0, cache=tmp_path)
    file = next(tmp_path.iterdir())
    with np.load(file) as stored:
        arrays = dict(stored)
    np.savez(file, **(arrays | {"facts": arrays["facts"] * [1000.0, 1.0, 1.0]}))
    assert load_table(file, "cpu") is None
