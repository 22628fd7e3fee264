"""Meshes whose distances are known."""

import numpy as np
import pytest
import warp as wp
from scipy import ndimage
from scipy.spatial import ConvexHull
from skimage.measure import marching_cubes

from homolog.surfaces.mesh import TriangleMesh


def make_sphere(n, radius=30.0):
    k = np.arange(n) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    points = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1
    )
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    return TriangleMesh(radius * points, np.where(inward[:, None], faces[:, ::-1], faces))


@pytest.fixture(scope="session")
def sphere():
    """Return a maker of spheres of radius 30 with n vertices."""
    return make_sphere


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
