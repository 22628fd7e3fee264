"""Layers of a volume that are made on access."""

from collections.abc import Callable, Sequence
from typing import overload

from homolog.arrays import Array

__all__ = ["Layers"]


class Layers(Sequence[Array]):
    """A number of layers, each made by a function of its index; the last one is kept."""

    def __init__(self, count: int, make: Callable[[int], Array]) -> None:
        self._count, self._make = count, make
        self._last: tuple[int, Array] | None = None

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Array: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Array]: ...
    def __getitem__(self, index: int | slice) -> Array | Sequence[Array]:
        if isinstance(index, slice):
            return [self[item] for item in range(*index.indices(self._count))]
        if not 0 <= index < self._count:
            raise IndexError(index)
        if self._last is None or self._last[0] != index:
            self._last = (index, self._make(index))
        return self._last[1]
