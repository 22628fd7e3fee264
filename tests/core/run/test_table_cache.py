import gc

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.geodesics import GeodesicTable, solve_tables
from homolog.run import table_cache
from homolog.run.table_cache import TableCache
from homolog.surfaces.mesh import TriangleMesh

CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
MESHES = [TriangleMesh(size * CORNERS, FACES) for size in (1.0, 2.0, 3.0)]


@pytest.fixture
def solve(tmp_path):
    """Return a function that solves meshes as a run does, in the folder ``geodesics``."""

    def run(meshes=MESHES):
        names = [f"{number}" for number in range(len(meshes))]
        kept = TableCache(tmp_path / "geodesics")
        return kept.solve(meshes, [np.inf] * len(meshes), device="cpu", names=names)

    return run


def codes(result):
    return [item.codes.numpy().tolist() for item in result]


def test_short_runs_write_nothing(solve, tmp_path):
    assert codes(solve()) == codes(solve_tables(MESHES, np.inf))
    assert list(tmp_path.iterdir()) == []


def test_what_took_long_is_read_the_next_time(solve, tmp_path, monkeypatch):
    monkeypatch.setattr(table_cache, "WORTH_S", 0.0)
    first = solve(MESHES[:2])
    assert len(list((tmp_path / "geodesics").iterdir())) == 2
    monkeypatch.setattr(table_cache, "each_table", None)
    assert codes(solve(MESHES[:2])) == codes(first)


def test_tables_without_room_are_not_kept_and_that_is_told(solve, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(table_cache, "WORTH_S", 0.0)
    monkeypatch.setattr(table_cache.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 100}))
    assert len(solve()) == 3
    assert list((tmp_path / "geodesics").iterdir()) == []
    assert "0.0 GB are free" in caplog.messages[0]


def test_a_place_that_cannot_be_written_to_is_named(solve, tmp_path, monkeypatch):
    monkeypatch.setattr(table_cache, "WORTH_S", 0.0)
    (tmp_path / "geodesics").touch()
    with pytest.raises(InputError, match="geodesics: can't be written: "):
        solve()


def test_tables_that_are_no_longer_used_take_no_memory(tmp_path):
    def alive():
        gc.collect()
        return sum(isinstance(item, GeodesicTable) for item in gc.get_objects())

    before = alive()
    cache = TableCache(tmp_path / "geodesics")
    tables = cache.solve(MESHES, [np.inf] * 3, device="cpu", names=["a", "b", "c"])
    assert alive() == before + 3
    del tables
    assert alive() == before
