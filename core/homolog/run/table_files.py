"""Geodesic tables on disk, in files named by a hash of mesh and parameters."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import warp as wp

from homolog.arrays import Array, DeviceArray
from homolog.errors import InputError
from homolog.geodesics.kernels.lookup import LANES, MISSING
from homolog.geodesics.plan import Task
from homolog.geodesics.table import ARRAYS, GeodesicTable
from homolog.io.arrays import read_arrays
from homolog.io.atomic import atomic_write

__all__ = ["load_table", "save_table", "table_path"]

VERSION = 11
"""Version, to be increased with every change of distances or file format."""


def table_path(folder: Path, task: Task) -> Path:
    """Return the path of a task's table in a folder.

    Parameters
    ----------
    folder : Path
        Folder of the tables.
    task : Task
        The mesh to solve and its longest distance.

    Returns
    -------
    Path
    """
    digest = hashlib.sha256()
    for part in (task.mesh.vertices, task.mesh.faces):
        digest.update(part.tobytes())
    digest.update(repr((VERSION, task.d_max, task.max_distance)).encode())
    return Path(folder) / f"{digest.hexdigest()[:32]}.npz"


def save_table(path: Path, table: GeodesicTable) -> None:
    """Write a table atomically.

    Raises
    ------
    InputError
        If the file can't be written, for example because the disk is full.
    """
    facts = np.array([table.n_vertices, table.d_max, table.unit])
    arrays = {name: getattr(table, name).numpy() for name in ARRAYS}
    with atomic_write(path) as part:
        np.savez(part, facts=facts, **arrays)


def load_table(path: Path, device: str) -> GeodesicTable | None:
    """Return the table in a file, on a device; None if there is no file or it is damaged.

    The arrays are checked for consistency, so that lookups stay within them.
    """
    try:
        arrays = read_arrays(path)
        n, d_max, unit = arrays.pop("facts").tolist()
        if not (_fits_together(int(n), arrays) and unit > 0.0):
            return None
    except (InputError, KeyError, ValueError, OverflowError, MemoryError):
        return None

    def there(array: Array) -> DeviceArray:
        dtype = wp.uint16 if array.dtype == np.uint16 else wp.int32
        return wp.array(array, dtype=dtype, ndim=array.ndim, device=device)

    return GeodesicTable(int(n), d_max, unit, **{name: there(item) for name, item in arrays.items()})


def _fits_together(n: int, arrays: Mapping[str, Array]) -> bool:
    """Return whether every entry of a table's index lies inside its arrays."""
    codes, row, start, slot = (arrays[name] for name in ARRAYS)
    shapes = row.shape == (len(start), n), slot.shape == (n,), codes.shape == (len(codes), LANES)
    kinds = codes.dtype == row.dtype == np.uint16, start.dtype == slot.dtype == np.int32
    if not (len(arrays) == len(ARRAYS) and all(shapes + kinds)):
        return False
    last = start.astype(np.int64) + np.where(row == MISSING, 0, row).max(axis=1, initial=0)
    inside = (start >= 0).all() and (last < len(codes)).all()
    return bool(inside and (slot >= 0).all() and (slot < LANES * len(start)).all())
