"""The matrices across shapes on a CUDA device (see `homolog.correspondence.entropy.dual`)."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from homolog.arrays import DeviceArray, FloatArray
from homolog.correspondence.kernels import dual as dual_kernels
from homolog.correspondence.kernels import dual_tiles as tile_kernels

__all__ = ["DeviceDuals", "TiledDuals", "make_duals"]

MANY_SHAPES = 512
"""From which products and inversions by tiles are faster."""


class DeviceDuals:
    """Some of the matrices across shapes, on one CUDA device.

    Attributes
    ----------
    inverses : (k, M, M) array of float
        What `homolog.correspondence.entropy.dual.solve_duals` returns, from the matrix `first` on.
    logdets : (k,) array of float64
        log det(I + C/a) of each.
    stiffness : (1,) array of float
        Largest diagonal entry of that of the normals.
    """

    padding = int(dual_kernels.BLOCK_SIZE)

    def __init__(self, first: int, number: int, shapes: int, count: int, device: str) -> None:
        self.first, self.shapes, self.count, self.device = first, shapes, count, device
        self._size = self.padding * -(-shapes // self.padding)
        make = {"device": device}
        covariances = [wp.zeros((shapes, shapes), dtype=wp.float64, **make) for _ in range(2)]
        self._covariances: list[DeviceArray] = covariances
        square = (number, self._size, self._size)
        self._matrices: DeviceArray = wp.zeros(square, dtype=wp.float64, **make)
        self.inverses: DeviceArray = wp.zeros((number, shapes, shapes), dtype=float, **make)
        self.logdets: DeviceArray = wp.zeros(number, dtype=wp.float64, **make)
        self.stiffness: DeviceArray = wp.zeros(1, dtype=float, **make)
        self._others: DeviceArray | None = None
        self._share = 1.0
        self._allocate(number)

    def join(self, others: FloatArray, share: float) -> None:
        """Add other structures to the covariance of positions (see `Coupling.join`)."""
        if self._others is None:
            self._others = wp.zeros_like(self._covariances[0])
        self._others.assign(others)
        self._share = share

    def _allocate(self, number: int) -> None:
        """Make further arrays for the inversion of some matrices."""
        self._swept: DeviceArray = wp.empty_like(self._matrices)

    def solve(
        self,
        stage: DeviceArray,
        iteration: DeviceArray,
        centred: DeviceArray | None = None,
        logs: DeviceArray | None = None,
    ) -> None:
        """Form and invert the matrices of those rows that are given (see `Coupling.gradients`)."""
        divisor = float(self.count * max(self.shapes - 1, 1))
        for rows, out in zip((centred, logs), self._covariances, strict=True):
            if rows is not None:
                self._gram(divisor, rows, out)
        if self._others is not None and centred is not None:
            inputs = [self._share, self._others, self._covariances[0]]
            self._launch(dual_kernels.join, self._others.shape, inputs)
        self._launch(
            dual_kernels.regularize,
            self._matrices.shape,
            [self.first, stage, iteration, *self._covariances, self._matrices, self.logdets, self.stiffness],
        )
        inverted = self._invert()
        self._launch(
            dual_kernels.extract_inverses,
            self.inverses.shape,
            [self.first, stage, iteration, inverted, self.inverses, self.stiffness],
        )

    def multiply(self, rows: DeviceArray, source: DeviceArray, target: DeviceArray) -> None:
        """Multiply (M n,) vectors by some rows (k, M) of a matrix across the shapes."""
        blocks = -(-rows.shape[0] // self.padding)
        inputs = [rows, self.count, source, target]
        self._launch(dual_kernels.multiply, (blocks, self.count), inputs)

    def _gram(self, divisor: float, rows: DeviceArray, out: DeviceArray) -> None:
        blocks = self._size // self.padding
        inputs = [self.shapes, self.count, divisor, rows, out]
        self._launch_blocks(dual_kernels.gram, (blocks, blocks), inputs)

    def _invert(self) -> DeviceArray:
        """Return the inverses of the matrices; only the upper triangle is used."""
        blocks = self._size // self.padding
        source, target = self._matrices, self._swept
        for pivot in range(blocks):
            dimensions = (source.shape[0], blocks, blocks)
            self._launch(dual_kernels.sweep, dimensions, [pivot, source, target, self.logdets])
            source, target = target, source
        return source

    def _launch(self, kernel: Any, dimensions: tuple[int, ...], inputs: Sequence[Any]) -> None:  # noqa: ANN401
        wp.launch(kernel, dim=dimensions, inputs=inputs, device=self.device)

    def _launch_blocks(self, kernel: Any, dimensions: tuple[int, ...], inputs: Sequence[Any]) -> None:  # noqa: ANN401
        block_dim = dual_kernels.BLOCK_DIM
        wp.launch_tiled(kernel, dim=dimensions, inputs=inputs, block_dim=block_dim, device=self.device)


class TiledDuals(DeviceDuals):
    """The same for many shapes, by tiles in shared memory."""

    padding = int(tile_kernels.TILE)

    def _allocate(self, number: int) -> None:
        corner, row = (number, self.padding, 2 * self.padding), (number, self.padding, self._size)
        make = {"dtype": wp.float64, "device": self.device}
        self._corners: list[DeviceArray] = [wp.zeros(corner, **make) for _ in range(2)]
        self._rows: list[DeviceArray] = [wp.zeros(row, **make) for _ in range(2)]
        self._tiles = self._size // self.padding

    def multiply(self, rows: DeviceArray, source: DeviceArray, target: DeviceArray) -> None:
        """Multiply (M n,) vectors by some rows (k, M) of a matrix across the shapes."""
        wide = int(tile_kernels.WIDE_TILE)
        tiles = (-(-rows.shape[0] // wide), -(-3 * self.count // wide))
        inputs = [rows, self._as_rows(source), self._as_rows(target, rows.shape[0])]
        self._launch_blocks(tile_kernels.multiply, tiles, inputs)

    def _gram(self, divisor: float, rows: DeviceArray, out: DeviceArray) -> None:
        tiles = -(-self.shapes // int(tile_kernels.WIDE_TILE))
        self._launch_blocks(tile_kernels.gram, (tiles, tiles), [divisor, self._as_rows(rows), out])

    def _invert(self) -> DeviceArray:
        matrices, corners = self._matrices, self._corners
        number = matrices.shape[0]
        blocks = self.padding // int(dual_kernels.BLOCK_SIZE)
        for pivot in range(self._tiles):
            self._launch(tile_kernels.start_corner, corners[0].shape, [pivot, matrices, corners[0]])
            for block in range(blocks):
                inputs = [block, *corners, self.logdets]
                self._launch(tile_kernels.factor_corner, (number, blocks, 2 * blocks), inputs)
                corners.reverse()
            self._launch_blocks(
                tile_kernels.reduce_row, (number, self._tiles), [pivot, matrices, corners[0], *self._rows]
            )
            self._launch_blocks(
                tile_kernels.eliminate, (number, self._tiles, self._tiles), [pivot, *self._rows, matrices]
            )
        return matrices

    def _as_rows(self, vectors: DeviceArray, shapes: int | None = None) -> DeviceArray:
        """Return (M n,) vectors of some shapes, all if not given, as an (M, 3n) array of the same memory."""
        size = (shapes or self.shapes, 3 * self.count)
        return wp.array(ptr=vectors.ptr, dtype=float, shape=size, device=self.device, copy=False)


def make_duals(first: int, number: int, shapes: int, count: int, device: str) -> DeviceDuals:
    """Return the matrices `first` … of shapes with `count` particles each, of the kind that is faster."""
    kind = TiledDuals if shapes >= MANY_SHAPES else DeviceDuals
    return kind(first, number, shapes, count, device)
