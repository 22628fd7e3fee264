"""Tables kept on disk under a name made of the mesh's content and the parameters."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from homolog.errors import InputError
from homolog.files.arrays import read_arrays
from homolog.files.atomic import replacing
from homolog.geodesics.lookup import MISSING
from homolog.geodesics.plan import CHANGED, TablePlan, Task
from homolog.geodesics.table import GeodesicTable

__all__ = ["load_table", "save_table", "table_path"]

VERSION = 1
"""Goes up with every change of the solver that changes distances, or of the file."""
_INDEX = ("row", "start", "slot")


def table_path(folder: Path, plan: TablePlan, task: Task) -> Path:
    """Return where the table of a task is kept."""
    digest = hashlib.sha256()
    for part in (task.mesh.vertices, task.mesh.faces):
        digest.update(part.tobytes())
    digest.update(repr((VERSION, CHANGED, task.d_max, task.reach, plan.element, plan.dense)).encode())
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
    with replacing(path) as part:
        np.savez(part, facts=facts, **arrays)


def load_table(path: Path, device: str) -> GeodesicTable | None:
    """Return the table kept at a path; None if there is none that can be read."""
    try:
        arrays = read_arrays(path)
        n, d_max, unit = arrays.pop("facts").tolist()
        codes = arrays.pop("codes")
        if "present" in arrays:
            present = np.unpackbits(arrays.pop("present"), count=int(n) ** 2).astype(bool)
            dense = np.full((int(n), int(n)), MISSING, np.uint16)
            dense.reshape(-1)[present] = codes
            codes = dense
    except (InputError, KeyError, ValueError, MemoryError):
        return None

    def there(array: np.ndarray[Any, Any]) -> Any:  # noqa: ANN401 - a wp.array has no type
        dtype = wp.uint16 if array.dtype == np.uint16 else wp.int32
        return wp.array(array, dtype=dtype, ndim=array.ndim, device=device)

    return GeodesicTable(int(n), d_max, unit, there(codes), **{name: there(a) for name, a in arrays.items()})
