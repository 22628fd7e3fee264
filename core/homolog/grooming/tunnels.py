"""Filling of narrow tunnels through a solid of voxels, which are due to noise in labels.

A label map of a thin or folded structure has tunnels of one or two voxels, at different positions in each
subject. The surfaces of such subjects do not correspond.
"""

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, BoolArray, IntArray
from homolog.grooming.antialias import near_squared
from homolog.io.values import box_of
from homolog.surfaces.topology import without_cavities

__all__ = ["euler_numbers", "fill_tunnels"]

_ANY_NEIGHBOUR = np.ones((3, 3, 3), dtype=bool)
_NEAR = np.argwhere(_ANY_NEIGHBOUR) - 1
MAX_LOOKS = 20  # limit on the voxels of all patches' boxes, relative to the solid's box
_RADII = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)  # voxels: radii of the balls of successive closings


def _octant_tables() -> IntArray:
    """Return eight times the contribution of each pattern of 2 x 2 x 2 voxels to two Euler numbers, (2, 256).

    For the first, voxels are the points of a complex, neighbours at a face its edges, full squares its faces
    and full cubes its cells; a pattern counts an eighth of each of its voxels, a quarter of its edges, half
    of its faces. For the second, voxels are closed cubes, which meet at edges and corners too; a pattern
    counts its corner, half of six edges, a quarter of twelve squares, an eighth of each of its voxels.
    """
    table = np.zeros((2, 256), dtype=np.int64)
    for pattern in range(256):
        bits = np.array([pattern >> place & 1 for place in range(8)], dtype=bool).reshape(2, 2, 2)
        for row, of, sign in ((0, np.all, 1), (1, np.any, -1)):
            pairs = sum(np.count_nonzero(of(bits, axis=axis)) for axis in range(3))
            squares = sum(np.count_nonzero(of(bits, axis=axes)) for axes in ((0, 1), (0, 2), (1, 2)))
            cube = bool(of(bits))
            table[row, pattern] = sign * (np.count_nonzero(bits) - 2 * pairs + 4 * squares - 8 * cube)
    return table


_BY_FACES, _BY_CORNERS = _octant_tables()
_EITHER = _BY_FACES + _BY_CORNERS
"""The sum of both: a zero level joins some of the nodes that touch at an edge or corner."""


def euler_numbers(solid: BoolArray) -> tuple[int, int]:
    """Return the Euler numbers with voxels connected at faces only, and at edges and corners too.

    An Euler number is the number of pieces minus the number of tunnels plus the number of cavities.

    Parameters
    ----------
    solid : (I, J, K) bool array
        True inside.

    References
    ----------
    Gray, Local properties of binary images in two dimensions, IEEE Transactions on Computers C-20, 1971
    (here extended to three).
    """
    padded = np.zeros([count + 2 for count in solid.shape], np.uint8)  # np.pad is slow on small arrays
    padded[1:-1, 1:-1, 1:-1] = solid
    patterns = _patterns(padded).ravel()
    mixed = patterns[(patterns > 0) & (patterns < 255)]  # others contribute nothing, and are most of them
    counts = np.bincount(mixed, minlength=256)
    return int(counts @ _BY_FACES) // 8, int(counts @ _BY_CORNERS) // 8


def fill_tunnels(solid: BoolArray, width: float) -> tuple[BoolArray, tuple[int, int]]:
    """Fill tunnels narrower than a width: those between thick parts and holes in thin walls.

    The voxels added by a closing of the solid form patches. A patch is added only if it reduces the number of
    tunnels.

    Parameters
    ----------
    solid : (I, J, K) bool array
        A single piece (connected at faces) without cavities.
    width : float
        Width of the widest tunnel to fill [voxels].

    Returns
    -------
    (I, J, K) bool array
        A single piece without cavities.
    (int, int)
        Number of tunnels that were filled, by each of the `euler_numbers`.
    """
    box = tuple(slice(max(side.start - 1, 0) // 2 * 2, side.stop + 1) for side in box_of(solid))
    part = solid[box]
    before = euler_numbers(part)
    if sum(before) == 2 or width <= 0.0:
        return solid, (0, 0)
    part = without_cavities(_plugged(part))
    after = euler_numbers(part)
    for radius in _RADII:
        if 2.0 * radius > width or sum(after) == 2:
            break
        part = without_cavities(_plugged(_patched(part, radius)))
        after = euler_numbers(part)
    result = solid.copy()
    result[box] = part
    return result, (after[0] - before[0], after[1] - before[1])


def _plugged(solid: BoolArray) -> BoolArray:
    """Add single voxels that fill a tunnel, until none is left."""
    padded = np.pad(solid, 1).astype(np.uint8)
    places = _places(_adjacent_to_solid(padded))
    places = places[_gains(padded, places) > 0]
    if not len(places):
        return solid
    while len(places):
        changed = []
        parity = places % 2 @ (4, 2, 1)
        for kind in range(8):  # voxels that are not neighbours change independently
            some = places[parity == kind]
            some = some[_gains(padded, some) > 0]
            padded[tuple(some.T)] = 1
            changed.append(some)
        places = _adjacent(padded, np.concatenate(changed))
        places = places[_gains(padded, places) > 0]
    return np.asarray(padded[1:-1, 1:-1, 1:-1] > 0)


def _adjacent_to_solid(padded: Array) -> BoolArray:
    """Return the empty voxels that have a neighbour at a face, without those of the border."""
    inner = (slice(1, -1),) * 3
    near = np.zeros(padded.shape, np.uint8)
    for axis in range(3):
        along, beside = np.moveaxis(padded, axis, 0), np.moveaxis(near, axis, 0)
        beside[1:-1] |= along[:-2] | along[2:]
    result = np.zeros(padded.shape, bool)
    result[inner] = near[inner] > padded[inner]
    return result


def _adjacent(padded: Array, changed: IntArray) -> IntArray:
    """Return the empty voxels near changed ones that have a neighbour at a face."""
    near = np.unique((changed[:, None] + _NEAR).reshape(-1, 3), axis=0)
    near = near[((near > 0) & (near < np.array(padded.shape) - 1)).all(axis=1)]
    near = near[padded[tuple(near.T)] == 0]
    faces = near[:, None] + _NEAR[np.abs(_NEAR).sum(axis=1) == 1]
    beside: BoolArray = padded[tuple(faces.transpose(2, 0, 1))].any(axis=1)
    return np.asarray(near[beside])


def _patched(solid: BoolArray, radius: float) -> BoolArray:
    """Add the patches of a closing by a ball that fill tunnels."""
    width = int(radius) + 1
    opened = near_squared(np.pad(solid, width), width) > radius**2
    closed = near_squared(opened, width) > radius**2
    inner = (slice(width, -width),) * 3
    result = solid.copy()
    patches, _ = ndimage.label(closed[inner] & ~solid, _ANY_NEIGHBOUR)
    bounds = [box for box in ndimage.find_objects(patches) if box is not None]
    left = MAX_LOOKS * solid.size
    for number in np.flatnonzero(_gains_of_patches(solid, patches) > 0):
        box = tuple(slice(max(axis.start - 1, 0), axis.stop + 1) for axis in bounds[number - 1])
        old = result[box]
        left -= 2 * old.size
        if left < 0:
            break
        new = old | (patches[box] == number)
        if _pieces(new) <= _pieces(old):
            result[box] = new
    return result


def _pieces(solid: BoolArray) -> int:
    return int(ndimage.label(solid)[1])


def _gains_of_patches(solid: BoolArray, patches: IntArray) -> IntArray:
    """Return the increase of the Euler number by each patch of empty voxels, 0 for patch 0.

    No pattern contains voxels of two patches, so that its contribution is divided among its patch's voxels.
    """
    places = _places(patches)
    numbers = patches[tuple(places.T)]
    before, added = (_patterns(_around(np.pad(item, 1), places + 1)) for item in (solid, patches > 0))
    shares = (_EITHER[before | added] - _EITHER[before]) / np.bitwise_count(added)
    gains = np.bincount(numbers, shares.sum(axis=(0, 1, 2)), int(patches.max(initial=0)) + 1)
    gains[np.bincount(numbers, minlength=len(gains)) == 1] = 0.0  # single voxels were filled before
    return np.rint(gains / 8.0).astype(np.int64)


def _gains(padded: Array, places: IntArray) -> IntArray:
    """Return the increase of the Euler number by each of some voxels, added alone."""
    near = _around(padded, places)
    near[1, 1, 1] = 0
    before = _patterns(near)
    near[1, 1, 1] = 1
    return np.asarray((_EITHER[_patterns(near)] - _EITHER[before]).sum(axis=(0, 1, 2)) // 8)


def _places(mask: Array) -> IntArray:
    """Return the result of `np.argwhere`, in half the time."""
    return np.stack(np.unravel_index(np.flatnonzero(mask), mask.shape), axis=1)


def _around(padded: Array, places: IntArray) -> Array:
    """Return the 3 x 3 x 3 voxels around each of some places, (3, 3, 3, N) uint8."""
    steps = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
    near = padded.view(np.uint8).ravel()[places @ steps + (_NEAR @ steps)[:, None]]
    return np.asarray(near.reshape(3, 3, 3, -1))


def _patterns(padded: Array) -> Array:
    """Return the pattern of the 2 x 2 x 2 voxels at every corner between voxels of the first three axes."""
    for axis, bits in ((2, 1), (1, 2), (0, 4)):
        along = np.moveaxis(padded, axis, 0)
        padded = np.moveaxis(along[:-1] | along[1:] << bits, 0, axis)
    return padded
