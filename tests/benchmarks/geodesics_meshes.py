"""Meshes for the geodesic benchmarks, about as many vertices as asked for."""

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull
from skimage.measure import marching_cubes

from homolog.surfaces.mesh import TriangleMesh


def icosphere(n_vertices: int) -> TriangleMesh:
    """Sphere of radius 30 mm: an icosahedron whose edges are cut in equal parts."""
    parts = max(1, round(((n_vertices - 2) / 10) ** 0.5))
    golden = (1 + 5**0.5) / 2
    ones = np.array([[a, b * golden] for a in (-1, 1) for b in (-1, 1)])
    corners = np.concatenate([np.roll(np.c_[np.zeros(4), ones], k, axis=1) for k in range(3)])
    faces = ConvexHull(corners).simplices
    i, j = np.array([(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]).T
    weights = np.stack([i, j, parts - i - j], axis=1) / parts
    points = np.unique(np.round(np.concatenate([weights @ corners[face] for face in faces]), 9), axis=0)
    return _hull(30 * points / np.linalg.norm(points, axis=1, keepdims=True))


def obtuse(n_vertices: int) -> TriangleMesh:
    """Jittered sphere, squeezed 1 : 0.6 : 0.35: half of its triangles are obtuse, up to 179 degrees."""
    points = np.array(icosphere(n_vertices).vertices)
    points += np.random.default_rng(0).normal(scale=30 * 0.7 * n_vertices**-0.5, size=points.shape)
    points *= 30 / np.linalg.norm(points, axis=1, keepdims=True)
    sphere = _hull(points)
    return TriangleMesh(sphere.vertices * [1.0, 0.6, 0.35], sphere.faces)


def bean(n_vertices: int, place: float = 0.0, width: float = 8.0) -> TriangleMesh:
    """The paper's ellipsoid with a slot, from a smoothed binary volume, slivers and all."""

    def inside(x: np.ndarray) -> np.ndarray:
        slot = (((x - [0, place, 20]) / [28, width, 14]) ** 2).sum(axis=-1) < 1
        return (((x / [40, 30, 20]) ** 2).sum(axis=-1) < 1) & ~slot

    return _rasterized(inside, (40, 30, 20), n_vertices / 16_900)


def cup(n_vertices: int) -> TriangleMesh:
    """Half an ellipsoid's shell, its wall 8 mm thick: in space, the other side of the wall is near."""

    def inside(x: np.ndarray) -> np.ndarray:
        outer = ((x / [35, 35, 60]) ** 2).sum(axis=-1) < 1
        return outer & (((x / [27, 27, 52]) ** 2).sum(axis=-1) >= 1) & (x[..., 2] < 10)

    return _rasterized(inside, (35, 35, 60), n_vertices / 35_000)


def _rasterized(inside: object, half: tuple[int, int, int], area_per_mm2: float) -> TriangleMesh:
    spacing = area_per_mm2**-0.5
    axes = [np.arange(-np.ceil(h / spacing) - 4, np.ceil(h / spacing) + 5) * spacing for h in half]
    volume = inside(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)).astype(np.float32)
    vertices, faces, _, _ = marching_cubes(ndimage.gaussian_filter(volume, 1.0), 0.5)
    return TriangleMesh(vertices * spacing, faces[:, ::-1])


def _hull(points: np.ndarray) -> TriangleMesh:
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    return TriangleMesh(points, np.where(inward[:, None], faces[:, ::-1], faces))
