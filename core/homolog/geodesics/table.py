"""Geodesic tables: distances between all vertices of a mesh up to a reach, in fixed point."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array

from homolog.geodesics.lookup import LANES, MISSING, TableData

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
        Index of the blocks (see `homolog.geodesics.lookup.TableData`), None for a dense table.
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

    def to_csr(self) -> csr_array:
        """Return the distances [mm], (V, V) float32, columns sorted; the zeros of the diagonal are stored."""
        if self.row is None:
            codes = self.codes.numpy()
            present = codes != MISSING
            columns = np.nonzero(present)[1]
            counts = present.sum(axis=1)
            values = codes[present]
        else:
            columns, counts, values = self._read_blocks()
        ends = np.concatenate([[0], np.cumsum(counts)])
        index = np.int32 if ends[-1] < 2**31 else np.int64
        arrays = (values * np.float32(self.unit), columns.astype(index), ends.astype(index))
        return csr_array(arrays, shape=(self.n_vertices,) * 2)

    def _read_blocks(self) -> tuple[Any, Any, Any]:
        """Columns and codes of all present entries, row after row, and how many each row has."""
        codes, row, start, slot = (a.numpy() for a in (self.codes, self.row, self.start, self.slot))
        columns, values = [], []
        for vertex_slot in slot:
            cluster, lane = divmod(int(vertex_slot), LANES)
            near = np.flatnonzero(row[cluster] != MISSING)
            code = codes[int(start[cluster]) + row[cluster, near].astype(np.int64), lane]
            columns.append(near[code != MISSING])
            values.append(code[code != MISSING])
        counts = np.array([len(c) for c in columns])
        return np.concatenate(columns), counts, np.concatenate(values)
