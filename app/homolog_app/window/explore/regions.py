"""Places on the mean surface: connected regions and their middles. Knows no Qt."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from homolog.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["largest_region", "middle_of"]


def largest_region(faces: IntArray, inside: BoolArray) -> BoolArray:
    """Return the vertices (V,) of the largest region of `inside` that edges of (F, 3) faces connect."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    kept = edges[inside[edges].all(axis=1)]
    graph = coo_matrix((np.ones(len(kept)), kept.T), shape=(len(inside), len(inside)))
    labels = connected_components(graph, directed=False)[1]
    counts = np.bincount(labels[inside])
    return np.asarray(inside & (labels == counts.argmax()))


def middle_of(shape: "ModelShape", region: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the vertex of a region nearest to its middle [mm] and the mean surface's normal there."""
    vertices = shape.mean.vertices
    chosen = np.flatnonzero(region)
    nearest = chosen[np.linalg.norm(vertices[chosen] - vertices[chosen].mean(axis=0), axis=1).argmin()]
    return np.asarray(vertices[nearest], np.float64), np.asarray(shape.mean_normals[nearest], np.float64)
