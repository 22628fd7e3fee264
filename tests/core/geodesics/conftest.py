"""Meshes whose distances are known."""

import numpy as np
import pytest
import warp as wp
from scipy import ndimage
from skimage.measure import marching_cubes

from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="session")
def sphere(unit_sphere):
    """Return a maker of spheres with n vertices."""

    def made(n, radius=30.0):
        points, faces = unit_sphere(n)
        return TriangleMesh(radius * points, faces)

    return made


@pytest.fixture(scope="session")
def slotted():
    """Return a marching-cubes surface with a slot, slivers and all; 1.5 mm edges."""
    grid = np.stack(np.meshgrid(*[np.arange(-14.0, 15.0)] * 3, indexing="ij"), axis=-1)
    body = (np.square(grid / [12, 9, 7]).sum(axis=-1) < 1) & ~(
        np.square((grid - [0, 0, 7]) / [8, 3, 5]).sum(axis=-1) < 1
    )
    vertices, faces, _, _ = marching_cubes(ndimage.gaussian_filter(body.astype(np.float32), 1.0), 0.5)
    return TriangleMesh(vertices, faces[:, ::-1])


@pytest.fixture(scope="session")
def plate():
    """Return a plate of 20 x 20 x 0.5 mm with vertices 1 mm apart: two walls close together."""
    line = np.arange(21.0)
    x, y = (g.ravel() for g in np.meshgrid(line, line, indexing="ij"))
    n = len(x)
    rim = (x == 0) | (x == 20) | (y == 0) | (y == 20)
    top = np.stack([x, y, np.full(n, 0.5)], axis=1)
    bottom = top - [0, 0, 0.5]
    squares = np.array([(21 * i + j) for i in range(20) for j in range(20)])
    up = np.concatenate(
        [
            np.stack([squares, squares + 21, squares + 22], 1),
            np.stack([squares, squares + 22, squares + 1], 1),
        ]
    )
    order = np.flatnonzero(rim)
    angle = np.arctan2(y[order] - 10, x[order] - 10)
    ring = order[np.argsort(angle)]
    after = np.roll(ring, -1)
    side = np.concatenate([np.stack([ring, ring + n, after + n], 1), np.stack([ring, after + n, after], 1)])
    return TriangleMesh(np.concatenate([top, bottom]), np.concatenate([up, up[:, ::-1] + n, side]))


@pytest.fixture(scope="session", autouse=True)
def quiet():
    """Keep Warp's banner out of the tests' output."""
    wp.config.quiet = True
