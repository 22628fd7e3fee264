"""Geodesic tables of an unfinished run on disk, for a resumed run."""

import logging
import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from homolog.geodesics import GeodesicTable, check_room, each_table, plan_tables
from homolog.io.atomic import report_os_errors
from homolog.memory import Store, in_memory
from homolog.progress import Tick, no_tick, part_of
from homolog.run.table_files import load_table, save_table, table_path
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["TableCache"]

_log = logging.getLogger(__name__)

WORTH_S = 10.0
"""Time spent on new tables after which they are written [s]; short runs write none."""
_SHAPES_ON_GPU = 32
"""Number of tables solved at once on a GPU: about a second's work for large ones."""


class TableCache:
    """Solves tables a few shapes at a time, and stores them in a folder if this took long.

    Parameters
    ----------
    folder : Path
        Folder of the tables. File names identify their content, so that it may contain other tables.
    store : Store
        Storage of tables of the CPU.
    """

    def __init__(self, folder: Path, store: Store = in_memory) -> None:
        self._folder, self._store = folder, store
        self._unsaved: dict[Path, GeodesicTable] = {}
        self._seconds = 0.0

    def solve(
        self,
        meshes: Sequence[TriangleMesh],
        d_max: Sequence[float],
        *,
        device: str,
        names: Sequence[str],
        tick: Tick = no_tick,
    ) -> list[GeodesicTable]:
        """Return tables as `homolog.geodesics.solve_tables` does; stored tables are read from the folder."""
        if not meshes:
            return []
        plan = plan_tables(meshes, d_max, names=names, tick=tick)
        paths = [table_path(self._folder, task) for task in plan.tasks]
        tables: dict[Path, GeodesicTable] = {}
        for index, (path, task) in enumerate(zip(paths, plan.tasks, strict=True)):
            tick(index / len(paths), f"geodesic distances of {task.name}")
            kept = load_table(path, device)
            if kept is not None and kept.n_vertices == len(task.mesh.vertices):
                tables[path] = kept.stored(self._store)
        absent = {path: task for path, task in zip(paths, plan.tasks, strict=True) if path not in tables}
        if device != "cpu" or self._store is in_memory:  # other tables are mapped from files
            tasks = tuple(absent.values())
            check_room(replace(plan, tasks=tasks, nbytes=plan.nbytes * len(tasks) // len(paths)), device)
        size = len(absent) if device == "cpu" else _SHAPES_ON_GPU
        for first in range(0, len(absent), max(size, 1)):
            batch = dict(list(absent.items())[first : first + size])
            part = replace(plan, tasks=tuple(batch.values()), nbytes=plan.nbytes * len(batch) // len(paths))
            share = part_of(tick, first / len(absent), (first + len(batch)) / len(absent))
            began = time.monotonic()
            for index, solved in each_table(part, device=device, tick=share):
                path = list(batch)[index]
                tables[path] = solved.stored(self._store)
                now = time.monotonic()
                self._keep(path, tables[path], now - began)
                began = now
        self._unsaved = {}  # would keep tables of coarse meshes in memory
        return [tables[path] for path in paths]

    def _keep(self, path: Path, table: GeodesicTable, seconds: float) -> None:
        self._unsaved[path] = table
        self._seconds += seconds
        if self._seconds < WORTH_S:
            return
        with report_os_errors(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
            room = shutil.disk_usage(self._folder).free
        if (needed := sum(table.nbytes for table in self._unsaved.values())) > room / 2:
            _log.warning(
                "%.1f GB of geodesic tables are not stored (%.1f GB are free): a resumed run recomputes them",
                needed / 1e9,
                room / 1e9,
            )
        else:
            for path, table in self._unsaved.items():
                save_table(path, table)
        self._unsaved, self._seconds = {}, 0.0
