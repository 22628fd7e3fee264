"""Tables kept on disk under a name made of the mesh's content and the parameters."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import warp as wp

from homolog.arrays import Array, DeviceArray
from homolog.errors import InputError
from homolog.files.arrays import read_arrays
from homolog.files.atomic import atomic_write
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.plan import TablePlan, Task
from homolog.geodesics.table import GeodesicTable

__all__ = ["load_table", "save_table", "table_path"]

VERSION = 10
"""Goes up with every change of the solver that changes distances, or of the file."""
_INDEX = ("row", "start", "slot")


def table_path(folder: Path, plan: TablePlan, task: Task) -> Path:
    """Return where the table of a task is kept.

    Parameters
    ----------
    folder : Path
        The cache.
    plan : TablePlan
        Which the task is part of.
    task : Task
        One mesh.

    Returns
    -------
    Path
    """
    digest = hashlib.sha256()
    for part in (task.mesh.vertices, task.mesh.faces):
        digest.update(part.tobytes())
    digest.update(repr((VERSION, task.d_max, task.max_distance, plan.dense)).encode())
    return Path(folder) / f"{digest.hexdigest()[:32]}.npz"


def save_table(path: Path, table: GeodesicTable) -> None:
    """Write a table whole or not at all; of a dense one, the entries that are there.

    Raises
    ------
    InputError
        If the folder can't be written to or the disk is full.
    """
    codes = table.codes.numpy()
    facts = np.array([table.n_vertices, table.d_max, table.unit])
    if table.row is None:
        present = codes != MISSING
        arrays = {"present": np.packbits(present), "codes": codes[present]}
    else:
        arrays = {"codes": codes} | {name: getattr(table, name).numpy() for name in _INDEX}
    with atomic_write(path) as part:
        np.savez(part, facts=facts, **arrays)


def load_table(path: Path, device: str) -> GeodesicTable | None:
    """Return the table kept at a path; None if there is none that can be read.

    Its arrays fit each other, so that kernels may follow them for `n_vertices` vertices.
    """
    try:
        arrays = read_arrays(path)
        facts = arrays.pop("facts").tolist()
        if "present" in arrays:
            arrays["codes"] = _dense(int(facts[0]), arrays.pop("present"), arrays["codes"])
        n, d_max, unit = facts
        if not (_fits_together(int(n), arrays) and unit > 0.0):
            return None
    except (InputError, KeyError, ValueError, OverflowError, MemoryError):
        return None

    def there(array: Array) -> DeviceArray:
        dtype = wp.uint16 if array.dtype == np.uint16 else wp.int32
        return wp.array(array, dtype=dtype, ndim=array.ndim, device=device)

    return GeodesicTable(int(n), d_max, unit, **{name: there(item) for name, item in arrays.items()})


def _dense(n: int, present: Array, codes: Array) -> Array:
    """Return all codes of a dense table; raises ValueError if there are not as many as it needs."""
    if len(present) != (n * n + 7) // 8:
        raise ValueError("cut short")
    table = np.full((n, n), MISSING, np.uint16)
    table.reshape(-1)[np.unpackbits(present, count=n * n).astype(bool)] = codes
    return table


def _fits_together(n: int, arrays: Mapping[str, Array]) -> bool:
    """Return whether no entry of a table leads out of it."""
    codes = arrays["codes"]
    if codes.dtype != np.uint16 or set(arrays) - {"codes"} not in (set(), set(_INDEX)):
        return False
    if len(arrays) == 1:
        return codes.shape == (n, n)
    row, start, slot = (arrays[name] for name in _INDEX)
    shapes = row.shape == (len(start), n), slot.shape == (n,), codes.shape == (len(codes), LANES)
    kinds = row.dtype == np.uint16, start.dtype == np.int32, slot.dtype == np.int32
    if not all(shapes + kinds):
        return False
    last = start.astype(np.int64) + np.where(row == MISSING, 0, row).max(axis=1, initial=0)
    inside = (start >= 0).all() and (last < len(codes)).all()
    return bool(inside and (slot >= 0).all() and (slot < LANES * len(start)).all())
