"""Geodesic tables: distances between all vertices of a mesh up to a reach, in fixed point."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array

from homolog.arrays import Array
from homolog.geodesics.lookup import MISSING, TableData

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
        rows = self._dense_rows() if self.row is None else self._block_rows()
        ends = np.concatenate([[0], np.cumsum([len(columns) for columns, _ in rows])])
        index = np.int32 if ends[-1] < 2**31 else np.int64
        columns = np.concatenate([columns for columns, _ in rows], dtype=index)
        distances = np.concatenate([codes for _, codes in rows]) * np.float32(self.unit)
        return csr_array((distances, columns, ends.astype(index)), shape=(self.n_vertices,) * 2)

    def _dense_rows(self) -> list[tuple[Array, Array]]:
        """Columns and codes of the entries of each row."""
        rows = []
        for codes in self.codes.numpy():
            columns = np.flatnonzero(codes != MISSING).astype(np.int32)
            rows.append((columns, codes[columns]))
        return rows

    def _block_rows(self) -> list[tuple[Array, Array]]:
        """Columns and codes of the entries of each row."""
        codes, row, start, slot = (a.numpy() for a in (self.codes, self.row, self.start, self.slot))
        by_slot = []
        for first, patch_row in zip(start, row, strict=True):
            near = np.flatnonzero(patch_row != MISSING).astype(np.int32)
            block = codes[int(first) : int(first) + len(near)][patch_row[near]].T
            for lane in block:
                present = np.flatnonzero(lane != MISSING)
                by_slot.append((near[present], lane[present]))
        return [by_slot[k] for k in slot]
