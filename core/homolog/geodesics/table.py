"""Geodesic tables: distances between all vertices of a mesh up to a longest distance, in fixed point."""

from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
import warp as wp
from scipy.sparse import csr_array

from homolog.geodesics.kernels.lookup import LANES, MISSING, TableData
from homolog.memory import Store, in_memory

__all__ = ["ARRAYS", "GeodesicTable"]

ARRAYS = ("codes", "row", "start", "slot")
"""Names of a table's arrays."""


@dataclass(frozen=True, slots=True, eq=False)
class GeodesicTable:
    """Symmetric table of the geodesic distances between vertices of one mesh that are at most d_max apart.

    Attributes
    ----------
    n_vertices : int
        Number of vertices of the mesh.
    d_max : float
        Longest distance [mm]: the table has every pair up to it, and no other; inf if it has all pairs.
    unit : float
        Length of one code step [mm]; distances are rounded to multiples of it.
    codes : (R, 16) uint16 wp.array
        Blocks: for each cluster of 16 sources, their distances to every vertex in range, as codes.
    row, start, slot : wp.array
        Index of the blocks (see `homolog.geodesics.kernels.lookup.TableData`).
    """

    n_vertices: int
    d_max: float
    unit: float
    codes: Any
    row: Any
    start: Any
    slot: Any

    @property
    def device(self) -> str:
        """Warp alias of the device that stores the arrays."""
        return str(self.codes.device.alias)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return sum(int(getattr(self, name).capacity) for name in ARRAYS)

    def on_device(self, device: str, scale: float = 1.0) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return the table for kernels on a device, with distances multiplied by scale.

        Nothing is copied if the table is on that device already. Keep the result as long as kernels use it.

        Parameters
        ----------
        device : str
            Warp alias.
        scale : float
            Factor of all distances.

        Returns
        -------
        TableData
        """
        data = TableData()
        data.unit = self.unit * scale
        for name in ARRAYS:
            setattr(data, name, getattr(self, name).to(device))
        return data

    def stored(self, store: Store) -> "GeodesicTable":
        """Return the table with its arrays moved to a store; arrays on a GPU stay there."""
        if store is in_memory or not self.codes.device.is_cpu:
            return self
        places: dict[str, Any] = {}
        for name in ARRAYS:
            array = getattr(self, name)
            places[name] = wp.array(store(array.numpy()), dtype=array.dtype, device="cpu", copy=False)
        return replace(self, **places)

    def to_csr(self) -> csr_array:
        """Return the distances [mm], (V, V) float32, with sorted columns; the diagonal is stored."""
        codes, row, start, slot = (getattr(self, name).numpy() for name in ARRAYS)
        counts = np.add.reduceat(codes != MISSING, start, dtype=np.int64).ravel()[slot]
        ends = np.append(0, np.cumsum(counts))
        index = np.int32 if ends[-1] < 2**31 else np.int64
        columns, distances = np.empty(ends[-1], index), np.empty(ends[-1], np.float32)
        for cluster, members in groupby(np.argsort(slot), lambda v: slot[v] // LANES):
            reached = np.flatnonzero(row[cluster] != MISSING)
            block = np.ascontiguousarray(codes[start[cluster] + row[cluster, reached].astype(np.int64)].T)
            present = block != MISSING
            to, code, at = np.broadcast_to(reached, block.shape)[present], block[present], 0
            for v in members:  # lane by lane
                entries = slice(at, at := at + counts[v])
                columns[ends[v] : ends[v + 1]], distances[ends[v] : ends[v + 1]] = to[entries], code[entries]
        distances *= np.float32(self.unit)
        return csr_array((distances, columns, ends.astype(index)), shape=(len(slot), len(slot)))
