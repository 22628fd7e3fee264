"""Which wall of a left ventricle a particle is on, told from the myocardium's own slices."""

import numpy as np
from scipy import ndimage

PROBE_MM = 2.0  # in front of the surface: farther than its rounding by the voxels, nearer than any other wall


def facing(shape, particles, normals):
    """Tell what each particle looks at: 1 the cavity, -1 the outside, 0 past the base, above the flat rim.

    The cavity is what a slice of the myocardium encloses. A point a little in front of the particle decides,
    so that it makes no difference how far the wall leans there: the floor of the cavity leans any way.

    Parameters
    ----------
    shape : Shape
        A ventricle, its long axis along z and its base at low z in file coordinates.
    particles, normals : (N, 3) arrays
        In file coordinates [mm], and outward.
    """
    grid = shape.field.index_to_world
    order = np.argmax(np.abs(grid[:3, :3]), axis=1)  # the grid's axis along x, y and z
    inside = shape.field.values.transpose(order) < 0.0
    slices = [ndimage.binary_fill_holes(item) for item in np.moveaxis(inside, 2, 0)]
    cavity = np.stack(slices, axis=2) & ~inside
    to_index = np.linalg.inv(grid)
    at = ((particles + PROBE_MM * normals) @ to_index[:3, :3].T + to_index[:3, 3])[:, order]
    nearest = np.clip(np.rint(at).astype(int), 0, np.array(inside.shape) - 1)
    there = tuple(nearest.T)
    closed = np.flatnonzero(cavity.any(axis=(0, 1)))  # the rounded rim's last slice may be an open ring
    upwards = grid[2, order[2]] > 0.0
    beyond = at[:, 2] < closed[0] - 0.5 if upwards else at[:, 2] > closed[-1] + 0.5
    return np.where(beyond | inside[there], 0, np.where(cavity[there], 1, -1))


def wall_swaps(shapes, result):
    """Share [%] of pairs with one end on the inner and one on the outer wall, and how many particles."""
    side = []
    for shape, particles, normals in zip(shapes, result.local, result.normals, strict=True):
        linear = shape.alignment[:3, :3]
        turn = linear / np.cbrt(np.linalg.det(linear))
        side.append(facing(shape, particles, normals @ turn))
    side = np.array(side)
    pairs = [side[i] * side[j] for i in range(len(side)) for j in range(i)]
    both, swapped = np.count_nonzero(pairs), np.count_nonzero(np.array(pairs) < 0)
    return 100.0 * swapped / both, int(((side > 0).any(axis=0) & (side < 0).any(axis=0)).sum())
