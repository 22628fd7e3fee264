"""Splitting: each new particle starts next to a parent, in the same direction on every shape."""

import numpy as np

from homolog.arrays import FloatArray

__all__ = ["split"]


def split(
    positions: FloatArray, normals: FloatArray, count: int, offset: FloatArray, random: np.random.Generator
) -> FloatArray:
    """Return `count` particles a shape: the given ones, some of them split in two.

    Parameters
    ----------
    positions, normals : (M, n, 3) arrays
    count : int
        Number of particles, n < count <= 2n. If count < 2n, the particles that are split are drawn at random.
    offset : (M,) array
        Distance of each half from its parent, by shape.
    random : numpy Generator

    Returns
    -------
    (M, count, 3) array
        The halves lie off the surface by the curvature; the caller projects them.

    Notes
    -----
    One direction a particle serves all shapes: drawn in the tangent plane of the mean normal, then
    projected to each shape's own tangent plane. A direction across the surface would shrink to nothing,
    or point to opposite sides on different shapes.
    """
    n = positions.shape[1]
    parents = np.sort(random.permutation(n)[: count - n])
    mean = normals[:, parents].sum(axis=0)
    direction = random.normal(size=3)
    direction = (
        direction
        - mean
        * np.einsum("d,nd->n", direction, mean)[:, None]
        / np.maximum(np.einsum("nd,nd->n", mean, mean), 1e-12)[:, None]
    )
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    own = normals[:, parents]
    flat = direction - own * np.einsum("nd,mnd->mn", direction, own)[..., None]
    flat = flat / np.maximum(np.linalg.norm(flat, axis=2, keepdims=True), 0.2)
    result = np.concatenate([positions, positions[:, parents]], axis=1)
    flat *= offset[:, None, None]
    result[:, parents] -= flat
    result[:, n:] += flat
    return result
