"""Narrow tunnels through a solid of voxels, which come from noise in labels, are filled.

A label map of a thin or folded structure has tunnels of one or two voxels, in each subject at another place.
The surfaces of such subjects do not correspond.
"""

from collections.abc import Iterator

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, IntArray
from homolog.grooming.antialias import near_distance

__all__ = ["euler_number", "fill_tunnels"]

_CORNERS = list(np.ndindex(2, 2, 2))
_ANY_NEIGHBOUR = np.ones((3, 3, 3), dtype=bool)
_RADII = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)  # voxels: of the balls of successive closings


def _octant_table() -> IntArray:
    """Return eight times what each pattern of 2 x 2 x 2 voxels adds to the Euler number.

    Voxels are the points of a complex, neighbours at a face its edges, full squares its faces and full cubes
    its cells; a pattern has an eighth of each of its voxels, a quarter of its edges, half of its faces.
    """
    table = np.zeros(256, dtype=np.int64)
    for pattern in range(256):
        bits = np.array([pattern >> place & 1 for place in range(8)], dtype=bool).reshape(2, 2, 2)
        edges = sum(np.count_nonzero(np.all(bits, axis=axis)) for axis in range(3))
        squares = sum(np.count_nonzero(np.all(bits, axis=axes)) for axes in ((0, 1), (0, 2), (1, 2)))
        table[pattern] = np.count_nonzero(bits) - 2 * edges + 4 * squares - 8 * bool(bits.all())
    return table


_OCTANTS = _octant_table()


def euler_number(solid: BoolArray) -> int:
    """Return the Euler number of a solid whose voxels are connected at faces.

    It is the number of pieces, minus that of tunnels, plus that of cavities.

    Parameters
    ----------
    solid : (I, J, K) bool array
        True inside.

    References
    ----------
    Gray, Local properties of binary images in two dimensions, IEEE Transactions on Computers C-20, 1971
    (here in three).
    """
    padded = np.pad(solid, 1).astype(np.uint8)
    counts = np.bincount(_patterns(padded).ravel(), minlength=256)
    return int(counts @ _OCTANTS) // 8


def fill_tunnels(solid: BoolArray, width: float) -> tuple[BoolArray, int]:
    """Fill tunnels narrower than a width; tunnels between thick parts as well as holes in thin walls.

    Voxels are added where a closing of the solid adds them, patch by patch, and only where a patch leaves
    fewer tunnels than before.

    Parameters
    ----------
    solid : (I, J, K) bool array
        One piece (voxels that meet at faces) without cavities.
    width : float
        Of the widest tunnel to be filled [voxels].

    Returns
    -------
    (I, J, K) bool array
        One piece without cavities.
    int
        Number of tunnels that were filled.
    """
    before = euler_number(solid)
    if before == 1 or width <= 0.0:
        return solid, 0
    result = _plugged(solid)
    for radius in _RADII:
        if 2.0 * radius > width or euler_number(result) == 1:
            break
        result = _plugged(_patched(result, radius))
    return result, euler_number(result) - before


def _plugged(solid: BoolArray) -> BoolArray:
    """Return a solid with every single voxel added that fills a tunnel, again and again until none does."""
    padded = np.pad(solid, 1).astype(np.uint8)
    inner = (slice(1, -1),) * 3
    fills = True
    while fills:
        fills = False
        beside = np.zeros(padded.shape, dtype=bool)
        beside[inner] = ndimage.binary_dilation(padded[inner] > 0) & (padded[inner] == 0)
        places = np.argwhere(beside)
        places = places[_gains(padded, places) > 0]
        parity = places % 2 @ (4, 2, 1)
        for kind in range(8):  # voxels that are no neighbours change independently
            some = places[parity == kind]
            some = some[_gains(padded, some) > 0]
            padded[tuple(some.T)] = 1
            fills |= len(some) > 0
    filled: BoolArray = ndimage.binary_fill_holes(padded[inner] > 0)
    return filled


def _patched(solid: BoolArray, radius: float) -> BoolArray:
    """Return a solid with those patches of its closing by a ball added that fill tunnels."""
    reach = int(np.ceil(radius))
    closed = near_distance(near_distance(np.pad(solid, reach), reach + 1) > radius, reach + 1) > radius
    inner = (slice(reach, -reach),) * 3
    result = solid.copy()
    for box, patch in _patches(closed[inner] & ~solid):
        old = result[box]
        if euler_number(old | patch) > euler_number(old):
            result[box] = old | patch
    filled: BoolArray = ndimage.binary_fill_holes(result)
    return filled


def _patches(voxels: BoolArray) -> Iterator[tuple[tuple[slice, ...], BoolArray]]:
    """Return the connected patches of voxels, each with a box that holds it and its neighbours."""
    labels, _ = ndimage.label(voxels, _ANY_NEIGHBOUR)
    for number, bounds in enumerate(ndimage.find_objects(labels), start=1):
        box = tuple(slice(max(axis.start - 1, 0), axis.stop + 1) for axis in bounds)
        yield box, labels[box] == number


def _gains(padded: Array, places: IntArray) -> IntArray:
    """Return by how much the Euler number grows with each of some voxels added on its own."""
    gains = np.zeros(len(places), dtype=np.int64)
    for corner in _CORNERS:
        pattern = np.zeros(len(places), dtype=np.uint8)
        for place, shift in enumerate(_CORNERS):
            pattern |= padded[tuple((places - 1 + corner + shift).T)] << place
        own = _CORNERS.index(tuple(1 - step for step in corner))
        gains += _OCTANTS[pattern | 1 << own] - _OCTANTS[pattern]
    return gains // 8


def _patterns(padded: Array) -> Array:
    """Return the pattern of the 2 x 2 x 2 voxels at every corner between voxels."""
    size = [count - 1 for count in padded.shape]
    patterns = np.zeros(size, dtype=np.uint8)
    for place, shift in enumerate(_CORNERS):
        patterns |= (
            padded[tuple(slice(step, step + count) for step, count in zip(shift, size, strict=True))] << place
        )
    return patterns
