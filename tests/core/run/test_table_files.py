import numpy as np
import pytest

from homolog.errors import InputError
from homolog.geodesics.table import ARRAYS
from homolog.progress import no_tick
from homolog.run import table_cache
from homolog.run.table_files import load_table
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture
def sphere(unit_sphere):
    """Return a maker of spheres of radius 30 with n vertices."""

    def made(n):
        points, faces = unit_sphere(n)
        return TriangleMesh(30.0 * points, faces)

    return made


@pytest.fixture
def solve(tmp_path, monkeypatch):
    """Return a function that solves tables and keeps all of them in a folder."""
    monkeypatch.setattr(table_cache, "WORTH_S", 0.0)

    def solved(meshes, d_max, folder=tmp_path, tick=no_tick):
        names = [chr(97 + k) for k in range(len(meshes))]
        limits = [d_max] * len(meshes)
        return table_cache.TableCache(folder).solve(meshes, limits, device="cpu", names=names, tick=tick)

    return solved


def same(first, other):
    return all(
        np.array_equal(getattr(first, name).numpy(), getattr(other, name).numpy()) for name in ARRAYS
    ) and (first.n_vertices, first.d_max, first.unit) == (other.n_vertices, other.d_max, other.unit)


def test_a_table_is_solved_once(solve, sphere, tmp_path, monkeypatch):
    first = solve([sphere(300), sphere(200)], 7.0)
    monkeypatch.setattr(table_cache, "each_table", None)
    second = solve([sphere(300), sphere(200)], 7.0)
    assert len(list(tmp_path.iterdir())) == 2
    assert all(same(*pair) for pair in zip(first, second, strict=True))


def test_other_meshes_and_parameters_are_solved_anew(solve, sphere, tmp_path, monkeypatch):
    solve([sphere(300)], 7.0)
    solve([sphere(301)], 7.0)
    solve([sphere(300)], 7.5)
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-500], lambda data: b"", lambda data: data[:200] + bytes(len(data) - 200)]
)
def test_a_damaged_file_is_solved_anew(solve, sphere, tmp_path, damage):
    first = solve([sphere(300)], 7.0)[0]
    file = next(tmp_path.iterdir())
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert same(first, solve([sphere(300)], 7.0)[0])
    assert len(file.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_is_named(solve, sphere, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="can't be written"):
        solve([sphere(100)], 7.0, tmp_path / "file" / "tables")


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
        ("facts", lambda item: item * [1000.0, 1.0, 1.0]),
    ],
)
def test_a_file_whose_entries_would_lead_kernels_out_of_it_is_solved_anew(
    solve, sphere, tmp_path, name, change, monkeypatch
):
    first = solve([sphere(300)], 7.0)[0]
    file = next(tmp_path.iterdir())
    with np.load(file) as stored:
        arrays = dict(stored)
    np.savez(file, **(arrays | {name: change(arrays[name])}))
    assert load_table(file, "cpu") is None
    assert same(first, solve([sphere(300)], 7.0)[0])
