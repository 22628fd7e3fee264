"""Geodesic tables: distances between all vertices of a mesh up to a reach, in fixed point."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import warp as wp
from scipy.sparse import csr_array

from homolog.geodesics.cpu.kernels.csr import fill_blocks
from homolog.geodesics.cpu.kernels.patch import LaneCodes
from homolog.geodesics.kernels.lookup import LANES, MISSING, TableData
from homolog.memory import Store, in_memory

__all__ = ["GeodesicTable"]


@dataclass(frozen=True, slots=True, eq=False)
class GeodesicTable:
    """Geodesic distances between the vertices of one mesh that are at most d_max apart; symmetric.

    Attributes
    ----------
    n_vertices : int
        Vertices of the mesh.
    d_max : float
        Every pair up to this distance [mm] is present, and no other; inf if the table is complete.
    unit : float
        Length of one code step [mm]: distances are rounded to its multiples.
    codes : (V, V) or (R, 16) uint16 wp.array
        Dense codes; or, of each cluster, the codes from the vertices in reach to its 16 sources.
    row, start, slot : wp.array or None
        Index of the blocks (see `homolog.geodesics.kernels.lookup.TableData`), None for a dense table.
    """

    n_vertices: int
    d_max: float
    unit: float
    codes: Any
    row: Any = None
    start: Any = None
    slot: Any = None

    @property
    def storage(self) -> Literal["dense", "blocks"]:
        """How the codes are laid out."""
        return "dense" if self.row is None else "blocks"

    @property
    def device(self) -> str:
        """Warp alias of the device that holds the arrays."""
        return str(self.codes.device.alias)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take [bytes]."""
        return sum(int(a.capacity) for a in (self.codes, self.row, self.start, self.slot) if a is not None)

    def on_device(self, device: str, scale: float = 1.0) -> Any:  # noqa: ANN401 - a wp.struct has no type
        """Return a `TableData` whose distances are multiplied by scale; keep it while kernels use it.

        Nothing is copied if the table is on that device already.
        """
        data = TableData()
        data.unit = self.unit * scale
        data.is_dense = int(self.row is None)
        if self.row is None:
            data.dense = self.codes.to(device)
        else:
            data.blocks = self.codes.to(device)
            data.row, data.start, data.slot = (a.to(device) for a in (self.row, self.start, self.slot))
        return data

    def stored(self, store: Store) -> "GeodesicTable":
        """Return the table with its arrays in a store; those of a GPU stay where they are."""
        if store is in_memory or not self.codes.device.is_cpu:
            return self
        places: dict[str, Any] = {}
        for name in ("codes", "row", "start", "slot"):
            array = getattr(self, name)
            if array is not None:
                places[name] = wp.array(store(array.numpy()), dtype=array.dtype, device="cpu", copy=False)
        return replace(self, **places)

    def to_csr(self) -> csr_array:
        """Return the distances [mm], (V, V) float32, columns sorted; the zeros of the diagonal are stored."""
        n, codes = self.n_vertices, self.codes.numpy()
        present = codes != MISSING
        if self.row is None:
            ends = np.append(0, np.cumsum(np.count_nonzero(present, axis=1)))
            distances = codes[present] * np.float32(self.unit)
            columns = np.broadcast_to(np.arange(n, dtype=np.int32), present.shape)[present]
        else:
            row, start, slot = self.row.to("cpu"), self.start.numpy(), self.slot.numpy()
            ends = np.append(0, np.cumsum(np.add.reduceat(present, start, dtype=np.int64).ravel()[slot]))
            vertex = np.full((len(start), LANES), -1, np.int32)
            vertex.ravel()[slot] = np.arange(n)
            columns, distances = np.empty(ends[-1] + 1, np.int32), np.empty(ends[-1] + 1, np.float32)
            lanes = wp.array(codes, dtype=LaneCodes, device="cpu", copy=False)
            outputs = [ends[:-1].copy(), columns, distances, np.empty(n, np.int32)]
            inputs = [lanes, row, start, vertex, self.unit, *outputs]
            wp.launch(fill_blocks, len(start), inputs=inputs, device="cpu")
            columns, distances = columns[:-1], distances[:-1]
        index = np.int32 if ends[-1] < 2**31 else np.int64
        parts = distances, columns.astype(index, copy=False), ends.astype(index)
        return csr_array(parts, shape=(n, n))
